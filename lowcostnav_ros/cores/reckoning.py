"""The state of dead reckoning: mean and covariance, and how both move between measurements."""

import copy
import math

import numpy as np

from lowcostnav_ros.cores import reckoning_model as model
from lowcostnav_ros.cores.reckoning_inputs import HeldInputs
from lowcostnav_ros.cores.reckoning_model import CLIMB, CORE, DEG, NM, POS
from lowcostnav_ros.cores.reckoning_settings import DeadReckoningSettings
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Kind
from lowcostnav_ros.estimation.station_slots import StationSlots
from lowcostnav_ros.physics.earth import displace

LOST_S = 10.0
"""Without attitude or airspeed the unknown velocity is as large as the last airspeed and stays correlated this long."""

SLOWEST_MPS = 1.0
"""Speed at which a range bias still ages when the aircraft stands."""


class DeadReckoningState:
    """Mean and covariance.

    Attributes
    ----------
    layout : Layout
    nav : ndarray (3,)
        lat, lon [rad], height [m above the ellipsoid].
    estimate : ndarray (n,)
        Estimates of the states in ``layout``; the first three are unused (they live in ``nav``).
    P : ndarray (n, n)
    t_ns : int or None
        Time of the mean; None before the start.
    wind_rows : ndarray (2, n)
        Sum all that makes up the wind, north and east.
    """

    def __init__(self, settings: DeadReckoningSettings) -> None:
        self.settings = settings
        self.layout = layout = model.layout_of(settings)
        self.nav, self.estimate, self.P = np.zeros(3), np.zeros(layout.size), layout.initial_covariance()
        self.t_ns: int | None = None
        self.guard_actions = 0
        self._sums = np.zeros(7)
        self._rate, self._psd = layout.rate.copy(), layout.psd.copy()
        self._rate[CLIMB] = 1.0 / settings.height.climb_tau_s
        self._mean_rate = np.zeros(layout.size) if settings.model == "reduced" else self._rate
        self._kind_rows = {kind: (layout.kind == kind).astype(float) for kind in Kind}
        self.wind_rows = np.array([(layout.kind == Kind.WIND) & (layout.axis == axis) for axis in range(2)], dtype=float)
        self._floor, self._ceiling = 1e-12 * np.maximum(layout.sigma0, 1e-9) ** 2, np.full(layout.size, 1e14)
        considered = ["dme_bias"] if settings.dme.bias == "consider" else []
        self.free_for_ranges = 1.0 - layout.mask("baro_bias", *considered)
        self.free_for_ranges[2:CORE] = 0.0
        self._range_slots = StationSlots(layout.get("dme_bias"), settings.dme.bias_nm * NM)

    def start(self, t_ns: int, nav: np.ndarray, cov_n: np.ndarray) -> None:
        """Begin at a position (lat, lon [rad], height [m]) with its covariance (3, 3), NED m^2."""
        self.nav[:], self.t_ns = nav, int(t_ns)
        kalman.reset_block(self.P, POS, cov_n)

    def know_wind(self, wind_n: np.ndarray, sigma: float) -> None:
        """Take a wind (2,), m/s, as known to ``sigma``: one measurement of all that makes up the wind."""
        H = self.wind_rows
        self.P[:] = 0.5 * (self.P + self.P.T)
        y = np.asarray(wind_n, float) - H @ self.estimate
        self.correct(kalman.update(self.P, y, H, max(sigma, 1e-6) ** 2 * np.eye(2), np.ones(self.layout.size)))

    def branch(self) -> "DeadReckoningState":
        """Return a copy whose mean may be moved on alone; the covariance is shared and must not be settled."""
        twin = copy.copy(self)
        twin.nav, twin.estimate, twin._sums = self.nav.copy(), self.estimate.copy(), self._sums.copy()
        return twin

    def move(self, held: HeldInputs, to_ns: int) -> None:
        """Move the mean to ``to_ns`` with what is held; the covariance follows in :meth:`settle`."""
        if to_ns <= self.t_ns:
            return
        layout, air_n = self.layout, held.air_n((self.t_ns + to_ns) // 2)
        dt = 1e-9 * (to_ns - self.t_ns)
        args = (self._mean_rate, self._rate[CLIMB], air_n, held.airborne, dt, self._sums)
        model.move(self.nav, self.estimate, layout.kind, layout.axis, *args)
        self.t_ns = to_ns

    def settle(self, held: HeldInputs) -> None:
        """Bring the covariance to the time of the mean."""
        if self._sums[0] <= 0.0:
            return
        self._pace_range_biases()
        heading, airspeed = (self.settings.heading.noise_deg * DEG) ** 2, self.settings.airspeed.noise_mps**2
        layout = self.layout
        model.carry_covariance(self.P, self._sums, layout.kind, layout.axis, self._rate, self._psd, heading, airspeed, self._walk(held))

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,): the estimate moves, the error state is zero again."""
        self.nav[:] = displace(*self.nav, dx[POS])
        self.estimate[CLIMB:] += dx[CLIMB:]
        self.guard_actions += kalman.guard_covariance(self.P, self._floor, self._ceiling)

    def silent(self, held: HeldInputs) -> str:
        """Which of attitude and airspeed is too old to move on, in words; empty when both are fresh."""
        return held.silent(self.t_ns, self.settings.heading.timeout_s, self.settings.airspeed.timeout_s)

    def totals(self) -> np.ndarray:
        """Return the estimates summed by what they act on (5,): wind north, east, heading bias, airspeed scale, airspeed bias."""
        return model.sum_estimates(self.estimate, self.layout.kind, self.layout.axis)

    def velocity(self, held: HeldInputs) -> tuple[np.ndarray, np.ndarray]:
        """Believed velocity over ground (3,), m/s NED, now, and its derivative (3, n) by the error states."""
        out, air = np.zeros(3), np.zeros(2)
        if held.airborne:
            total = self.totals()
            air = model.corrected_air(held.air_n(self.t_ns), total)
            out[0:2] = air + total[0:2]
        out[2] = self.estimate[CLIMB]
        return out, model.coupling(air[0], air[1], float(held.airborne), self.layout.kind, self.layout.axis)

    def velocity_noise(self, held: HeldInputs) -> np.ndarray:
        """What the states do not explain of an instantaneous velocity (3, 3): turbulence, white heading and airspeed noise."""
        air = held.air_n(self.t_ns)
        settings = self.settings
        heading = settings.heading.noise_deg * DEG
        return model.unmodelled_velocity(air, heading, settings.airspeed.noise_mps, settings.wind.gust_mps)

    def wind_covariance(self) -> np.ndarray:
        """Covariance (2, 2) of the whole wind, (m/s)^2."""
        return self.wind_rows @ self.P @ self.wind_rows.T

    def horizontal_sigma(self) -> float:
        """Believed horizontal error, m: root of the sum of both variances."""
        return math.sqrt(self.P[0, 0] + self.P[1, 1])

    def sigma_of(self, kind: Kind) -> float:
        """Sigma of the sum of all states of one kind."""
        row = self._kind_rows[kind]
        return math.sqrt(max(row @ self.P @ row, 0.0))

    def range_bias_index(self, station: str) -> int | None:
        """State that holds the range bias of a station, None when biases are not states; a new station takes the longest idle slot."""
        return self._range_slots.take(station, self.t_ns, self.P, self.estimate)

    def _walk(self, held: HeldInputs) -> float:
        """Density of the unknown motion, m^2/s: turbulence in flight, taxiing on the ground, all of the airspeed when inputs are gone.

        Airspeed that collapses where no GPS sees a landing may be a blocked pitot tube: the aircraft may fly as fast as before.
        """
        settings = self.settings
        if self.silent(held) or not held.airborne:
            return max(2.0 * LOST_S * held.fastest**2, settings.ground_walk_mps**2)
        return 2.0 * settings.wind.gust_mps**2 * settings.wind.gust_tau_s

    def _pace_range_biases(self) -> None:
        """Range biases vary with the distance flown, not with time."""
        if "dme_bias" in self.layout:
            rows, dme = self.layout["dme_bias"], self.settings.dme
            speed = math.hypot(self._sums[1], self._sums[2]) / self._sums[0]
            self._rate[rows] = max(speed, SLOWEST_MPS) / (dme.bias_distance_nm * NM)
            self._psd[rows] = 2.0 * (dme.bias_nm * NM) ** 2 * self._rate[rows]
