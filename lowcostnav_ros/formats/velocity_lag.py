"""How late a recorded velocity is behind the recorder's own fixes.

Many receivers and recorders smooth the speed they show: it is one of half a second ago.  With p the fixes, v the velocities and r the lag,
p(t) - p(s) - integral of v dt = r (v(t) - v(s)) and noise, over any span: in a turn of 180 degrees at 50 m/s, 50 m for half a second.  The
regression over spans that do not overlap gives r and its sigma.
"""

import numpy as np

from lowcostnav_ros.formats.log import rising
from lowcostnav_ros.physics.earth import radii

SPAN_S, HOLE_S = 5.0, 5.0
"""Length of the spans, at least two intervals, and the longest interval that is integrated across."""
LEAST_SPANS, SIGMAS, LEAST_S, LONGEST_S = 20, 5.0, 0.1, 3.0
"""What a lag takes to be believed: so many spans, so many sigmas, and a size within these."""
STRAYS = 4.0
"""Times the median deviation beyond which a span is not used: a fix that jumped."""


def velocity_lag(stamps_ns: np.ndarray, lat: np.ndarray, lon: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """Return (lag, sigma) of a velocity behind the fixes of the same rows, s; positive where it is late.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    lat, lon : ndarray, shape (n,)
        Rad.
    velocity : ndarray, shape (n, 2)
        North and east, m/s.

    Returns
    -------
    tuple of float
        (0, infinity) where the rows are too few, or nothing accelerates.
    """
    nothing = 0.0, np.inf
    good = rising(stamps_ns, np.isfinite(lat) & np.isfinite(lon) & np.isfinite(velocity).all(axis=1))
    if good.sum() < LEAST_SPANS:
        return nothing
    t, lat, lon, velocity = (stamps_ns[good] - stamps_ns[good][0]) * 1e-9, lat[good], lon[good], velocity[good]
    meridian, normal = radii(float(np.median(lat)))
    step = np.diff(t)
    moved = np.stack([meridian * np.diff(lat), normal * np.cos(0.5 * (lat[1:] + lat[:-1])) * np.diff(np.unwrap(lon))], axis=1)
    left = np.vstack([np.zeros(2), np.cumsum(moved - 0.5 * step[:, None] * (velocity[1:] + velocity[:-1]), axis=0)])
    rows = max(2, round(SPAN_S / float(np.median(step))))
    first = np.arange(0, len(t) - rows, rows)
    longest = np.array([step[k : k + rows].max() for k in first])
    first = first[longest <= HOLE_S]
    change, turned = (left[first + rows] - left[first]).ravel(), (velocity[first + rows] - velocity[first]).ravel()
    for _ in range(3):
        if len(change) < 2 * LEAST_SPANS or np.sum(turned**2) <= 0.0:
            return nothing
        lag = float(np.sum(change * turned) / np.sum(turned**2))
        rest = change - lag * turned
        near = np.abs(rest) <= STRAYS * np.median(np.abs(rest)) + 1e-9
        change, turned = change[near], turned[near]
    return lag, float(np.sqrt(np.mean(rest[near] ** 2) / np.sum(turned**2)))


def taken_back(stamps_ns: np.ndarray, lat: np.ndarray, lon: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
    """Return stamps, velocities (n, 3) and a word on what was done: as they are, or those of a lag later where there is one to believe."""
    lag, sigma = velocity_lag(stamps_ns, lat, lon, velocity[:, :2])
    if not (LEAST_S <= lag <= LONGEST_S and lag > SIGMAS * sigma):
        return stamps_ns, velocity, ""
    good = rising(stamps_ns, np.isfinite(velocity).all(axis=1))
    at = stamps_ns + round(1e9 * lag)
    later = np.stack([np.interp(at, stamps_ns[good], column) for column in velocity[good].T], axis=1)
    later[~good] = np.nan  # counted as what they are
    known = at <= stamps_ns[good][-1]
    return stamps_ns[known], later[known], f"; {lag:.2f} s late, as the fixes show: taken back"
