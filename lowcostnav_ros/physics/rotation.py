"""Rotations: Hamilton quaternions (scalar first), direction cosine matrices, Euler angles, small rotations.

``q_nb`` and ``C_nb`` take b-coordinates to n-coordinates; Euler angles are heading, then pitch, then roll (3-2-1).  The attitude
error ``phi_n`` is resolved in n and acts from the left: ``C_nb_true = (I + [phi_n x]) C_nb_est``.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel

TWO_PI = 2.0 * math.pi
SMALL_ANGLE = 1.0e-3
"""Rad; below it the series of sin(x)/x and its kin are exact to the last bit and free of 0/0."""
VERTICAL = 1.0e-9
"""Cosine of pitch below which roll and heading are one angle; roll is then called zero."""


@kernel
def wrap(angle):
    """Angle in (-pi, pi]; scalar or array, rad.  Angles already inside come back unchanged to the last bit."""
    return angle - TWO_PI * np.ceil((angle - math.pi) / TWO_PI)


@kernel
def wrap_2pi(angle):
    """Angle in [0, 2 pi); scalar or array, rad."""
    turned = np.mod(angle, TWO_PI)
    return turned * (turned < TWO_PI)  # a tiny negative angle rounds up to a whole turn


@kernel
def skew(v):
    """Matrix [v x], shape (3, 3), with ``skew(v) @ w`` equal to the cross product v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@kernel
def product(p, q):
    """Hamilton product p (x) q as a tuple, which costs a kernel no memory; so do :func:`turn_of`, :func:`rotated` and :func:`rows_of`."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@kernel
def quat_multiply(p, q):
    """Hamilton product p (x) q, shape (4,): the rotation q first, then p."""
    return np.array(product(p, q))


@kernel
def quat_conjugate(q):
    """Conjugate, shape (4,): the inverse rotation of a unit quaternion."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


@kernel
def quat_normalise(q):
    """Unit quaternion along q, shape (4,); a zero quaternion has no direction and gives NaN."""
    return q / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


@kernel
def turn_of(rotvec):
    """Unit quaternion of a rotation vector, rad, as a tuple: the exponential map, exact for any angle."""
    angle2 = rotvec[0] * rotvec[0] + rotvec[1] * rotvec[1] + rotvec[2] * rotvec[2]
    angle = math.sqrt(angle2)
    factor = 0.5 - angle2 / 48.0 + angle2 * angle2 / 3840.0 if angle < SMALL_ANGLE else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), factor * rotvec[0], factor * rotvec[1], factor * rotvec[2]


@kernel
def quat_from_rotvec(rotvec):
    """Unit quaternion, shape (4,), of the rotation vector ``rotvec`` (3,), rad."""
    return np.array(turn_of(rotvec))


@kernel
def rotvec_from_quat(q):
    """Rotation vector, shape (3,), rad, of a unit quaternion: the logarithm, norm at most pi."""
    sign = -1.0 if q[0] < 0.0 else 1.0  # q and -q are one rotation; take the shorter way
    scalar = sign * q[0]
    sine2 = q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    sine = math.sqrt(sine2)
    if sine < SMALL_ANGLE:
        tan2 = sine2 / (scalar * scalar)
        factor = 2.0 / scalar * (1.0 - tan2 / 3.0 + tan2 * tan2 / 5.0)
    else:
        factor = 2.0 * math.atan2(sine, scalar) / sine
    return np.array([sign * factor * q[1], sign * factor * q[2], sign * factor * q[3]])


@kernel
def rows_of(q):
    """Rows of the rotation matrix of a unit quaternion, as tuples."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        (w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )


@kernel
def quat_to_dcm(q):
    """Rotation matrix of a unit quaternion, shape (3, 3): ``q_nb`` gives ``C_nb``."""
    return np.array(rows_of(q))


@kernel
def dcm_to_quat(dcm):
    """Unit quaternion, shape (4,), scalar not negative, of a rotation matrix.

    The largest of the four components is found first (from the trace and the diagonal), so no rotation is near a division
    by zero; the scalar-first branch alone fails at half turns.
    """
    trace = dcm[0, 0] + dcm[1, 1] + dcm[2, 2]
    q = np.empty(4)
    if trace >= max(dcm[0, 0], dcm[1, 1], dcm[2, 2]):
        q[0] = 1.0 + trace
        q[1] = dcm[2, 1] - dcm[1, 2]
        q[2] = dcm[0, 2] - dcm[2, 0]
        q[3] = dcm[1, 0] - dcm[0, 1]
    else:
        i = 0
        if dcm[1, 1] > dcm[i, i]:
            i = 1
        if dcm[2, 2] > dcm[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = dcm[k, j] - dcm[j, k]
        q[1 + i] = 1.0 + 2.0 * dcm[i, i] - trace
        q[1 + j] = dcm[j, i] + dcm[i, j]
        q[1 + k] = dcm[k, i] + dcm[i, k]
    return quat_normalise(-q if q[0] < 0.0 else q)


@kernel
def euler_to_quat(roll, pitch, heading):
    """Unit quaternion ``q_nb``, shape (4,), of Euler angles in rad (heading clockwise from north, pitch nose up, roll right wing down)."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    ch, sh = math.cos(0.5 * heading), math.sin(0.5 * heading)
    return np.array([cr * cp * ch + sr * sp * sh, sr * cp * ch - cr * sp * sh, cr * sp * ch + sr * cp * sh, cr * cp * sh - sr * sp * ch])


@kernel
def dcm_to_euler(dcm):
    """Euler angles (roll, pitch, heading) of ``C_nb``, rad: roll in (-pi, pi], pitch in [-pi/2, pi/2], heading in [0, 2 pi).

    Nose straight up or down only the sum or difference of roll and heading exists; it is reported as heading with roll zero.
    """
    cos_pitch = math.hypot(dcm[2, 1], dcm[2, 2])
    pitch = math.atan2(-dcm[2, 0], cos_pitch)
    if cos_pitch < VERTICAL:
        return 0.0, pitch, wrap_2pi(math.atan2(-dcm[0, 1], dcm[1, 1]))
    return math.atan2(dcm[2, 1], dcm[2, 2]), pitch, wrap_2pi(math.atan2(dcm[1, 0], dcm[0, 0]))


@kernel
def quat_to_euler(q):
    """Euler angles (roll, pitch, heading) of ``q_nb``, rad, in the ranges of :func:`dcm_to_euler`."""
    return dcm_to_euler(quat_to_dcm(q))


@kernel
def euler_to_dcm(roll, pitch, heading):
    """Rotation matrix ``C_nb``, shape (3, 3), of Euler angles in rad."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    ch, sh = math.cos(heading), math.sin(heading)
    return np.array(
        [
            [cp * ch, -cr * sh + sr * sp * ch, sr * sh + cr * sp * ch],
            [cp * sh, cr * ch + sr * sp * sh, -sr * ch + cr * sp * sh],
            [-sp, sr * cp, cr * cp],
        ]
    )


@kernel
def rotated(q, v):
    """Vector turned by a unit quaternion, as a tuple."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    return v[0] + q[0] * tx + q[2] * tz - q[3] * ty, v[1] + q[0] * ty + q[3] * tx - q[1] * tz, v[2] + q[0] * tz + q[1] * ty - q[2] * tx


@kernel
def quat_rotate(q, v):
    """Vector ``v`` (3,) turned by the unit quaternion ``q``: ``q_nb`` takes ``v_b`` to ``v_n``."""
    return np.array(rotated(q, v))


@kernel
def quat_apply_phi_n(q, phi_n):
    """Correct an attitude estimate: ``C_true = exp([phi_n x]) C_est``, the exact form of ``(I + [phi_n x]) C_est``.

    Parameters
    ----------
    q : ndarray, shape (4,)
        Estimated ``q_nb``.
    phi_n : ndarray, shape (3,)
        Attitude error, true relative to estimated, resolved in n, rad.

    Returns
    -------
    ndarray, shape (4,)
        Unit quaternion.
    """
    return quat_normalise(quat_multiply(quat_from_rotvec(phi_n), q))


@kernel
def euler_jacobian_n(roll, pitch, heading):
    """Derivative of (roll, pitch, heading) by the attitude error ``phi_n``, shape (3, 3).

    Rows are roll, pitch, heading; with ``C_true = (I + [phi_n x]) C_est`` the true angles are the estimated ones plus this
    matrix times ``phi_n``.  Singular with the nose straight up or down.  Nothing depends on ``roll``; it is an argument so
    that the three angles of :func:`quat_to_euler` pass straight in.
    """
    ch, sh = math.cos(heading), math.sin(heading)
    tan_pitch, sec_pitch = math.tan(pitch), 1.0 / math.cos(pitch)
    return np.array([[ch * sec_pitch, sh * sec_pitch, 0.0], [-sh, ch, 0.0], [ch * tan_pitch, sh * tan_pitch, 1.0]])


@kernel
def quats_to_euler(quats):
    """Euler angles of many attitudes: (n, 4) to (n, 3), columns roll, pitch, heading, rad."""
    out = np.empty((quats.shape[0], 3))
    for i in range(quats.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = quat_to_euler(quats[i])
    return out


@kernel
def eulers_to_quat(eulers):
    """Unit quaternions of many attitudes: (n, 3) roll, pitch, heading in rad to (n, 4)."""
    out = np.empty((eulers.shape[0], 4))
    for i in range(eulers.shape[0]):
        out[i] = euler_to_quat(eulers[i, 0], eulers[i, 1], eulers[i, 2])
    return out
