"""The height of the geoid above the ellipsoid, for receivers and logs that only know heights above mean sea level."""

import numpy as np


def undulation(grid_m: np.ndarray, lat: np.ndarray | float, lon: np.ndarray | float) -> np.ndarray:
    """Interpolate a geoid grid bilinearly.

    Parameters
    ----------
    grid_m : ndarray, shape (r, c)
        Undulation, m: rows from 90 deg north to 90 deg south, columns from 0 deg eastwards, evenly spaced.
    lat, lon : ndarray or float, shape (n,) or scalar
        Rad.

    Returns
    -------
    ndarray, shape of ``lat``
        Height of the geoid above the ellipsoid, m: ellipsoid height = height above mean sea level + this.
    """
    rows, columns = grid_m.shape
    down = (0.5 - np.asarray(lat, float) / np.pi) * (rows - 1)
    east = np.asarray(lon, float) / (2.0 * np.pi) % 1.0 * columns
    top = np.clip(np.floor(down).astype(int), 0, rows - 2)
    left = np.floor(east).astype(int) % columns
    right, down, east = (left + 1) % columns, down - top, east - np.floor(east)
    above = (1.0 - east) * grid_m[top, left] + east * grid_m[top, right]
    below = (1.0 - east) * grid_m[top + 1, left] + east * grid_m[top + 1, right]
    return (1.0 - down) * above + down * below
