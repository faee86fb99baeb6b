"""The constant-gain filters of the source over a whole record at once, for studies of many runs.

The navigators carry a covariance and take measurements as they come; these loops take columns of one rate and nothing else, so that
thousands of runs take seconds.  Angles are (roll, pitch, heading), rad; corrections are added to the rates, true = gyro + correction.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.estimation.attitude_vectors import level_angles
from lowcostnav_ros.estimation.manoeuvre import follow_switch
from lowcostnav_ros.physics.attitude_propagation import body_rate_matrix, euler_step
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import wrap

OPEN_LOOP, ALWAYS, HEADING_SWITCH, RATE_SWITCH, STEP_SWITCH = 0, 1, 2, 3, 4
"""When accelerometers and magnetometer are fed back: never, always, by the change of heading between updates, by body rates, by the change
of heading over one step of the gyros."""


@kernel
def euler_filter(angles, correction, rates, measured, every, on_angle, on_rate, dt, updates):
    """GPS attitude and gyros in Euler angles (equations 4.32 to 4.50) with constant gains.

    Parameters
    ----------
    angles, correction : ndarray, shape (3,)
        State at the start.
    rates : ndarray, shape (n, 3)
        Gyro rates, rad/s, FRD, one every ``dt`` s.
    measured : ndarray, shape (m, 3)
        Angles measured after every ``every`` samples.
    on_angle, on_rate : float
        Gains on the angle and, 1/s, on the rate correction.
    updates : int
        Number of measurements used; the filter coasts from there on.

    Returns
    -------
    angles, corrections : ndarray, shape (n, 3)
    """
    out, learned = np.empty_like(rates), np.empty_like(rates)
    now, d = angles.copy(), correction.copy()
    for k in range(rates.shape[0]):
        now = euler_step(now, rates[k] + d, dt)
        m = (k + 1) // every - 1
        if (k + 1) % every == 0 and m < updates:
            y = wrap(measured[m] - now)
            d = d + on_rate * matvec(body_rate_matrix(now[0], now[1]), y)
            now = now + on_angle * y
        out[k] = now
        learned[k] = d
    return out, learned


@kernel
def accel_mag_filter(angles, rates, forces, heading, every, on_level, on_heading, dt, feedback, limits):
    """Gyros with levelling and magnetic heading fed back under a switch (section 4.12), the gyro corrections frozen at zero.

    Parameters
    ----------
    angles : ndarray, shape (3,)
        At the start.
    rates, forces : ndarray, shape (n, 3)
        rad/s and m/s^2, FRD, one every ``dt`` s.
    heading : ndarray, shape (m,)
        Measured true heading after every ``every`` samples, rad.
    on_level, on_heading : float
        Gains on roll and pitch, and on heading.
    feedback : int
        :data:`OPEN_LOOP`, :data:`ALWAYS`, :data:`HEADING_SWITCH` (limits[0] on the change of the estimated heading per second and
        limits[2] on the load, equation 4.67 over the second between updates), :data:`STEP_SWITCH` (the same over the last gyro step,
        corrections excluded) or :data:`RATE_SWITCH` (:func:`follow_switch`, steady since the last update).
    limits : ndarray, shape (7,)
        Of :func:`~lowcostnav_ros.estimation.manoeuvre.switch_limits`.

    Returns
    -------
    angles : ndarray, shape (n, 3)
    used : ndarray of bool, shape (m,)
        Whether each measurement was fed back.
    turning : ndarray, shape (m,)
        Yaw rate the heading switch saw, rad/s.
    """
    out = np.empty_like(rates)
    used, turning = np.zeros(heading.shape[0], dtype=np.bool_), np.zeros(heading.shape[0])
    now, memory, before = angles.copy(), np.zeros(5), angles[2]
    mean, quiet = np.zeros(3), True
    for k in range(rates.shape[0]):
        was = now[2]
        now = euler_step(now, rates[k], dt)
        stepped = wrap(now[2] - was) / dt
        down = np.array([-math.sin(now[1]), math.sin(now[0]) * math.cos(now[1]), math.cos(now[0]) * math.cos(now[1])])
        steady = follow_switch(memory, limits, forces[k], rates[k], down, dt)
        quiet = quiet and steady
        mean += forces[k] / every
        if (k + 1) % every == 0:
            m = (k + 1) // every - 1
            turning[m] = wrap(now[2] - before) / (every * dt)
            load = math.sqrt((forces[k] ** 2).sum()) / STANDARD_GRAVITY
            calm = abs(stepped if feedback == 4 else turning[m]) <= limits[0] and load <= 1.0 + limits[2]
            used[m] = feedback == 1 or ((feedback == 2 or feedback == 4) and calm) or (feedback == 3 and quiet)
            if used[m]:
                roll, pitch = level_angles(mean if feedback == 3 else forces[k])
                now[0] += on_level * wrap(roll - now[0])
                now[1] += on_level * (pitch - now[1])
                now[2] += on_heading * wrap(heading[m] - now[2])
            before = now[2]
            mean, quiet = np.zeros(3), steady
        out[k] = now
    return out, used, turning
