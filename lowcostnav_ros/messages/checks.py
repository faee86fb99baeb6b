"""Checks on single fields of a message; each returns the checked value or raises :class:`Refusal` with a fixed phrase."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.small_matrices import at_least
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.rules import DecodeRules, Refusal

ABSURD = 1.0e30
"""No variance is this large; senders write 1e308 for infinity."""
LEAST_SIGMA = {
    "position": 0.01,  # m: a receiver with carrier phase
    "velocity": 0.005,  # m/s
    "wind": 0.01,
    "airspeed": 0.05,
    "orientation": 1e-4,  # rad
    "magnetic field": 1e-9,  # T
    "pressure": 0.1,  # Pa
    "temperature": 0.01,  # K
    "range": 1.0,  # m: a pulse of 3.5 us
    "bearing": 1e-4,  # rad
}
"""What no sensor of a datum is better than, 1 sigma; a smaller one that is stated is raised, along every direction."""

WRONG_FRAME = "wrong frame id"


def stamp_ns(header: Any) -> int:
    """Return the header stamp in ns; zero is a stamp that was not set."""
    sec, nanosec = header.stamp.sec, header.stamp.nanosec
    if sec < 0 or nanosec >= 1_000_000_000:
        raise Refusal("stamp out of range", f"{sec} s {nanosec} ns")
    if sec == 0 and nanosec == 0:
        raise Refusal("stamp is zero")
    return sec * 1_000_000_000 + nanosec


@dataclass(slots=True)
class Received:
    """What is known of a message beside its content: stamp and source, kind under these rules; ``notes`` counts assumptions."""

    head: tuple[int, str]
    kind: Kind
    rules: DecodeRules
    notes: Counter[str]

    def frame(self, frame_id: str) -> None:
        """Refuse a frame id that is not of this kind."""
        expected = self.kind.frames
        if expected and frame_id.rpartition("/")[2] not in expected:
            raise Refusal(WRONG_FRAME, f"'{frame_id}', expected {' or '.join(sorted(expected))}")

    def assumed(self) -> tuple[float, ...]:
        """Return the default variances and note it; refuse where there are none."""
        if not self.kind.variances:
            raise Refusal("covariance is unknown and no default is set")
        self.notes[f"{self.kind.name}: covariance unknown, default used"] += 1
        return self.kind.variances

    def known(self, cov: np.ndarray | None, swap: Callable) -> np.ndarray:
        """Return a checked covariance in our axes, the default where it is None, which means unknown."""
        return np.diag(self.assumed()) if cov is None else swap(cov)

    def covariance(self, flat: np.ndarray | list[float], what: str, may_be_zero: bool = False) -> np.ndarray | None:
        """Return what :func:`covariance` does, raised where it states a sigma that no sensor has, and note that."""
        known = covariance(flat, what, may_be_zero)
        if known is None or may_be_zero:
            return known
        raised = at_least(known, LEAST_SIGMA.get(what, 0.0))
        if raised is not known:
            self._note_raised(what)
        return raised

    def _note_raised(self, what: str) -> None:
        self.notes[f"{self.kind.name}: {what} sigma raised to what a sensor can have"] += 1

    def variance(self, value: float, what: str) -> float:
        """Return the checked variance, the default where it is unknown, raised where no sensor is that good."""
        known, least = variance(value, what), LEAST_SIGMA.get(what, 0.0) ** 2
        if known is None:
            return self.assumed()[0]
        if known < least:
            self._note_raised(what)
        return max(known, least)


def xyz(vector: Any) -> tuple[float, float, float]:
    """Return the components of a Vector3 or a Point."""
    return vector.x, vector.y, vector.z


def station(header: Any) -> str:
    """Return the station ident a header carries as its frame id."""
    ident = header.frame_id.strip()
    if not ident.isalnum() or len(ident) > 8:
        raise Refusal("station ident missing", f"frame_id '{header.frame_id}'")
    return ident


def twist(
    message: Any, received: Received, what: str, limit: float, may_be_zero: bool = False
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the checked linear velocity of a TwistWithCovarianceStamped and its covariance, both in the message's axes."""
    velocity = xyz(message.twist.twist.linear)
    finite(velocity, what)
    magnitude(velocity, limit, f"{what} implausible")
    return np.array(velocity), received.covariance(np.reshape(message.twist.covariance, (6, 6))[:3, :3].ravel(), what, may_be_zero)


def finite(values: Sequence[float] | np.ndarray, what: str) -> None:
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
    sx, sy, sz = math.sqrt(xx), math.sqrt(yy), math.sqrt(zz)  # each for itself: a product of two variances can underflow
    a, b, c = xy / sx / sy, xz / sx / sz, yz / sy / sz  # as correlations, so that units do not matter
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


def present(covariance: Sequence[float] | np.ndarray, what: str) -> None:
    """Refuse a datum that its covariance marks as absent; the rest of a covariance that nobody uses is not looked at."""
    if covariance[0] == -1.0:
        raise Refusal(f"{what} is absent")


def geodetic(message: Any) -> tuple[float, float, float]:
    """Return checked (lat rad, lon rad, ellipsoid height m) of a NavSatFix; raises Refusal."""
    place, height = horizontal(message), message.altitude
    finite((height,), "position")
    if not -1000.0 <= height <= 50_000.0:
        raise Refusal("height out of range", f"{height:g} m")
    return *place, height


def horizontal(message: Any) -> tuple[float, float]:
    """Return checked (lat, lon), rad, of a NavSatFix; raises Refusal."""
    if message.status.status < 0:
        raise Refusal("no fix")
    lat, lon = message.latitude, message.longitude
    finite((lat, lon), "position")
    if abs(lat) > 90.0:
        raise Refusal("latitude out of range", f"{lat:g} deg")
    if 180.0 < lon <= 360.0:  # some count from 0 to 360
        lon -= 360.0
    if abs(lon) > 180.0:
        raise Refusal("longitude out of range", f"{lon:g} deg")
    if lat == 0.0 and lon == 0.0:
        raise Refusal("position is exactly 0, 0")
    return math.radians(lat), math.radians(lon)
