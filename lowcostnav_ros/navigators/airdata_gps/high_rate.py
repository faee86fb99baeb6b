"""The second filter of the cascade: position and velocity on GPS and the corrected air-data velocity, at the rate of the attitude.

Gains by a Riccati equation in flight (multirate) or the four that it converges to, stored (fixed_gain).  In metres the gains are the same
at every latitude; in degrees those to longitude go with 1 / cos(latitude) and the one from longitude to velocity with cos(latitude).
"""

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity
from lowcostnav_ros.estimation import multirate
from lowcostnav_ros.navigators.airdata_gps.settings import CascadeSettings
from lowcostnav_ros.physics.earth import difference_n, displace


class HighRateFilter:
    """Three axes of one filter.

    Attributes
    ----------
    nav : ndarray (3,)
        lat, lon [rad], height [m].
    vel_n : ndarray (3,)
    t_ns : int
    """

    def __init__(self, settings: CascadeSettings, fixed: bool) -> None:
        s, self._settings, self._fixed = settings, settings, fixed
        gps = s.gps_m**2, s.position_mps**2
        self._model = multirate.position_velocity(s.step_s, s.position_step_m**2, s.velocity_step_mps**2, gps, s.air_mps**2, s.gps_steps)
        self._cycle = multirate.steady_cycle(self._model)
        self._error = multirate.response(self._model, self._cycle.gains, s.error_tau_s / s.step_s)
        self.nav, self.vel_n, self.t_ns = np.zeros(3), np.zeros(3), 0
        self._P, self._phase = self._cycle.prior[0], 0
        self._fix: tuple[GpsPosition, GpsVelocity] | None = None
        self._position: GpsPosition | None = None

    def begin(self, t_ns: int, nav: np.ndarray, vel_n: np.ndarray) -> None:
        """Begin at a place and velocity."""
        self.nav, self.vel_n, self.t_ns, self._phase = nav.copy(), vel_n.copy(), t_ns, 0

    def see(self, measurement: GpsPosition | GpsVelocity) -> None:
        """Take GPS in; it is used at the next step."""
        if isinstance(measurement, GpsPosition):
            self._position = measurement
        elif self._position is not None and self._position.stamp_ns == measurement.stamp_ns:
            self._fix = self._position, measurement

    def step(self, t_ns: int, air_vel_n: np.ndarray) -> None:
        """Move to a time and take the corrected air-data velocity (3,) of it in, and GPS if there is any since the last step."""
        dt = 1e-9 * (t_ns - self.t_ns)
        if dt <= 0.0:
            return
        self.nav, self.t_ns = self._displaced(self.vel_n * dt), t_ns
        fix, self._fix = self._fix, None
        self._phase = 0 if fix is not None else min(self._phase + 1, self._model.steps - 1)  # without GPS the last gain stays
        K = self._gain(dt)
        y = [air_vel_n - self.vel_n]
        if fix is not None:
            age = 1e-9 * (t_ns - fix[0].stamp_ns)
            y = [
                difference_n(fix[0].lat, fix[0].lon, fix[0].height, self.nav[0], self.nav[1], self.nav[2]) + age * fix[1].vel_n,
                fix[1].vel_n - self.vel_n,
                *y,
            ]
        moved, turned = K @ np.array(y)
        self.nav, self.vel_n = self._displaced(moved), self.vel_n + turned

    def ahead(self, t_ns: int) -> np.ndarray:
        """Place (3,) at a later time."""
        return self._displaced(self.vel_n * 1e-9 * max(t_ns - self.t_ns, 0))

    def _displaced(self, d_n: np.ndarray) -> np.ndarray:
        return np.array(displace(self.nav[0], self.nav[1], self.nav[2], d_n))

    def _gain(self, dt: float) -> np.ndarray:
        """The gain of the phase: stored, or from the covariance, which is carried on."""
        if self._fixed:
            self._P = self._cycle.posterior[self._phase]
            return self._cycle.gains[self._phase]
        prior = self._model.A @ self._P @ self._model.A.T + self._model.Q * max(1.0, dt / self._settings.step_s)
        K, self._P = multirate.update(prior, *self._model.measured(self._phase))
        return K

    def covariance(self, air_velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Covariances (3, 3) of position and velocity: of the filter, and what a correlated error of the air-data velocity (3, 3) adds."""
        return self._P[0, 0] * np.eye(3) + self._error[0, 0] * air_velocity, self._P[1, 1] * np.eye(3) + self._error[1, 1] * air_velocity
