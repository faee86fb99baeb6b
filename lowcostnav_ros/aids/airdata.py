"""Air data: velocity through the air, as an aid of every navigator that carries velocity and attitude.

While GPS velocity is good it teaches wind, airspeed error and flow angles and moves nothing else.  Without it, airspeed holds the velocity
along the flight and the flow angles hold it across, and thereby the attitude: between two measurements the core integrates ``C_nb f_b +
g``, so the error of that integral, ``-[integral of f_n x] phi``, is in the covariance between velocity and attitude.  That is the exact
form of comparing the change of velocity with the integral of specific force, in turns as well.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, POS, VEL
from lowcostnav_ros.cores.views import Attitude, Velocity
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, GateSettings, Host, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov, random_walk
from lowcostnav_ros.estimation.growth import Growth
from lowcostnav_ros.estimation.innovation_watch import watch
from lowcostnav_ros.estimation.unconfirmed import UnconfirmedSpeed
from lowcostnav_ros.physics.rotation import skew

SLOW = "below minimum airspeed"
ADVICE = "pitot tube blocked or iced, air data failed, or the wind has changed at once"
CREPT = "airspeed creeps away from the inertial motion"
WATCHED_S, CALM_MPS = (5.0, 15.0, 45.0), 0.3
"""Times over which the innovations of the airspeed are added up, and the mean that a sound one may have."""
MOVED_S = 90.0
"""What it has moved so long ago was right."""
WAIT_S = 20.0
"""One that creeps is not used for so long, three times as long each time again."""
UNCONFIRMED = 0.4
"""Share of a change of the airspeed without GPS that may be its error: the inertial sensors have felt the rest."""
GUSTS = 8.0
"""Changes up to so many times the noise of a measurement are that, and flying by hand."""
SHEAR = 2.0
"""No wind changes at once by much more than so many times its usual change; the rest of a step is the airspeed's own."""
CHANCE = chi_square.threshold(1.0 - 1e-6, 1)
SMALLEST_SPEED = 1.0
VANE_SHARE = 0.5 * DEGREE
"""Smallest error of a vane, rad: position error and mounting."""


@dataclass(frozen=True)
class AirDataSettings(SensorSettings):
    """Air data: airspeed and flow angles teach the wind while GPS is good and hold the velocity, and so the attitude, without it."""

    enabled: bool = setting(True, "Use the air-relative velocity.")
    noise_mps: float = setting(0.5, "White noise and gusts in each component.", unit="m/s", minimum=0.01, maximum=50.0, within=3)
    bias_mps: float = setting(2.6, "Slow airspeed error, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=50.0, within=3)
    bias_tau_s: float = setting(400.0, "Correlation time of the slow airspeed error.", unit="s", minimum=1.0)
    scale: float = setting(0.0, "Constant scale-factor error, sigma as a fraction; 0: no state.", minimum=0.0, maximum=0.5)
    incidence_deg: float = setting(3.0, "Usual incidence of the body x axis, used without a vane.", unit="deg", minimum=-5.0, maximum=20.0)
    incidence_sigma_deg: float = setting(2.0, "Incidence about the usual one, Gauss-Markov sigma.", unit="deg", minimum=0.1, maximum=20.0)
    incidence_tau_s: float = setting(60.0, "Correlation time of the incidence.", unit="s", minimum=0.5)
    sideslip_sigma_deg: float = setting(1.5, "Sideslip, Gauss-Markov sigma.", unit="deg", minimum=0.1, maximum=30.0)
    sideslip_tau_s: float = setting(15.0, "Correlation time of the sideslip.", unit="s", minimum=0.5)
    wind_mps: float = setting(
        5.0, "Change of a wind component in its correlation time, sigma.", unit="m/s", minimum=0.01, maximum=50.0, within=3
    )
    wind_tau_s: float = setting(400.0, "Correlation time of the wind.", unit="s", minimum=1.0, within=2)
    wind_spread: float = setting(
        1.0, "Factor by which that change may be more or less, learned while GPS is good; 1: as set.", minimum=1.0, maximum=10.0
    )
    wind_start_mps: float = setting(10.0, "Sigma of the wind at the start.", unit="m/s", minimum=0.1, maximum=100.0)
    updraught_mps: float = setting(0.5, "Vertical wind, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=20.0)
    updraught_tau_s: float = setting(30.0, "Correlation time of the vertical wind.", unit="s", minimum=1.0)
    minimum_mps: float = setting(15.0, "Below this airspeed nothing is used.", unit="m/s", minimum=1.0, maximum=200.0)
    period_s: float = setting(0.2, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    timeout_s: float = setting(3.0, "No accepted airspeed for this long is an outage.", unit="s", minimum=0.1, maximum=60.0)
    gate: GateSettings = group(GateSettings)


class AirDataAid(Aid):
    """Velocity through the air: its length is the true airspeed, its direction sideslip and incidence."""

    name, labels = "airdata", ("tas_mps", "lateral_mps", "vertical_mps")
    measurement, topic, views = AirVelocity, "air/velocity", (Velocity, Attitude)
    growth: Growth | None = None
    teaches = ("wind", "updraught", "airspeed_bias", "airspeed_scale", "sideslip", "incidence")

    def blocks(self) -> list[Block]:
        """Wind, airspeed errors and flow angles.

        The wind is a random walk with the short-term growth of a Gauss-Markov process, so that a steady wind is no error to forget.
        """
        air, own = self.settings, self.own
        growth = air.wind_mps * float(np.sqrt(2.0 / air.wind_tau_s))
        angles = (("sideslip", air.sideslip_sigma_deg, air.sideslip_tau_s), ("incidence", air.incidence_sigma_deg, air.incidence_tau_s))
        bias, scale = own("airspeed_bias"), own("airspeed_scale")
        return [
            random_walk("wind", ["wind_north_mps", "wind_east_mps"], Kind.WIND, air.wind_start_mps, growth),
            gauss_markov("updraught", ["wind_down_mps"], Kind.FREE, air.updraught_mps, air.updraught_tau_s),
            gauss_markov(bias, [f"{bias}_mps"], Kind.AIRSPEED_BIAS, air.bias_mps, air.bias_tau_s),
            *([random_walk(scale, [scale], Kind.AIRSPEED_SCALE, air.scale)] if air.scale else []),
            *(gauss_markov(own(n), [f"{own(n)}_rad"], Kind.FREE, sigma * DEGREE, tau) for n, sigma, tau in angles),
        ]

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.unfelt = Latch("airspeed and inertial motion disagree", (self.topic, "the inertial sensors"), "m/s")
        self.latches = [self.unfelt]
        self._unconfirmed = UnconfirmedSpeed(UNCONFIRMED, GUSTS * settings.noise_mps)

    def attach(self, host: Host) -> None:
        """Find the states; how fast the wind changes may be learned."""
        spread, taught = self.settings.wind_spread, host.layout.mask(*map(self.own, self.teaches)) > 0.0
        self.growth = Growth(host.layout, taught, host.layout["wind"], spread) if spread > 1.0 else None
        super().attach(host)

    def restart(self) -> None:
        """Forget what was received, and how fast the wind changed."""
        super().restart()
        self._begin_watch()
        self._waits, self._until_ns = 0, 0
        self._unconfirmed.clear()
        if self.growth is not None:
            self.growth.restart()

    def fuse(self, innovation: Innovation, host: Host) -> None:
        """As every aid; with GPS it shows how fast the wind changes, without it what it moves is kept in mind."""
        y, H, R, free = innovation.y, innovation.H, innovation.R, innovation.free
        if self.growth is not None and free is not None:
            self.growth.take(self.status.stamp_ns, y, H, R, host.core.estimate, host.P)
        dx = self.updated(innovation, host)
        self._moved += dx
        host.correct(dx)

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """As every aid; what the inertial sensors did not feel is named.  Without GPS, one that creeps away from them has to wait."""
        y, S = self.status.innovation, self.status.innovation_variance
        if y is None or S is None or host.gps_good(stamp_ns):
            self._begin_watch()
            self._waits, self._until_ns = 0, 0
            decision = super().control(stamp_ns, test_ratio, host)
        elif self._until_ns:
            over = stamp_ns >= self._until_ns
            self._until_ns, decision = (0, (Decision.RECOVER, CREPT)) if over else (self._until_ns, (Decision.REJECT, CREPT))
        elif test_ratio <= 1.0 and self._creeps(stamp_ns, y[:1], S[:1, None], host):
            self._doubt_moved(host)
            self._until_ns, self._waits = stamp_ns + round(1e9 * WAIT_S * 3**self._waits), min(self._waits + 1, 6)
            decision = Decision.REJECT, CREPT
        else:
            decision = super().control(stamp_ns, test_ratio, host)
        if decision[0] is Decision.FUSE:
            self._confirm(host, confirmed=host.gps_good(stamp_ns))
        self.unfelt.judge(stamp_ns, decision[0] is not Decision.FUSE, 0.0 if y is None else float(np.linalg.norm(y)), self.source, ADVICE)
        return decision

    def _confirm(self, host: Host, *, confirmed: bool) -> None:
        """Know the airspeed less well where it has changed since GPS confirmed it."""
        seen = self.status.observation
        gained = 0.0 if seen is None else self._unconfirmed.take(self.status.stamp_ns, float(seen[0]), confirmed=confirmed)
        if gained > 0.0:
            kalman.add_variance(host.P, host.layout[self.own("airspeed_bias")], gained, host.core.history)

    def doubt_mps(self, measurement: AirVelocity) -> float:
        """Sigma, m/s, by which a measurement may be off because it has changed while no GPS confirmed it."""
        return self._unconfirmed.doubt(float(np.linalg.norm(measurement.vel_b)))

    def _begin_watch(self) -> None:
        """Forget the innovations seen, and what they have moved."""
        shape = len(WATCHED_S)
        self._sums = np.zeros((shape, 1)), np.zeros((shape, 1, 1)), np.zeros((shape, 1, 1))
        self._moved, self._seen_ns = np.zeros(self._all.size), 0

    def _doubt_moved(self, host: Host) -> None:
        """Add what it has moved of late to the covariance, position, velocity and attitude alone: one must not vouch for the others."""
        for rows in (POS, VEL, ATT):
            kalman.add_variance(host.P, rows, np.outer(self._moved[rows], self._moved[rows]), host.core.history)
        self._begin_watch()

    def _creeps(self, stamp_ns: int, y: np.ndarray, S: np.ndarray, host: Host) -> bool:
        """Whether airspeed has been off to one side for longer than chance allows; carries what it has moved on to now."""
        dt = 1e-9 * (stamp_ns - self._seen_ns) if self._seen_ns else 0.0
        self._seen_ns = stamp_ns
        self._moved *= np.exp(-dt / MOVED_S)
        self._moved += host.core.dynamics() @ self._moved * dt
        return watch(y, np.eye(1), S, dt, np.array(WATCHED_S), np.array([CALM_MPS]), *self._sums)[1] > CHANCE

    def recover(self, measurement: AirVelocity, innovation: Innovation, host: Host) -> None:
        """Lose the air mass, not the velocity: the wind has changed or the airspeed fails, and from now on only its changes count."""
        self._doubt_moved(host)
        layout, y, history = host.layout, innovation.y, host.core.history
        kalman.add_variance(host.P, layout["wind"], min(float(y @ y), (SHEAR * self.settings.wind_mps) ** 2), history)
        kalman.add_variance(host.P, layout[self.own("airspeed_bias")], float(y[0] ** 2), history)
        self.fuse(innovation, host)

    def wind_n(self, host: Host) -> np.ndarray:
        """Estimated wind (3,), m/s, NED."""
        estimate, layout = host.core.estimate, host.layout
        return np.concatenate((estimate[layout["wind"]], estimate[layout["updraught"]]))

    def fast_enough(self, measurement: AirVelocity) -> bool:
        """Whether it flies fast enough for the measurement to be used."""
        return bool(measurement.vel_b[0] > 0.0 and np.linalg.norm(measurement.vel_b) >= self.settings.minimum_mps)

    def innovation(self, measurement: AirVelocity, host: Host) -> Innovation | str:
        """Rows airspeed, lateral, vertical against ``u = C' (v - w)``.

        ``TAS = (1 + s) |u| + b``;  lateral ``u_y``, vertical ``u_z``: a vane's measurement, else TAS times the estimated flow angle.
        Jacobian of u: ``C'`` on velocity, ``-C'`` on wind, ``C' [(v - w) x]`` on attitude.
        """
        if not self.fast_enough(measurement):
            return SLOW
        tas = float(np.linalg.norm(measurement.vel_b))
        air_n = host.core.nav[3:6] - self.wind_n(host)
        speed = float(np.linalg.norm(air_n))
        if speed < SMALLEST_SPEED:
            return "predicted airspeed is zero"
        H, predicted = self._rows(host, air_n, speed)
        measured, sigma = self._measured(measurement, H, host, tas)
        return Innovation(measured - predicted, H, np.diag(sigma**2), measured, self.free(measurement.stamp_ns, host))

    def _rows(self, host: Host, air_n: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
        C, layout, estimate = host.core.C_nb(), host.layout, host.core.estimate
        H = np.zeros((3, layout.size))
        to_u = np.vstack((air_n / speed, C.T[1:]))
        H[:, host.core.velocity_rows] = to_u
        H[1:, host.core.attitude_rows] = (C.T @ skew(air_n))[1:]
        H[:, layout["wind"]], H[:, layout["updraught"]] = -to_u[:, :2], -to_u[:, 2:]
        bias, scale = layout[self.own("airspeed_bias")].start, layout.get(self.own("airspeed_scale"))
        H[0, bias] = 1.0
        tas = speed + estimate[bias]
        if scale is not None:
            factor = 1.0 + estimate[scale.start]
            tas = factor * speed + estimate[bias]
            H[0] *= factor
            H[0, bias], H[0, scale] = 1.0, speed
        return H, np.array([tas, *(C.T @ air_n)[1:]])

    def _measured(self, measurement: AirVelocity, H: np.ndarray, host: Host, tas: float) -> tuple[np.ndarray, np.ndarray]:
        """What each row saw and its white sigma; an unmeasured direction is the flow angle's estimate, a state of its own."""
        settings = self.settings
        stated = measurement.cov_b[0, 0] - settings.bias_mps**2  # the message states the whole error; its slow part is a state here
        measured, sigma = np.empty(3), np.full(3, settings.noise_mps)
        measured[0], sigma[0] = tas, np.sqrt(max(settings.noise_mps**2, stated))
        for axis, name, usual in ((1, "sideslip", 0.0), (2, "incidence", settings.incidence_deg * DEGREE)):
            variance = measurement.cov_b[axis, axis]
            if variance < UNKNOWN_VARIANCE:
                measured[axis] = measurement.vel_b[axis]
                sigma[axis] = np.sqrt(settings.noise_mps**2 + max(variance, (tas * VANE_SHARE) ** 2))
            else:
                state = host.layout[self.own(name)].start
                H[axis, state] = -tas
                measured[axis] = tas * (usual + host.core.estimate[state])
        return measured, sigma


AIRDATA = AIDS.register("airdata", Sensor("airdata", AirDataSettings, each(AirDataAid)), __name__)
