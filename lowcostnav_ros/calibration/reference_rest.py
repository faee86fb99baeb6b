"""An attitude reference at rest: means and variances of its nine channels, and by which sign its accelerometers count.

At rest the specific force is minus gravity.  A unit that gives +1 g on its down axis measures y = g - a + b on all axes, minus specific
force (Njenga 2008, Table 3, whose unit does); one that gives -1 g measures specific force, f = a - g + b.  Gravity in its own axes by its
own roll and pitch,  g_b = g [-sin(pitch), sin(roll) cos(pitch), cos(roll) cos(pitch)],  tells which, and what is left is its bias.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

SPECIFIC_FORCE, GRAVITY_POSITIVE = "specific_force", "gravity_positive"
SIGNS = {SPECIFIC_FORCE: 1.0, GRAVITY_POSITIVE: -1.0}
CHANNELS = ("roll", "pitch", "yaw", "roll_rate", "pitch_rate", "yaw_rate", "accel_x", "accel_y", "accel_z")
SURE = 0.5
"""Mean acceleration along gravity, in g, from which the sign is told."""


def gravity_b(roll: float, pitch: float, size: float = STANDARD_GRAVITY) -> np.ndarray:
    """Gravity (3,) in body axes at a roll and pitch, rad."""
    return size * np.array([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])


def accel_sign(along_g: float) -> str:
    """Name of the convention by the mean acceleration along gravity as the attitude has it, in g; empty where that tells neither."""
    if abs(along_g) < SURE:
        return ""
    return GRAVITY_POSITIVE if along_g > 0.0 else SPECIFIC_FORCE


@dataclass(frozen=True, slots=True)
class ReferenceAtRest:
    """What nine channels at rest show: angles rad, rates rad/s, accelerations m/s^2.

    Attributes
    ----------
    mean, variance : ndarray (9,)
        In the order of :data:`CHANNELS`; the variance is the sample's about its mean.
    samples : int
    sign : str
        ``specific_force``, ``gravity_positive``, or empty: the accelerations tell neither.
    accel_bias : ndarray (3,)
        Mean acceleration with gravity taken out, in the unit's own sign; what an error of its own roll and pitch adds is in it.
    """

    mean: np.ndarray
    variance: np.ndarray
    samples: int
    sign: str
    accel_bias: np.ndarray


def reference_at_rest(channels: np.ndarray) -> ReferenceAtRest:
    """Characterise an attitude reference by a capture at rest.

    Parameters
    ----------
    channels : ndarray, shape (n, 9)
        In the order of :data:`CHANNELS`; yaw may wrap.

    Raises
    ------
    ValueError
        For fewer than two samples, or values that are not finite.
    """
    if channels.ndim != 2 or channels.shape[1] != len(CHANNELS) or len(channels) < 2 or not np.isfinite(channels).all():
        raise ValueError("A capture at rest needs at least two samples of nine finite channels: attitude, rates, accelerations.")
    values = channels.copy()
    values[:, 0:3] = np.unwrap(values[:, 0:3], axis=0)
    mean = values.mean(axis=0)
    g_b = gravity_b(mean[0], mean[1])
    sign = accel_sign(float(mean[6:9] @ g_b) / STANDARD_GRAVITY**2)
    bias = mean[6:9] + SIGNS.get(sign, np.nan) * g_b
    return ReferenceAtRest(mean, values.var(axis=0, ddof=1), len(values), sign, bias)
