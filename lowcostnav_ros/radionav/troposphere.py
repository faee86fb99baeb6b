"""Delay of a signal between a ground transmitter and an aircraft: both ends in the lower troposphere.

The models of Kawecki (2015), section 3.5, selectable by name; their printed errors corrected (the power 4 missing in (3.15), the factor
of (3.16), which must be 2e-7, and the sign of its second bracket).  Heights in the profile count from the transmitter, where the weather
is measured.  The path is straight: bending adds less than a millimetre at 30 km.
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.radionav.weather import Weather

MODELS = ("none", "hopfield", "bouska_raquet", "index")
"""No delay; ray-traced modified Hopfield; Bouska and Raquet; constant index of refraction."""
NONE, HOPFIELD, BOUSKA_RAQUET, INDEX = range(4)
SEGMENTS = 20
"""Of the ray: within 0.2 mm of the integral at 20 km."""
HOPFIELD_WET_M = 11_000.0
RAQUET_DRY_M, RAQUET_WET_M = 42_700.0, 12_000.0
FLAT_M = 1.0
"""Ends closer in height than this count as level, where the closed forms divide by zero."""


def hopfield_dry_m(temperature_k: float) -> float:
    """Height, m, at which the dry refractivity of the Hopfield profile vanishes."""
    return 40136.0 + 148.72 * (temperature_k - 273.16)


def air_of(weather: Weather, height: float) -> np.ndarray:
    """What the models need of a transmitter at ``height`` m, (6,): dry and wet N, dry height (m), wet height (m), N of IRM, height."""
    dry_m = hopfield_dry_m(weather.temperature_k)
    return np.array([weather.dry(), weather.wet(), dry_m, HOPFIELD_WET_M, weather.index(), height])


@kernel
def quartic_mean(below, above, top):
    """Mean of ((top - h)/top)^4 for h from ``below`` to ``above``, m, in closed form; nothing is left beyond the top."""
    low, high = 1.0 - min(below, top) / top, 1.0 - min(above, top) / top
    if abs(above - below) < FLAT_M:
        return (0.5 * (low + high)) ** 4
    return top / (5.0 * (above - below)) * (low**5 - high**5)


@kernel
def quartic_ray(above, top, segments):
    """The same from 0 to ``above`` as the mean over the middles of segments of a ray (3.15)."""
    total = 0.0
    for i in range(segments):
        rest = max(1.0 - (i + 0.5) * above / (segments * top), 0.0)
        total += rest * rest * rest * rest
    return total / segments


@kernel
def path_delays(model, air, height, ranges):
    """Delays of several transmitters at once.

    Parameters
    ----------
    model : int
        Index in :data:`MODELS`.
    air : ndarray, shape (m, 6)
        Rows of :func:`air_of`.
    height : float
        Receiver, m.
    ranges : ndarray, shape (m,)
        Straight ranges, m.

    Returns
    -------
    ndarray, shape (m,)
        M.
    """
    out = np.zeros(ranges.shape[0])
    for k in range(ranges.shape[0]):
        dry, wet, top_dry, top_wet, index, base = air[k]
        above = height - base
        if model == HOPFIELD:
            N = dry * quartic_ray(above, top_dry, SEGMENTS) + wet * quartic_ray(above, top_wet, SEGMENTS)
        elif model == BOUSKA_RAQUET:  # reference height h_s = that of the transmitter, so that dh_APL = 0
            N = dry * quartic_mean(0.0, above, RAQUET_DRY_M - base) + wet * quartic_mean(0.0, above, RAQUET_WET_M - base)
        elif model == INDEX:
            N = index
        else:
            N = 0.0
        out[k] = 1e-6 * N * ranges[k]
    return out


def raquet_delay(N: float, top_m: float, reference_m: float, transmitter_m: float, above_m: float, range_m: float) -> float:
    """Bouska and Raquet's delay, m, of one refractivity ``N`` at ``reference_m``, with a transmitter elsewhere (3.16 as corrected).

    ``top_m`` and the heights count from mean sea level; ``above_m`` is how high the user is over the transmitter.
    """
    below = transmitter_m - reference_m
    return 1e-6 * N * range_m * float(quartic_mean(below, below + above_m, top_m - reference_m))
