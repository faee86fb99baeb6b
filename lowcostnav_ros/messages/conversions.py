"""The one place where ENU/FLU of ROS messages and NED/FRD of the estimators meet.

World axes swap the first two and negate the third, body axes negate the second and third.  Both maps are their own inverse, so one
function serves both directions: what it makes of NED is ENU and what it makes of ENU is NED.  Inside quaternions are scalar first;
:func:`quat_from_ros` and :func:`quat_to_ros` change order and rotate on both sides.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matmul, matmul_transposed, matvec, turned
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import dcm_to_quat, quat_to_dcm, wrap, wrap_2pi

HALF_SQRT2 = math.sqrt(0.5)

NOT_ESTIMATED = 1.0e12
"""Variance an Odometry carries for what its navigator does not estimate; a dead reckoner's sigma can exceed a kilometre."""

_WORLD_PERMUTATION = np.array([4, 3, 5, 1, 0, 2, 7, 6, 8])
_WORLD_SIGN = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
_BODY_SIGN = np.array([1.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0])


def swap_world(vector: np.ndarray) -> np.ndarray:
    """Turn NED components into ENU ones or back; shape (..., 3)."""
    vector = np.asarray(vector, dtype=float)
    out = np.empty_like(vector)
    out[..., 0], out[..., 1], out[..., 2] = vector[..., 1], vector[..., 0], -vector[..., 2]
    return out


def swap_body(vector: np.ndarray) -> np.ndarray:
    """Turn FRD components into FLU ones or back; shape (..., 3)."""
    vector = np.asarray(vector, dtype=float)
    out = np.negative(vector)
    out[..., 0] = vector[..., 0]
    return out


def swap_world_cov(cov: np.ndarray) -> np.ndarray:
    """Turn a (3, 3) NED covariance into ENU or back: rotated on both sides, cross terms with it."""
    return (np.ravel(cov)[_WORLD_PERMUTATION] * _WORLD_SIGN).reshape(3, 3)


def swap_world_covs(flat: np.ndarray) -> np.ndarray:
    """:func:`swap_world_cov` of rows (n, 9), to the same bits."""
    return flat[:, _WORLD_PERMUTATION] * _WORLD_SIGN


def swap_body_covs(flat: np.ndarray) -> np.ndarray:
    """:func:`swap_body_cov` of rows (n, 9), to the same bits."""
    return flat * _BODY_SIGN


def swap_body_cov(cov: np.ndarray) -> np.ndarray:
    """Turn a (3, 3) FRD covariance into FLU or back."""
    return (np.ravel(cov) * _BODY_SIGN).reshape(3, 3)


def quat_from_ros(x: float, y: float, z: float, w: float) -> np.ndarray:
    """Turn a ROS orientation (FLU to ENU; x, y, z, w) into ``q_nb`` (FRD to NED; scalar first), shape (4,), normalised.

    The product q(NED<-ENU) q(FLU to ENU) q(FLU<-FRD) worked out; both outer rotations are half turns.
    """
    k = HALF_SQRT2 / math.sqrt(w * w + x * x + y * y + z * z)
    return np.array([k * (w + z), k * (x + y), k * (x - y), k * (w - z)])


def quats_from_ros(xyzw: np.ndarray) -> np.ndarray:
    """:func:`quat_from_ros` of rows (n, 4), to the same bits."""
    x, y, z, w = xyzw.T
    k = HALF_SQRT2 / np.sqrt(w * w + x * x + y * y + z * z)
    return np.stack([k * (w + z), k * (x + y), k * (x - y), k * (w - z)], axis=1)


def quat_to_ros(q_nb: np.ndarray) -> tuple[float, float, float, float]:
    """Turn ``q_nb`` (4,), scalar first, FRD to NED, into the ROS orientation (x, y, z, w), FLU to ENU, normalised."""
    w, x, y, z = (float(part) for part in q_nb)
    k = HALF_SQRT2 / math.sqrt(w * w + x * x + y * y + z * z)
    return k * (x + y), k * (x - y), k * (w - z), k * (w + z)


def quats_to_ros(q_nb: np.ndarray) -> np.ndarray:
    """:func:`quat_to_ros` of rows (n, 4), to the same bits."""
    w, x, y, z = q_nb.T
    k = HALF_SQRT2 / np.sqrt(w * w + x * x + y * y + z * z)
    return np.stack([k * (x + y), k * (x - y), k * (w - z), k * (w + z)], axis=1)


def heading_of_yaw(yaw: float) -> float:
    """Return the true heading, rad in [0, 2 pi), of a ROS yaw (0 east, counter-clockwise)."""
    return wrap_2pi(0.5 * math.pi - yaw)


def yaw_of_heading(heading: float) -> float:
    """Return the ROS yaw, rad in (-pi, pi], of a true heading (0 north, clockwise)."""
    return wrap(0.5 * math.pi - heading)


@kernel
def map_from_local(lat, lon, height, q_nb, cov_pos, cov_att, xyz_0, C_0e):
    """Express a pose in the map frame, a tangent plane at its origin.

    North at the aircraft is not north at the origin (0.9 deg of tilt and about as much convergence in 100 km), so the attitude and the
    covariances are turned as well as the position.

    Returns
    -------
    position_enu : ndarray (3,)
    q_map : ndarray (4,)
        FRD to the origin's NED, scalar first.
    cov_pos_enu, cov_att_enu : ndarray (3, 3)
    """
    turn = matmul_transposed(C_0e, dcm_ne(lat, lon))
    ned = matvec(C_0e, geodetic_to_ecef(lat, lon, height) - xyz_0)
    swap = matmul(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), turn)
    position = np.array([ned[1], ned[0], -ned[2]])
    return position, dcm_to_quat(matmul(turn, quat_to_dcm(q_nb))), turned(swap, cov_pos), turned(swap, cov_att)


@kernel
def body_velocity(vel_n, cov_vel, q_nb):
    """Return velocity (3,) and covariance (3, 3) in FLU axes of the body, from NED ones and ``q_nb``."""
    C_fn = quat_to_dcm(q_nb).T.copy()
    C_fn[1] *= -1.0
    C_fn[2] *= -1.0
    return matvec(C_fn, vel_n), turned(C_fn, cov_vel)


@kernel
def maps_from_local(places, q_nb, cov_pos, cov_att, vel_n, cov_vel, xyz_0, C_0e):
    """:func:`map_from_local` and :func:`body_velocity` of n rows: positions, ``q_map`` (n, 4), velocities (n, 3), variances (n, 9)."""
    n = len(places)
    positions, q_map, velocities, variances = np.empty((n, 3)), np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 9))
    for k in range(n):
        lat, lon, height = places[k]
        positions[k], q_map[k], first, second = map_from_local(lat, lon, height, q_nb[k], cov_pos[k], cov_att[k], xyz_0, C_0e)
        velocities[k], third = body_velocity(vel_n[k], cov_vel[k], q_nb[k])
        for i in range(3):
            variances[k, i], variances[k, 3 + i], variances[k, 6 + i] = first[i, i], second[i, i], third[i, i]
    return positions, q_map, velocities, variances


@kernel
def local_from_map(position_enu, q_map, cov_pos_enu, cov_att_enu, xyz_0, C_0e):
    """Undo :func:`map_from_local`: returns (lat, lon, height), ``q_nb`` (4,), ``cov_pos``, ``cov_att`` (3, 3) NED at the aircraft."""
    ned = np.array([position_enu[1], position_enu[0], -position_enu[2]])
    lat, lon, height = ecef_to_geodetic(xyz_0 + matvec(C_0e.T, ned))
    turn = matmul_transposed(dcm_ne(lat, lon), C_0e)
    swap = matmul(turn, np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
    return (lat, lon, height), dcm_to_quat(matmul(turn, quat_to_dcm(q_map))), turned(swap, cov_pos_enu), turned(swap, cov_att_enu)


@kernel
def locals_from_map(positions, q_map, cov_pos, cov_att, vel_flu, cov_vel, xyz_0, C_0e):
    """:func:`local_from_map` and :func:`local_velocity` of n rows: places (n, 3), ``q_nb`` (n, 4), velocities (n, 3), three covariances."""
    n = len(positions)
    places, q_nb, vel_n = np.empty((n, 3)), np.empty((n, 4)), np.empty((n, 3))
    covariances = np.empty((3, n, 3, 3))
    for k in range(n):
        place, q_nb[k], covariances[0, k], covariances[2, k] = local_from_map(positions[k], q_map[k], cov_pos[k], cov_att[k], xyz_0, C_0e)
        places[k, 0], places[k, 1], places[k, 2] = place
        vel_n[k], covariances[1, k] = local_velocity(vel_flu[k], cov_vel[k], q_nb[k])
    return places, q_nb, vel_n, covariances


@kernel
def local_velocity(vel_flu, cov_flu, q_nb):
    """Undo :func:`body_velocity`: returns ``vel_n`` (3,) and its covariance (3, 3), NED."""
    C_nf = quat_to_dcm(q_nb)
    C_nf[:, 1] *= -1.0
    C_nf[:, 2] *= -1.0
    return matvec(C_nf, vel_flu), turned(C_nf, cov_flu)
