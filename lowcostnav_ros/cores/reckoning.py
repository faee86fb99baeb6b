"""The reckoning core: airspeed along the heading plus wind, with mean and covariance, and how both move between measurements."""

import copy
import math

import numpy as np

from lowcostnav_ros.cores import reckoning_model as model
from lowcostnav_ros.cores.reckoning_inputs import HeldInputs
from lowcostnav_ros.cores.reckoning_model import CLIMB, CORE, DEG, POS
from lowcostnav_ros.cores.reckoning_settings import ReckoningSettings
from lowcostnav_ros.cores.views import VelocitySeen
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.rotation import quat_rotate

LOST_S = 10.0
"""Without attitude or airspeed the unknown velocity is as large as the last airspeed and stays correlated this long."""


class ReckoningCore:
    """Mean and covariance, and the attitude and air data that carry them.

    Attributes
    ----------
    layout : Layout
    held : HeldInputs
        Last attitude and air data.
    nav : ndarray (3,)
        lat, lon [rad], height [m above the ellipsoid].
    estimate : ndarray (n,)
        Estimates of the states in ``layout``; the first three are unused (they live in ``nav``).
    P : ndarray (n, n)
    t_ns : int or None
        Time of the mean; None before the start.
    wind_rows : ndarray (2, n)
        Sum all that makes up the wind, north and east.
    ranging : ndarray (n,)
        1 for states that a range, a bearing or a horizontal fix may move: all but the vertical channel and what is only considered.
    """

    velocity_rows = None

    def __init__(self, settings: ReckoningSettings, layout: Layout) -> None:
        self.settings, self.layout, self.held = settings, layout, HeldInputs()
        self.nav, self.estimate, self.P = np.zeros(3), np.zeros(layout.size), layout.initial_covariance()
        self.t_ns: int | None = None
        self.guard_actions = 0
        self._sums = np.zeros(7)
        self._mean_rate = np.zeros(layout.size) if settings.model == "reduced" else layout.rate
        self.wind_rows = layout.components(Kind.WIND, 2)
        self._floor, self._ceiling = 1e-12 * np.maximum(layout.sigma0, 1e-9) ** 2, np.full(layout.size, 1e14)
        self.ranging = (layout.kind != Kind.HELD).astype(float)
        self.ranging[2:CORE] = 0.0

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

    def branch(self) -> "ReckoningCore":
        """Return a copy whose mean and inputs may be moved on alone; the covariance is shared and must not be settled."""
        twin = copy.copy(self)
        twin.nav, twin.estimate, twin._sums, twin.held = self.nav.copy(), self.estimate.copy(), self._sums.copy(), copy.copy(self.held)
        return twin

    def move(self, to_ns: int) -> None:
        """Move the mean to ``to_ns`` with what is held; the covariance follows in :meth:`settle`."""
        if to_ns <= self.t_ns:
            return
        layout, air_n = self.layout, self.held.air_n((self.t_ns + to_ns) // 2)
        dt = 1e-9 * (to_ns - self.t_ns)
        args = (self._mean_rate, layout.rate[CLIMB], air_n, self.held.airborne, dt, self._sums)
        model.move(self.nav, self.estimate, layout.kind, layout.axis, *args)
        self.t_ns = to_ns

    def settle(self) -> None:
        """Bring the covariance to the time of the mean."""
        sums, layout, settings = self._sums, self.layout, self.settings
        if sums[0] <= 0.0:
            return
        layout.pace(math.hypot(sums[1], sums[2]) / sums[0])
        heading, airspeed = (settings.heading.noise_deg * DEG) ** 2, settings.airspeed.noise_mps**2
        model.carry_covariance(self.P, sums, layout.kind, layout.axis, layout.rate, layout.psd, heading, airspeed, self._walk())

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,): the estimate moves, the error state is zero again."""
        self.nav[:] = displace(*self.nav, dx[POS])
        self.estimate[CLIMB:] += dx[CLIMB:]
        self.guard_actions += kalman.guard_covariance(self.P, self._floor, self._ceiling)

    def timed_out(self, t_ns: int | None = None) -> str:
        """Which of attitude and airspeed is too old to move on, now or at ``t_ns``, in words; empty when both are fresh."""
        settings = self.settings
        return self.held.timed_out(self.t_ns if t_ns is None else t_ns, settings.heading.timeout_s, settings.airspeed.timeout_s)

    def totals(self) -> np.ndarray:
        """Return the estimates summed by what they act on (5,): wind north, east, heading bias, airspeed scale, airspeed bias."""
        return model.sum_estimates(self.estimate, self.layout.kind, self.layout.axis)

    def velocity(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimated velocity over ground (3,), m/s NED, now, its derivative (3, n) by the error states, and what they do not explain of it.

        The last (3, 3) is turbulence and white heading and airspeed noise.
        """
        settings, held, layout, air_n = self.settings, self.held, self.layout, self.held.air_n(self.t_ns)
        out, air = np.zeros(3), np.zeros(2)
        if held.airborne:
            total = self.totals()
            air = model.corrected_air(air_n, total)
            out[0:2] = air + total[0:2]
        out[2] = self.estimate[CLIMB]
        noise = model.unmodelled_velocity(air_n, settings.heading.noise_deg * DEG, settings.airspeed.noise_mps, settings.wind.gust_mps)
        return out, model.coupling(air[0], air[1], float(held.airborne), layout.kind, layout.axis), noise

    def dynamics(self) -> np.ndarray:
        """Continuous error dynamics F (n, n): vertical velocity, wind, heading and airspeed errors move position, each state decays."""
        F = -np.diag(self.layout.rate)
        F[:3] += self.velocity()[1]
        return F

    def wind_covariance(self) -> np.ndarray:
        """Covariance (2, 2) of the whole wind, (m/s)^2."""
        return self.wind_rows @ self.P @ self.wind_rows.T

    def horizontal_sigma(self) -> float:
        """Estimated horizontal error, m: root of the sum of both variances."""
        return math.sqrt(self.P[0, 0] + self.P[1, 1])

    def sigmas(self) -> np.ndarray:
        """Sigmas (3,) of heading bias, rad, airspeed scale and airspeed bias, m/s, each the sum of its states."""
        return model.sigmas_of_sums(self.P, self.layout.kind)

    def _walk(self) -> float:
        """Density of the unknown motion, m^2/s: turbulence in flight, taxiing on the ground, all of the airspeed when inputs are gone.

        Airspeed that collapses where no GPS sees a landing may be a blocked pitot tube: the aircraft may fly as fast as before.
        """
        settings = self.settings
        if self.timed_out() or not self.held.airborne:
            return max(2.0 * LOST_S * self.held.fastest**2, settings.ground_walk_mps**2)
        return 2.0 * settings.wind.gust_mps**2 * settings.wind.gust_tau_s

    # views of aids -----------------------------------------------------------------------------------------------------------

    @property
    def speed_mps(self) -> float:
        """True airspeed as measured, m/s."""
        return self.held.speed

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Lever arm (3,), m, turned to n by the attitude held."""
        return quat_rotate(self.held.q_nb, lever_b)

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""
        return height - (self.nav[2] + bias)

    def velocity_at(self, lever_b: np.ndarray) -> VelocitySeen | str:
        """Velocity of an antenna: air-relative velocity plus wind, and what the lever arm adds; unknown without fresh inputs in flight."""
        if not self.held.airborne:
            return "below the minimum airspeed"
        outdated = self.timed_out()
        if outdated:
            return outdated
        vel_n, H, noise = self.velocity()
        swing_n = quat_rotate(self.held.q_nb, np.cross(self.held.rate_b, lever_b)) if lever_b.any() else np.zeros(3)
        return VelocitySeen(vel_n, swing_n, H, noise, self.settings.wind.gust_tau_s)

    def wind_n(self) -> np.ndarray:
        """Estimated wind (2,), m/s, north and east."""
        return self.totals()[0:2]
