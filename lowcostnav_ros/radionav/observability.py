"""What is observable from ranges taken one at a time: rank and singular values of the stacked measurements.

One receiver receives one station at a time, so a fix is stretched over many ranges while errors move on.  Each range is a row

    [h_n, h_e | T h_n, T h_e | heading column | airspeed column],    h = unit vector from station to aircraft, T = time since start

acting on the unknowns initial position, wind, heading error and airspeed error (Gebre-Egziabher 2004, equations (6.6), (6.14) and
(6.15)-(6.20), with the sign of the sine in (6.19) corrected).  Where heading and speed vary, T V sin psi becomes the integral of
V sin psi, and so on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RANK_TOLERANCE = 1.0e-6
STATES = ("position_north", "position_east", "wind_north", "wind_east", "heading", "airspeed")


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A flown track, columns (n,): ``time_s`` from 0, ``north``, ``east`` m, and the air velocity ``air_north``, ``air_east`` m/s."""

    time_s: np.ndarray
    north: np.ndarray
    east: np.ndarray
    air_north: np.ndarray
    air_east: np.ndarray


def fly(time_s: np.ndarray, start: Sequence[float], heading: np.ndarray, airspeed: np.ndarray | float) -> Track:
    """Integrate heading (rad) and airspeed (m/s) in still air from ``start`` (2,), north east m, by the trapezoidal rule."""
    air_n = np.broadcast_to(airspeed * np.cos(heading), time_s.shape)
    air_e = np.broadcast_to(airspeed * np.sin(heading), time_s.shape)
    return Track(time_s, start[0] + _integral(air_n, time_s), start[1] + _integral(air_e, time_s), air_n, air_e)


def measurement_rows(track: Track, stations: np.ndarray, times_s: np.ndarray, states: int = 6) -> np.ndarray:
    """Stack the rows of ranges taken at ``times_s`` (m,), stations in turn.

    Parameters
    ----------
    track : Track
    stations : ndarray, shape (k, 2)
        North, east, m, asked in this order again and again.
    times_s : ndarray, shape (m,)
    states : int
        2 position, 4 with wind, 6 with heading and airspeed error: the first so many of :data:`STATES`.

    Returns
    -------
    ndarray, shape (m, states)
    """
    if states not in (2, 4, 6):
        raise ValueError(f"Observability is defined for 2, 4 or 6 states, got {states}.")
    at = np.column_stack([np.interp(times_s, track.time_s, c) for c in (track.north, track.east)])
    d = at - np.asarray(stations, float)[np.arange(len(times_s)) % len(stations)]
    h = d / np.hypot(*d.T)[:, None]
    speed = np.maximum(np.hypot(track.air_north, track.air_east), 1e-9)
    flown_n, flown_e = (np.interp(times_s, track.time_s, _integral(v, track.time_s)) for v in (track.air_north, track.air_east))
    unit_n, unit_e = (np.interp(times_s, track.time_s, _integral(v / speed, track.time_s)) for v in (track.air_north, track.air_east))
    elapsed = (times_s - track.time_s[0])[:, None]
    heading = -flown_e * h[:, 0] + flown_n * h[:, 1]
    airspeed = unit_n * h[:, 0] + unit_e * h[:, 1]
    return np.column_stack((h, elapsed * h, heading, airspeed))[:, :states]


def singular_values(rows: np.ndarray, normalise: bool = True) -> np.ndarray:
    """Return the singular values, largest first; columns scaled to unit length first unless ``normalise`` is False.

    Scaling makes values of metres, seconds and radians comparable; a column of zeros stays zero.
    """
    if normalise:
        length = np.linalg.norm(rows, axis=0)
        rows = rows / np.where(length > 0.0, length, 1.0)
    return np.linalg.svd(rows, compute_uv=False)


def rank(rows: np.ndarray, tolerance: float = RANK_TOLERANCE) -> int:
    """Return how many combinations of the unknowns the ranges determine."""
    values = singular_values(rows)
    return int(np.sum(values > tolerance * values[0]))


def _integral(values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time_s)
    return np.concatenate(([0.0], np.cumsum(steps)))
