"""The earth: WGS-84 ellipsoid, normal gravity, frame rates, and the ways between geodetic, ECEF and local coordinates.

Latitude and longitude are geodetic in radians, height is metres above the ellipsoid, n is North-East-Down.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: section 3.1, Table 3.1, equations (3-3), (3-11), (3-12), (3-39).
"""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.units import STANDARD_GRAVITY as STANDARD_GRAVITY  # of this module too
from lowcostnav_ros.physics.rotation import wrap

WGS84_A = 6378137.0
"""Semi-major axis, m."""
WGS84_F = 1.0 / 298.257223563
"""Flattening."""
WGS84_B = WGS84_A * (1.0 - WGS84_F)
"""Semi-minor axis, m."""
WGS84_E2 = WGS84_F * (2.0 - WGS84_F)
"""First eccentricity squared."""
MEAN_RADIUS = 6371008.8
"""Mean radius (2a + b)/3, m."""
EARTH_RATE = 7.2921155e-5
"""Rotation rate of the earth, rad/s."""

_CORE_RADIUS = 1.0e5  # m; the closed form of Table 3.1 needs a point outside the ellipsoid's evolute (43 km)
_MIN_COS_LAT = 1.0e-12  # keeps longitude finite on the pole itself


@kernel
def radii(lat):
    """Radii of curvature (meridian, normal) of the ellipsoid at ``lat``, m (equations 3-11, 3-12)."""
    w2 = 1.0 - WGS84_E2 * math.sin(lat) ** 2
    normal = WGS84_A / math.sqrt(w2)
    return normal * (1.0 - WGS84_E2) / w2, normal


@kernel
def gravity(lat, height):
    """Normal gravity, m/s^2, positive down, at ``lat`` and ``height`` (equation 3-39).

    Along the plumb line of the ellipsoid; the horizontal component (below 1e-5 g at flight heights) is left out.
    """
    s2 = math.sin(lat) ** 2
    at_ellipsoid = 9.7803267715 * (1.0 + 0.0052790414 * s2 + 0.0000232718 * s2 * s2)
    return at_ellipsoid + (-0.0000030876910891 + 0.0000000043977311 * s2) * height + 0.0000000000007211 * height * height


@kernel
def earth_rate_n(lat):
    """Rate of e relative to i resolved in n, shape (3,), rad/s."""
    return np.array([EARTH_RATE * math.cos(lat), 0.0, -EARTH_RATE * math.sin(lat)])


@kernel
def transport_rate_n(lat, height, vel_n):
    """Rate of n relative to e resolved in n, shape (3,), rad/s, of a point moving at ``vel_n`` (3,) m/s over ground."""
    meridian, normal = radii(lat)
    east = vel_n[1] / (normal + height)
    return np.array([east, -vel_n[0] / (meridian + height), -east * math.tan(lat)])


@kernel
def geodetic_to_ecef(lat, lon, height):
    """ECEF coordinates, shape (3,), m."""
    _, normal = radii(lat)
    across = (normal + height) * math.cos(lat)
    return np.array([across * math.cos(lon), across * math.sin(lon), ((1.0 - WGS84_E2) * normal + height) * math.sin(lat)])


@kernel
def ecef_to_geodetic(xyz):
    """Geodetic (lat, lon, height) of the ECEF point ``xyz`` (3,) m, in closed form (Table 3.1, Heikkinen).

    On the axis longitude is zero.  Within 100 km of the centre geodetic latitude has no unique meaning; there the direction
    from the centre is returned, so that no input gives NaN.
    """
    r, z = math.hypot(xyz[0], xyz[1]), xyz[2]
    lon = math.atan2(xyz[1], xyz[0])
    if r * r + z * z < _CORE_RADIUS**2:
        return math.atan2(z, r), lon, math.hypot(r, z) - MEAN_RADIUS
    r0 = _closest_radius(r, z)
    u = math.hypot(r - WGS84_E2 * r0, z)
    v = math.sqrt((r - WGS84_E2 * r0) ** 2 + (1.0 - WGS84_E2) * z * z)
    z0 = WGS84_B**2 * z / (WGS84_A * v)
    lat = math.atan2(z + WGS84_E2 / (1.0 - WGS84_E2) * z0, r)
    return lat, lon, u * (1.0 - WGS84_B**2 / (WGS84_A * v))


@kernel
def _closest_radius(r, z):
    """Distance from the axis, m, of the ellipsoid point nearest to (r, z): steps 1 to 9 of Table 3.1 (step 6 is a cube root)."""
    b2, r2, z2 = WGS84_B**2, r * r, z * z
    f = 54.0 * b2 * z2
    g = r2 + (1.0 - WGS84_E2) * z2 - WGS84_E2 * (WGS84_A**2 - b2)
    c = WGS84_E2**2 * f * r2 / (g * g * g)
    s = (1.0 + c + math.sqrt(c * c + 2.0 * c)) ** (1.0 / 3.0)
    p = f / (3.0 * (s + 1.0 / s + 1.0) ** 2 * g * g)
    q = math.sqrt(1.0 + 2.0 * WGS84_E2**2 * p)
    under = 0.5 * WGS84_A**2 * (1.0 + 1.0 / q) - p * (1.0 - WGS84_E2) * z2 / (q * (1.0 + q)) - 0.5 * p * r2
    return -p * WGS84_E2 * r / (1.0 + q) + math.sqrt(max(under, 0.0))  # rounding makes it -1e-3 on the axis


@kernel
def dcm_ne(lat, lon):
    """Rotation matrix, shape (3, 3), that takes e-coordinates to n-coordinates (equation 3-3)."""
    sp, cp, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    return np.array([[-sp * cl, -sp * sl, cp], [-sl, cl, 0.0], [-cp * cl, -cp * sl, -sp]])


@kernel
def displace(lat, lon, height, d_n):
    """Move a point by a small NED displacement ``d_n`` (3,), m, along the local radii; returns (lat, lon, height).

    First order in ``d_n`` over the radius of the earth (1 cm at 300 m and 45 deg); the exact inverse of :func:`difference_n`.
    """
    meridian, normal = radii(lat)
    across = (normal + height) * max(math.cos(lat), _MIN_COS_LAT)
    return lat + d_n[0] / (meridian + height), wrap(lon + d_n[1] / across), height - d_n[2]


@kernel
def difference_n(lat, lon, height, lat_ref, lon_ref, height_ref):
    """NED metres, shape (3,), of a point minus a reference, by the radii at the reference; longitude differences are wrapped."""
    meridian, normal = radii(lat_ref)
    out = np.empty(3)
    out[0] = (lat - lat_ref) * (meridian + height_ref)
    out[1] = wrap(lon - lon_ref) * (normal + height_ref) * max(math.cos(lat_ref), _MIN_COS_LAT)
    out[2] = height_ref - height
    return out


@kernel
def _columns_to_ecef(lat, lon, height):
    out = np.empty((lat.size, 3))
    for i in range(lat.size):
        out[i] = geodetic_to_ecef(lat[i], lon[i], height[i])
    return out


@kernel
def _columns_to_geodetic(xyz):
    out = np.empty((3, xyz.shape[0]))
    for i in range(xyz.shape[0]):
        out[0, i], out[1, i], out[2, i] = ecef_to_geodetic(xyz[i])
    return out


class LocalFrame:
    """A fixed tangent plane: Cartesian NED with its origin at one point, exact through ECEF at any distance.

    Parameters
    ----------
    lat, lon : float
        Origin, rad.
    height : float
        Origin, m above the ellipsoid.
    """

    def __init__(self, lat: float, lon: float, height: float = 0.0) -> None:
        if not (abs(lat) <= 0.5 * math.pi and math.isfinite(lon) and math.isfinite(height)):
            raise ValueError(f"A local frame needs a latitude within +-pi/2 rad and finite numbers, got {lat}, {lon}, {height}.")
        self.lat, self.lon, self.height = float(lat), float(lon), float(height)
        self.origin_e = geodetic_to_ecef(self.lat, self.lon, self.height)
        self.C_le = dcm_ne(self.lat, self.lon)

    def to_ned(self, lat: np.ndarray | float, lon: np.ndarray | float, height: np.ndarray | float) -> np.ndarray:
        """Coordinates in this frame, m: shape (3,) for one point, (n, 3) for columns of n."""
        columns = np.broadcast_arrays(*(np.asarray(a, float) for a in (lat, lon, height)))
        xyz = _columns_to_ecef(*(column.ravel().copy() for column in columns))
        return ((xyz - self.origin_e) @ self.C_le.T).reshape(*columns[0].shape, 3)

    def from_ned(self, ned: np.ndarray) -> tuple[Any, Any, Any]:
        """Geodetic (lat, lon, height) of coordinates in this frame: floats for shape (3,), columns for (n, 3)."""
        ned = np.asarray(ned, float)
        lat, lon, height = _columns_to_geodetic(np.ascontiguousarray(ned.reshape(-1, 3) @ self.C_le + self.origin_e))
        shape = ned.shape[:-1]
        if not shape:
            return float(lat[0]), float(lon[0]), float(height[0])
        return lat.reshape(shape), lon.reshape(shape), height.reshape(shape)

    def C_ln(self, lat: float, lon: float) -> np.ndarray:
        """Rotation, shape (3, 3), from NED at (lat, lon) to this frame: meridian convergence and the tilt of the plumb line."""
        return self.C_le @ dcm_ne(lat, lon).T


def horizon_distance(height: np.ndarray | float, k: float = 4.0 / 3.0) -> np.ndarray:
    """Ground distance to the radio horizon, m, from ``height`` m over a smooth earth of ``k`` times its true radius.

    ``k`` = 4/3 is the customary allowance for refraction; 1 gives the geometric horizon.  A height below ground counts as zero.
    """
    radius = k * MEAN_RADIUS
    return radius * np.arccos(radius / (radius + np.maximum(height, 0.0)))


def line_of_sight_clear(
    height_a: np.ndarray | float, height_b: np.ndarray | float, ground_distance: np.ndarray | float, k: float = 4.0 / 3.0) -> np.ndarray:
    """Whether two antennas see each other over a smooth earth: their horizons reach each other.

    Parameters
    ----------
    height_a, height_b : float or ndarray
        Antenna heights above the ground, m.
    ground_distance : float or ndarray
        Distance along the ground, m.
    k : float
        Effective earth radius factor, see :func:`horizon_distance`.
    """
    return ground_distance <= horizon_distance(height_a, k) + horizon_distance(height_b, k)
