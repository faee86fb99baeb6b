"""GPS receiver: position and velocity of its antenna."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.cores.inertial import POS
from lowcostnav_ros.cores.views import Attitude, Place, Velocity
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import (
    BACK,
    Aid,
    Decision,
    GateSettings,
    Host,
    Innovation,
    Sensor,
    SensorSettings,
    each,
    floored,
    reset_to,
)
from lowcostnav_ros.estimation.cross_checks.scatter import ScatterCheck
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.estimation.innovation_watch import InnovationWatch
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.rotation import skew
from lowcostnav_ros.physics.stochastic import correlation_factor

STEADY = 3.0
"""Sigmas by which the innovation of a velocity that stepped may change while the prediction is sound."""
BRIEF_NS = 2_000_000_000
"""Rejections for no longer than this are chance, and leave a prediction settled."""
SETTLED_S = 30.0
"""A prediction that has agreed for so long, no hole in its data, contradicts a velocity that steps; a young or poor one nobody."""
LONGER = 1.2
"""Times the memory of its receiver, after which the prediction is the less credible."""
WATCHED_S, RARE = (5.0, 10.0), 1e-3
"""Times over which innovations are watched, s, and how rarely a sound one is suspected."""
USUAL, USUALLY_S, LARGEST = 0.17, 60.0, 2.0
"""Their size, over what one in a thousand exceeds, that is usual; over which time what is usual is learnt; the most that counts for it."""
BEND_NS = 3_000_000_000
"""Innovations farther apart are not compared."""
PASSING_S, FEW = 2.0, 0.3
"""Of velocities that scatter fewer than this share pass the gate as stated, over such a time; of those that come twice half of them."""
LEAST = 1e-12
STEPPED = "velocity stepped without a motion"


@dataclass(frozen=True)
class GpsVelocitySettings(SensorSettings):
    """GPS velocity and the antenna."""

    lever_arm_b_m: list = setting([0.0, 0.0, 0.0], "Antenna relative to base_link, forward, right, down.", unit="m", minimum=-100.0)
    latency_s: float = setting(0.2, "Longest delay between validity and arrival of a fix.", unit="s", minimum=0.0, maximum=5.0)
    sigma_scale: float = setting(1.0, "Factor on the receiver's stated sigma.", minimum=0.1, maximum=100.0, within=2)
    velocity_floor_mps: float = setting(0.05, "Smallest velocity sigma used.", unit="m/s", minimum=0.0, maximum=1e2)
    correlation_s: float = setting(0.0, "Correlation time of receiver errors: fast fixes add little.", unit="s", minimum=0.0, maximum=600.0)
    period_s: float = setting(0.0, "Use at most one fix in this time; 0 uses all.", unit="s", minimum=0.0, maximum=60.0)
    memory_s: float = setting(
        60.0, "A receiver that contradicted itself is believed after agreeing this long.", unit="s", minimum=10.0, maximum=3600.0
    )
    timeout_s: float = setting(2.5, "No accepted fix for this long is an outage.", unit="s", minimum=0.1, maximum=600.0)
    gate: GateSettings = group(GateSettings)

    def __post_init__(self) -> None:
        if len(self.lever_arm_b_m) != 3:
            raise SettingsError(f"'gps.lever_arm_b_m' needs three numbers, forward, right, down, got {len(self.lever_arm_b_m)}.")


@dataclass(frozen=True)
class GpsSettings(GpsVelocitySettings):
    """GPS receiver and antenna."""

    position_floor_m: float = setting(0.5, "Smallest position sigma used.", unit="m", minimum=0.0, maximum=1e3)
    position_bias_m: float = setting(0.0, "Slow position error, Gauss-Markov sigma; 0: no states.", unit="m", minimum=0.0)
    position_bias_tau_s: float = setting(300.0, "Correlation time of the slow position error.", unit="s", minimum=1.0)


class ReceiverAid(Aid):
    """What a GPS receiver measures: its accepted innovations are watched over some seconds.

    Attributes
    ----------
    small : float
        What their mean may be off by while receiver and state are sound, in their unit.
    """

    small: ClassVar[float]

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self._watch, self._usual = InnovationWatch(WATCHED_S, [self.small] * 3, RARE), USUAL

    @property
    def drift(self) -> float:
        """Squared size of its innovations of some seconds together, over what one in a thousand sound ones exceeds.

        Where they are usually larger than they should be, as with an IMU poorer than set, so much larger is no suspicion.
        """
        return self._watch.ratio / max(1.0, self._usual / USUAL)

    def restart(self) -> None:
        """As every aid."""
        super().restart()
        self._watch.clear()
        self._watched_ns = 0

    def process(self, measurement: Any, host: Host) -> bool:
        """As every aid."""
        used, status, before_ns = super().process(measurement, host), self.status, self._watched_ns
        if self.decision is Decision.RECOVER:
            self._watch.clear()
        elif used and status.innovation is not None and status.innovation_variance is not None:
            self._watch.observe_axes(status.stamp_ns, status.innovation, status.innovation_variance, LEAST)
            share = min(1e-9 * (status.stamp_ns - before_ns) / USUALLY_S, 1.0) if before_ns else 0.0
            self._usual += share * (min(self._watch.ratio, LARGEST) - self._usual)
            self._watched_ns = status.stamp_ns
        return used


class PositionAid(ReceiverAid):
    """GPS position of the antenna against the estimated position and lever arm, metres NED."""

    name, labels = "gps_position", ("north_m", "east_m", "down_m")
    measurement, topic, views, is_fix, small = GpsPosition, "gps/fix", (Place,), True, 1.0

    def blocks(self) -> list[Block]:
        """Slow error of the receiver, m NED, where it is modelled."""
        gps, name = self.settings, self.own("gps_position_bias")
        if gps.position_bias_m == 0.0:
            return []
        labels = [f"{name}_{axis}_m" for axis in ("north", "east", "down")]
        return [gauss_markov(name, labels, Kind.FREE, gps.position_bias_m, gps.position_bias_tau_s)]

    def attach(self, host: Host) -> None:
        """Find the receiver's slow error and the attitude states."""
        super().attach(host)
        self.lever_b = np.array(self.settings.lever_arm_b_m, dtype=float) - getattr(host, "imu_arm_b", 0.0)
        self._bias, self.seeds = host.layout.get(self.own("gps_position_bias")), (POS,)
        self._attitude = host.core.attitude_rows if isinstance(host.core, Attitude) else None
        self._velocity = next((aid for aid in host.aids_of(VelocityAid) if aid.key == self.key), None)

    def noise(self, fix: GpsPosition) -> np.ndarray:
        """Covariance (3, 3) of one fix, m^2, scaled, with the floor on its variances."""
        return floored(fix.cov_n, self.settings.sigma_scale, self.settings.position_floor_m)

    def innovation(self, measurement: GpsPosition, host: Host) -> Innovation | str:
        """y = p_gps - (p + C l) - b; H = I on position, -[C l]x on attitude, I on the receiver's slow error."""
        core = host.core
        lever_n = core.lever_n(self.lever_b)
        observation = difference_n(measurement.lat, measurement.lon, measurement.height, core.nav[0], core.nav[1], core.nav[2])
        y = observation - lever_n
        H = np.zeros((3, host.layout.size))
        H[:, POS] = np.eye(3)
        if self._attitude is not None:
            H[:, self._attitude] = -skew(lever_n)
        if self._bias is not None:
            H[:, self._bias] = np.eye(3)
            y = y - core.estimate[self._bias]
        if not measurement.has_height:
            y[2], H[2] = 0.0, 0.0
        factor = correlation_factor(self.since_s(measurement), self.settings.correlation_s)
        return Innovation(y, H, factor * host.trust.noise_factor(self) * self.noise(measurement), observation)

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """As every aid; not used while the velocity of the same receiver is off by a step: it would pull the velocity after it."""
        velocity = self._velocity
        stepped = ""
        if velocity is not None and velocity.rejecting_since_ns is not None and not host.excluded(velocity):
            stepped = velocity.doubt(stamp_ns, host)
        if stepped and not host.excluded(self):
            self.rejecting_since_ns = self.rejecting_since_ns or stamp_ns
            return Decision.REJECT, stepped
        return super().control(stamp_ns, test_ratio, host)

    def recover(self, measurement: GpsPosition, innovation: Innovation, host: Host) -> None:
        """Reset the position to that of GPS: after a long disagreement it is the position that is wrong, not attitude or wind."""
        size = 3 if measurement.has_height else 2
        reset_to(host, slice(POS.start, POS.start + size), innovation.y[:size], self.noise(measurement)[:size, :size])


class VelocityAid(ReceiverAid):
    """GPS velocity of the antenna against the estimated velocity plus rotation of the lever arm, m/s NED.

    A velocity that steps while GPS is good, and from then on is off by the same, is no motion: the inertial sensors would have felt it.
    """

    name, labels = "gps_velocity", ("north_mps", "east_mps", "down_mps")
    measurement, topic, views, needs_rate, small = GpsVelocity, "gps/vel", (Velocity,), True, 0.01
    measures_velocity = True

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self._bends = Bends()
        self.scatter = ScatterCheck(self.status.name)
        self.latches = [self.scatter]

    def restart(self) -> None:
        """As every aid."""
        super().restart()
        self._bends.clear()
        self._passing = 1.0

    def process(self, measurement: GpsVelocity, host: Host) -> bool:
        """As every aid; its scatter about the prediction is watched where the velocity is carried by inertial sensors."""
        used, status = super().process(measurement, host), self.status
        if self.decision is None or status.innovation is None or status.innovation_variance is None or host.excluded(self):
            self._bends.clear()
        elif host.core.velocity_rows is not None:
            stated = status.innovation_variance - (self._factor - 1.0) * self.noise(measurement).diagonal()
            bend = self._bends.take(status.stamp_ns, status.innovation, stated)
            if bend is not None:
                passes = sum((status.innovation**2 / stated).tolist()) <= self.threshold
                self._passing += min(bend[0] / PASSING_S, 1.0) * (passes - self._passing)
                self.scatter.take(status.stamp_ns, *bend, counts=self._passing < FEW or self.scatter.held is not None)
        return used

    def attach(self, host: Host) -> None:
        """Take the lever arm."""
        super().attach(host)
        self.seeds = (host.core.velocity_rows,) if host.core.velocity_rows else ()
        self.lever_b = np.array(self.settings.lever_arm_b_m, dtype=float) - getattr(host, "imu_arm_b", 0.0)
        self._stepped: tuple[int, np.ndarray, np.ndarray] | None = None
        self.sound_since_ns: int | None = None
        self._off_since_ns: int | None = None
        self.swing_n = np.zeros(3)

    def noise(self, measurement: GpsVelocity) -> np.ndarray:
        """Covariance (3, 3) of one velocity, (m/s)^2, scaled, with the floor on its variances."""
        return floored(measurement.cov_n, self.settings.sigma_scale, self.settings.velocity_floor_mps)

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """As every aid; keeps the first innovation that was rejected while GPS was good, and its covariance."""
        held, y = self.is_fresh(stamp_ns), self.status.innovation
        if self._stepped is not None and y is not None and not host.excluded(self) and self.doubt(stamp_ns, host):
            _, first, S = self._stepped
            # that the gate has grown to its size is no agreement; that it passes the gate as it was is: the first was chance
            if y @ y > BACK**2 * first @ first and kalman.normalised_innovation_squared(y, S) > self.threshold:
                return Decision.REJECT, host.trust.is_frozen(self) or STEPPED
        decision = super().control(stamp_ns, test_ratio, host)
        if decision[0] is not Decision.REJECT:
            lasted_ns = 0 if self._off_since_ns is None else stamp_ns - self._off_since_ns
            if decision[0] is Decision.RECOVER or lasted_ns > BRIEF_NS or self.sound_since_ns is None:
                self.sound_since_ns = stamp_ns
            self._stepped = self._off_since_ns = None
            return decision
        self._off_since_ns = self._off_since_ns or stamp_ns
        settled = self.sound_since_ns is not None and self._off_since_ns - self.sound_since_ns >= 1e9 * SETTLED_S
        if self._stepped is None and held and settled and y is not None and self.status.innovation_covariance is not None:
            self._stepped = stamp_ns, y, self.status.innovation_covariance
        return decision

    def doubt(self, stamp_ns: int, host: Host) -> str:
        """Whether it stepped without a motion, and not so long ago that the prediction has become the less credible."""
        if host.inertial_is_suspect or self._stepped is None or host.core.velocity_rows is None or self.status.innovation_variance is None:
            return ""
        since_ns, first, _ = self._stepped
        change, variance = self.status.innovation - first, self.status.innovation_variance
        # by more than a sound prediction may have drifted since, or than it stepped: whose sigma has been widened since tells nothing
        drifted = float(np.mean(change**2 / variance)) > STEADY**2 or change @ change > first @ first
        lasting = not drifted and stamp_ns - since_ns < 1e9 * LONGER * self.settings.memory_s
        return STEPPED if lasting else ""

    def innovation(self, measurement: GpsVelocity, host: Host) -> Innovation | str:
        """y = v_gps - (v + C (w x l)); where no state is the velocity, H is that of what makes it up."""
        seen = host.core.velocity_at(self.lever_b)
        if isinstance(seen, str):
            return seen
        R, self.swing_n = self.noise(measurement), seen.swing_n
        if seen.noise is not None:
            R = R + seen.noise
        self._factor = self.scatter.noise_factor * correlation_factor(self.since_s(measurement), self.settings.correlation_s)
        return Innovation(measurement.vel_n - seen.vel_n - seen.swing_n, seen.H, self._factor * R, measurement.vel_n, turns=seen.turns)

    def recover(self, measurement: GpsVelocity, innovation: Innovation, host: Host) -> None:
        """Reset the velocity to that of GPS; attitude and biases stay."""
        if host.core.velocity_rows is None:
            super().recover(measurement, innovation, host)
        else:
            reset_to(host, host.core.velocity_rows, innovation.y, innovation.R)


class Bends:
    """Second differences of innovations: what a sensor error makes of them is nearly straight, white noise bends them at every step."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._points: list[tuple[int, np.ndarray]] = []

    def take(self, stamp_ns: int, y: np.ndarray, variance: np.ndarray) -> tuple[float, float] | None:
        """Take an innovation (m,); seconds since the one before and the square of the bend over its variance; None: too few yet."""
        if self._points and not 0 < stamp_ns - self._points[-1][0] <= BEND_NS:
            self._points.clear()
        points = self._points = [*self._points[-2:], (stamp_ns, y.copy())]
        if len(points) < 3:
            return None
        (t0, y0), (t1, y1), _ = points
        share = (stamp_ns - t1) / (t1 - t0)
        bend2 = (y - y1 - share * (y1 - y0)) ** 2 / (2.0 * (1.0 + share + share * share))
        return 1e-9 * (stamp_ns - t1), sum((bend2 / variance).tolist()) / len(y)


GPS_VELOCITY = Sensor("gps", GpsVelocitySettings, each(VelocityAid))
"""The same receiver where position is not estimated."""
GPS = AIDS.register("gps", Sensor("gps", GpsSettings, each(PositionAid, VelocityAid)), __name__)
