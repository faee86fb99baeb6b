"""How the inertial core of the attitude reference begins: with honest correlations, so that nothing is believed twice."""

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, CORE, POS, VEL, InertialCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.navigators.ahrs.settings import AhrsSettings, PlaceSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import quat_rotate, quat_to_dcm
from lowcostnav_ros.starts.first_attitude import FirstAttitude

POSITION_SIGMA = 1000.0
"""Position is carried for gravity and the earth's rate only; a kilometre is nothing to either."""
MEAN_PLACE = (np.pi / 4.0, 0.0, 0.0)
UNKNOWN_SPEED = 3.0
"""Sigma, m/s, that incidence and heading errors add to a velocity taken from airspeed and attitude."""


def begin_core(
    core: InertialCore,
    settings: AhrsSettings,
    first: FirstAttitude,
    place: tuple[float, float, float] | None,
    kept: tuple[np.ndarray, np.ndarray] | None,
) -> None:
    """Start the core at a first attitude.

    Parameters
    ----------
    core : InertialCore
    settings : AhrsSettings
    first : FirstAttitude
    place : (lat, lon, height) or None
        Rad, rad, m; unknown counts as 45 degrees of latitude, where gravity and the earth's rate are mean.
    kept : (estimate, covariance) or None
        Accelerometer and gyro biases carried over from before a gap.
    """
    layout = core.layout
    nav = np.zeros(10)
    nav[0:3] = MEAN_PLACE if place is None else place
    nav[6:10] = first.q_nb
    covariance = np.diag([POSITION_SIGMA**2] * 3 + [settings.alignment.track_speed_mps**2] * 3 + [1.0] * 3)
    if first.gps is not None:
        nav[VEL] = first.gps.vel_n
        covariance[VEL, VEL] = first.gps.cov_n + np.eye(3) * settings.gps.velocity_floor_mps**2
    core.start(first.t_ns, nav, covariance)
    if kept is not None:
        sensors = slice(CORE, layout["gyro_bias"].stop)
        core.estimate[sensors], core.P[sensors, sensors] = kept
    _correlate_attitude(core, first)
    if first.air is not None:
        restart_velocity_from_air(core, first.air, np.zeros(3))


def hold_position(core: InertialCore, place: tuple[float, float, float] | None) -> None:
    """Put the core's position, which nothing corrects, back to the place last known, before its drift reaches gravity."""
    core.nav[0:3] = MEAN_PLACE if place is None else place
    kalman.reset_block(core.P, POS, np.eye(3) * POSITION_SIGMA**2)


def configured_place(place: PlaceSettings) -> tuple[float, float, float] | None:
    """Place of the settings as (lat, lon, height) in rad, rad, m, or None."""
    return (place.lat_lon_deg[0] * DEGREE, place.lat_lon_deg[1] * DEGREE, place.height_m) if place.lat_lon_deg else None


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
    if first.is_magnetic:
        bias = layout["heading_bias"].start
        P[8, 8] += P[bias, bias]
        P[8, bias] = P[bias, 8] = -P[bias, bias]


def restart_velocity_from_air(core: InertialCore, air: AirVelocity, wind_n: np.ndarray) -> None:
    """Set the velocity over ground to airspeed plus wind; its error is the wind's, and is correlated with it so."""
    P, layout = core.P, core.layout
    tas = float(np.linalg.norm(air.vel_b))
    core.nav[VEL] = quat_rotate(core.nav[6:10], np.array([tas, 0.0, 0.0])) + wind_n
    wind = slice(layout["wind"].start, layout["updraught"].stop)
    heading_part = np.diag([1.0, 1.0, 0.0]) * P[8, 8] * tas**2
    kalman.reset_block(P, VEL, P[wind, wind] + np.eye(3) * UNKNOWN_SPEED**2 + heading_part)
    P[VEL, wind] = P[wind, wind]
    P[wind, VEL] = P[wind, wind]
