"""What a receiver measures: geometric range, range rate, direction, with light time and the turning of the earth as options.

    range = |r_sat - r|,   rate = e . (v_sat - v),   e = (r_sat - r)/range           (Solimeno 2007, equations 5-10, 5-11)

Both ends in ECEF.  During the flight of the signal the earth turns by 1e-5 rad: a satellite state at transmission belongs, rotated by
that angle, into the frame of the reception; everything downstream works in that one frame.
"""

import math
from collections.abc import Callable

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT
from lowcostnav_ros.physics.earth import EARTH_RATE, dcm_ne

States = Callable[[float | np.ndarray], tuple[np.ndarray, np.ndarray]]


@kernel
def line_of_sight(position_e, sat_position_e):
    """Ranges (n,) m and unit vectors (n, 3) from the receiver ``position_e`` (3,) to the satellites (n, 3), ECEF."""
    n = sat_position_e.shape[0]
    ranges, los = np.empty(n), np.empty((n, 3))
    for k in range(n):
        square = 0.0
        for j in range(3):
            los[k, j] = sat_position_e[k, j] - position_e[j]
            square += los[k, j] * los[k, j]
        ranges[k] = math.sqrt(square)
        for j in range(3):
            los[k, j] /= ranges[k]
    return ranges, los


@kernel
def range_and_rate(position_e, velocity_e, sat_position_e, sat_velocity_e):
    """Ranges (n,) m, range rates (n,) m/s (positive receding) and lines of sight (n, 3), all ECEF."""
    ranges, los = line_of_sight(position_e, sat_position_e)
    rates = np.zeros(ranges.size)
    for k in range(ranges.size):
        for j in range(3):
            rates[k] += los[k, j] * (sat_velocity_e[k, j] - velocity_e[j])
    return ranges, rates, los


@kernel
def turned(vectors, angle):
    """Vectors (n, 3) seen from a frame that has turned by ``angle`` (n,) rad about the polar axis since."""
    out = np.empty_like(vectors)
    for k in range(angle.size):
        s, c = math.sin(angle[k]), math.cos(angle[k])
        out[k, 0] = c * vectors[k, 0] + s * vectors[k, 1]
        out[k, 1] = -s * vectors[k, 0] + c * vectors[k, 1]
        out[k, 2] = vectors[k, 2]
    return out


def azimuth_elevation(lat: float, lon: float, los_e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths (n,), clockwise from north in [0, 2 pi), and elevations (n,), rad, of lines of sight (n, 3) in ECEF."""
    north, east, down = (np.asarray(los_e, float) @ dcm_ne(lat, lon).T).T
    return np.mod(np.arctan2(east, north), 2.0 * math.pi), np.arcsin(np.clip(-down, -1.0, 1.0))


def states_at_reception(
    states: States, t_s: float, position_e: np.ndarray, light_time: bool = True, earth_rotation: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Satellite positions and velocities (n, 3) as the signals received at ``t_s`` at ``position_e`` (3,) show them.

    Parameters
    ----------
    states : callable
        ``states(t_s)`` gives ECEF positions and velocities (n, 3) at one time, or at one time (n,) per satellite.
    light_time : bool
        Take each satellite where it was when it transmitted; False is the thesis's simulation.
    earth_rotation : bool
        Express that state in the frame of the reception.
    """
    position, velocity = states(t_s)
    if not light_time:
        return position, velocity
    for _ in range(2):  # the first guess is off by 1e-6 of the flight time, the second by 1e-12
        flight_s = line_of_sight(position_e, position)[0] / SPEED_OF_LIGHT
        position, velocity = states(t_s - flight_s)
        angle = EARTH_RATE * flight_s * earth_rotation
        position, velocity = turned(position, angle), turned(velocity, angle)
    return position, velocity
