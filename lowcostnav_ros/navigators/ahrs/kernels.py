"""Compiled loops over inertial samples that only the attitude reference needs: the alignment window and the manoeuvre switch.

Both give the same result however the samples are cut into blocks.
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.rotation import quat_from_rotvec, quat_multiply, quat_normalise, quat_rotate

WINDOW_SIZE = 11


@kernel
def gather_window(t_ns, window, stamps, f, w, start, limit_ns):
    """Integrate specific force in the body axes of the window's beginning; stop after the sample that reaches ``limit_ns``.

    Parameters
    ----------
    t_ns : int
        Time reached so far.
    window : ndarray, shape (11,)
        Changed in place: turn since the beginning ``q_b0b`` (4), integral of ``C_b0b f`` (3) m/s, of w (3) rad, elapsed s.
    stamps, f, w : ndarray
        Columns of an inertial block, m/s^2 and rad/s.
    start : int
        First sample to use.
    limit_ns : int

    Returns
    -------
    next, t_ns : int
    """
    for k in range(start, stamps.shape[0]):
        dt = (stamps[k] - t_ns) * 1e-9
        q = window[0:4]
        middle = quat_multiply(q, quat_from_rotvec(0.5 * dt * w[k]))
        window[4:7] += quat_rotate(middle, f[k]) * dt
        window[7:10] += w[k] * dt
        window[10] += dt
        window[0:4] = quat_normalise(quat_multiply(q, quat_from_rotvec(dt * w[k])))
        t_ns = stamps[k]
        if t_ns >= limit_ns:
            return k + 1, t_ns
    return stamps.shape[0], t_ns


@kernel
def low_pass_motion(t_ns, motion, stamps, f, w, start, stop, down_b, gyro_bias, tau_s):
    """Low-pass turn rate about the vertical and strength of the specific force, in place.

    Parameters
    ----------
    t_ns : int
        Stamp before sample ``start``.
    motion : ndarray, shape (2,)
        Filtered yaw rate, rad/s, and specific force, m/s^2.
    stamps, f, w, start, stop
        Columns of an inertial block and the range of samples.
    down_b : ndarray, shape (3,)
        The vertical in body axes, last row of ``C_nb``.
    gyro_bias : ndarray, shape (3,)
    tau_s : float
    """
    for k in range(start, stop):
        share = -np.expm1(-(stamps[k] - t_ns) * 1e-9 / tau_s)
        rate, squared = 0.0, 0.0
        for i in range(3):
            rate += (w[k, i] - gyro_bias[i]) * down_b[i]
            squared += f[k, i] * f[k, i]
        motion[0] += share * (rate - motion[0])
        motion[1] += share * (np.sqrt(squared) - motion[1])
        t_ns = stamps[k]
