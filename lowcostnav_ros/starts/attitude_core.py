"""How the inertial core of the attitude reference begins: with the correlations that its sources cause, so that none counts twice."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, CORE, POS, VEL, InertialCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import quat_rotate, quat_to_dcm
from lowcostnav_ros.starts.first_attitude import FirstAttitude

Place = tuple[float, float, float]
"""Lat, lon, height: rad, rad, m above the ellipsoid."""
POSITION_SIGMA = 1000.0
"""Position is carried for gravity and the earth's rate only; a kilometre is nothing to either."""
MEAN_PLACE = (np.pi / 4.0, 0.0, 0.0)
UNKNOWN_SPEED = 3.0
"""Sigma, m/s, that incidence and heading errors add to a velocity taken from airspeed and attitude."""
HELD_VELOCITY_SIGMA = 0.01


@dataclass(frozen=True)
class PlaceSettings:
    """Where the flight is until a position is received; it gives the magnetic declination, gravity and the earth's rate."""

    lat_lon_deg: list = setting([], "Latitude, longitude; empty: unknown before the first fix.", unit="deg", minimum=-180.0, maximum=180.0)
    height_m: float = setting(0.0, "Height above the ellipsoid.", unit="m", minimum=-1000.0, maximum=30000.0)

    def __post_init__(self) -> None:
        if len(self.lat_lon_deg) not in (0, 2) or (self.lat_lon_deg and abs(self.lat_lon_deg[0]) > 89.0):
            raise SettingsError(f"'place.lat_lon_deg' needs latitude (at most 89) and longitude, or nothing; got {self.lat_lon_deg}.")

    def known(self) -> Place | None:
        """The place, or None where it is not given."""
        return (self.lat_lon_deg[0] * DEGREE, self.lat_lon_deg[1] * DEGREE, self.height_m) if self.lat_lon_deg else None


def begin_core(
    core: InertialCore,
    first: FirstAttitude,
    place: Place | None = None,
    kept: tuple[np.ndarray, np.ndarray] | None = None,
    speed_mps: float = 10.0,
    velocity_floor_mps: float = 0.05,
) -> None:
    """Start the core at a first attitude.

    Parameters
    ----------
    core : InertialCore
    first : FirstAttitude
    place : (lat, lon, height) or None
        Rad, rad, m; unknown counts as 45 degrees of latitude, where gravity and the earth's rate are mean.
    kept : (estimate, covariance) or None
        Accelerometer and gyro biases carried over from before a gap (:func:`sensor_rows`).
    speed_mps : float
        Sigma of a velocity that nothing has measured.
    velocity_floor_mps : float
        Added to the sigma of one that GPS has.
    """
    nav = np.zeros(10)
    nav[0:3] = MEAN_PLACE if place is None else place
    nav[6:10] = first.q_nb
    covariance = np.diag([POSITION_SIGMA**2] * 3 + [speed_mps**2] * 3 + [1.0] * 3)
    if first.gps is not None:
        nav[VEL] = first.gps.vel_n
        covariance[VEL, VEL] = first.gps.cov_n + np.eye(3) * velocity_floor_mps**2
    core.start(first.t_ns, nav, covariance)
    if kept is not None:
        sensors = sensor_rows(core)
        core.estimate[sensors], core.P[sensors, sensors] = kept
    _correlate_attitude(core, first)
    if first.air is not None:
        restart_velocity_from_air(core, first.air, np.zeros(3))


def sensor_rows(core: InertialCore) -> slice:
    """States of the accelerometer and gyro biases."""
    return slice(CORE, core.layout["gyro_bias"].stop)


def hold_position(core: InertialCore, place: Place | None) -> None:
    """Put the core's position, which nothing corrects, back to the place last known, before its drift reaches gravity."""
    core.nav[0:3] = MEAN_PLACE if place is None else place
    kalman.reset_block(core.P, POS, np.eye(3) * POSITION_SIGMA**2, core.history)


def hold_velocity(core: InertialCore) -> None:
    """Without any measure of velocity, count it from zero: only its change over the next span matters."""
    restart_velocity(core, np.zeros(3), np.eye(3) * HELD_VELOCITY_SIGMA**2)


def restart_velocity(core: InertialCore, vel_n: np.ndarray, covariance: np.ndarray) -> None:
    """Set the velocity over ground (3,), m/s; what it was counted from zero means nothing beside a measured one."""
    core.settle()
    core.nav[VEL] = vel_n
    kalman.reset_block(core.P, VEL, covariance, core.history)


def _correlate_attitude(core: InertialCore, first: FirstAttitude) -> None:
    """Covariance of the first attitude with what made it: accelerometer biases, and the slow error of the magnetic heading.

    Level, ``-[f_n x] phi = C db_a + noise`` gives phi_N = (C db)_E / g and phi_E = -(C db)_N / g, and a magnetic heading that is too large
    by b leaves phi_D = -b.  Without these terms the first aids would credit the same error to attitude and bias separately.
    """
    P, layout = core.P, core.layout
    C = quat_to_dcm(first.q_nb)
    by_bias = np.vstack((C[1], -C[0], np.zeros(3))) / STANDARD_GRAVITY
    accel = layout["accel_bias"]
    own = np.diag([first.tilt_sigma**2, first.tilt_sigma**2, first.heading_sigma**2])
    P[ATT, ATT] = by_bias @ P[accel, accel] @ by_bias.T + own
    P[ATT, accel] = by_bias @ P[accel, accel]
    P[accel, ATT] = P[ATT, accel].T
    if first.is_magnetic and "heading_bias" in layout:
        bias = layout["heading_bias"].start
        P[8, 8] += P[bias, bias]
        P[8, bias] = P[bias, 8] = -P[bias, bias]


def restart_velocity_from_air(core: InertialCore, air: AirVelocity, wind_n: np.ndarray, doubt_mps: float = 0.0) -> None:
    """Set the velocity over ground to airspeed plus wind; its error is the wind's, correlated with it so, and ``doubt_mps`` ahead."""
    P, layout = core.P, core.layout
    tas = float(np.linalg.norm(air.vel_b))
    core.nav[VEL] = quat_rotate(core.nav[6:10], np.array([tas, 0.0, 0.0])) + wind_n
    rows = np.r_[layout["wind"], layout["updraught"]]
    wind = P[np.ix_(rows, rows)]
    heading_part = np.diag([1.0, 1.0, 0.0]) * P[8, 8] * tas**2
    ahead_n = doubt_mps * core.C_nb()[:, 0]
    kalman.reset_block(P, VEL, wind + np.eye(3) * UNKNOWN_SPEED**2 + heading_part + np.outer(ahead_n, ahead_n), core.history)
    P[VEL, rows] = wind
    P[rows, VEL] = wind
