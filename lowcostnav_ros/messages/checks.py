"""Checks on single fields of a message; each returns the checked value or raises :class:`Refusal` with a fixed phrase."""

import math

import numpy as np

from lowcostnav_ros.messages.rules import DecodeRules, Refusal

ABSURD = 1.0e30
"""No variance is this large; senders write 1e308 for infinity."""


def stamp_ns(header) -> int:
    """Return the header stamp in ns; zero is the stamp nobody filled in."""
    sec, nanosec = header.stamp.sec, header.stamp.nanosec
    if sec < 0 or nanosec >= 1_000_000_000:
        raise Refusal("stamp out of range", f"{sec} s {nanosec} ns")
    if sec == 0 and nanosec == 0:
        raise Refusal("stamp is zero")
    return sec * 1_000_000_000 + nanosec


def frame(source: str, frame_id: str, rules: DecodeRules, kind: str = "") -> None:
    """Refuse a frame id that the rules do not list for this source (or for its ``kind``, a navigator's topic)."""
    expected = rules.frames.get(source) or rules.frames.get(kind)
    if expected and frame_id.rpartition("/")[2] not in expected:
        raise Refusal("wrong frame id", f"'{frame_id}', expected {' or '.join(sorted(expected))}")


def finite(values: tuple[float, ...] | np.ndarray, what: str) -> None:
    """Refuse NaN and infinity."""
    if math.isfinite(sum(values)):
        return
    for value in values:
        if not math.isfinite(value):
            raise Refusal(f"{what} is not finite", value)


def magnitude(values: tuple[float, ...] | np.ndarray, limit: float, phrase: str) -> None:
    """Refuse values beyond ``limit``."""
    for value in values:
        if abs(value) > limit:
            raise Refusal(phrase, f"{value:g}")


def quaternion(x: float, y: float, z: float, w: float) -> None:
    """Refuse a quaternion that is not finite, zero, or off unit norm by more than 0.01."""
    finite((x, y, z, w), "orientation")
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if norm < 1e-6:
        raise Refusal("orientation is a zero quaternion")
    if abs(norm - 1.0) > 0.01:
        raise Refusal("orientation is not a unit quaternion", f"norm {norm:g}")


def covariance(flat: np.ndarray | list[float], what: str, may_be_zero: bool = False) -> np.ndarray | None:
    """Return a (3, 3) covariance or None where it is unknown.

    Parameters
    ----------
    flat : ndarray or list, shape (9,)
        Row-major as in the message.  All zeros means unknown, first element -1 means that the datum is absent.
    what : str
        Name of the datum for the phrase.
    may_be_zero : bool
        True for truth, whose covariance is exactly zero.

    Raises
    ------
    Refusal
        Absent, not finite, absurd, negative, asymmetric, or not positive semi-definite.
    """
    values = flat if isinstance(flat, list) else flat.tolist()
    if values[0] == -1.0:
        raise Refusal(f"{what} is absent")
    total = sum(map(abs, values))
    if total == 0.0:
        return np.zeros((3, 3)) if may_be_zero else None
    if not total < ABSURD:  # one comparison in the usual case; NaN fails it as well
        finite(values, f"{what} covariance")
        raise Refusal(f"{what} covariance is absurd", f"{total:g}")
    xx, xy, xz, yx, yy, yz, zx, zy, zz = values
    least = min(xx, yy, zz)
    if least < 0.0:
        raise Refusal(f"{what} covariance is negative", f"{least:g}")
    if least == 0.0:
        raise Refusal(f"{what} covariance has a zero variance")
    matrix = np.array(values).reshape(3, 3)
    if not (xy or xz or yz or yx or zx or zy):
        return matrix
    if max(abs(xy - yx), abs(xz - zx), abs(yz - zy)) > 1e-6 * max(xx, yy, zz):
        raise Refusal(f"{what} covariance is asymmetric")
    matrix = 0.5 * (matrix + matrix.T)
    _refuse_indefinite(matrix, what)
    return matrix


def _refuse_indefinite(matrix: np.ndarray, what: str) -> None:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix.tolist()
    a, b, c = xy / math.sqrt(xx * yy), xz / math.sqrt(xx * zz), yz / math.sqrt(yy * zz)  # as correlations, so that units do not matter
    determinant = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    if max(abs(a), abs(b), abs(c)) > 1.0 + 1e-9 or determinant < -1e-9:  # principal minors of a matrix with ones on its diagonal
        raise Refusal(f"{what} covariance is not positive")


def variance(value: float, what: str) -> float | None:
    """Return a scalar variance, or None where it is zero (unknown)."""
    if value == 0.0:
        return None
    finite((value,), f"{what} variance")
    if value == -1.0:
        raise Refusal(f"{what} is absent")
    if value < 0.0:
        raise Refusal(f"{what} variance is negative", f"{value:g}")
    if value > ABSURD:
        raise Refusal(f"{what} variance is absurd", f"{value:g}")
    return float(value)


def geodetic(message) -> tuple[float, float, float]:
    """Return checked (lat rad, lon rad, ellipsoid height m) of a NavSatFix; raises Refusal."""
    if message.status.status < 0:
        raise Refusal("no fix")
    lat, lon, height = message.latitude, message.longitude, message.altitude
    finite((lat, lon, height), "position")
    if abs(lat) > 90.0:
        raise Refusal("latitude out of range", f"{lat:g} deg")
    if abs(lon) > 180.0:
        raise Refusal("longitude out of range", f"{lon:g} deg")
    if lat == 0.0 and lon == 0.0:
        raise Refusal("position is exactly 0, 0")
    if not -1000.0 <= height <= 50_000.0:
        raise Refusal("height out of range", f"{height:g} m")
    return math.radians(lat), math.radians(lon), height
