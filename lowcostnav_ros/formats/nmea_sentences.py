"""GGA, RMC, VTG and GST of what a navigator says, in place of a receiver's.

What is not given is an empty field with quality 0, status V and mode N.  Dead reckoning has quality 6 and mode E, so that a reader who
takes GPS only refuses it; GST carries the sigmas.  HDOP is the sigma over 3 m, the range error by which a reader usually multiplies it.

References
----------
NMEA 0183, version 4.10.
"""

import math

import numpy as np

from lowcostnav_ros.base.units import DEGREE, KNOT
from lowcostnav_ros.formats.cockpit import Picture
from lowcostnav_ros.formats.gdl90 import utc_of
from lowcostnav_ros.formats.nmea import RANGE_ERROR_M, checksum

GPS, DEAD_RECKONING, NO_FIX = "1", "6", "0"
AUTONOMOUS, ESTIMATED, NOT_VALID = "A", "E", "N"


def sentence(body: str) -> bytes:
    """A sentence of its body, with its check sum."""
    return f"${body}*{checksum(body.encode('ascii')):02X}\r\n".encode("ascii")


class NmeaSentences:
    """Sentences of one talker: ``GP``, ``GN`` or ``IN`` (integrated navigation)."""

    def __init__(self, talker: str = "GP") -> None:
        self._talker = talker

    def frames(self, picture: Picture, is_second: bool) -> list[bytes]:
        """Return the four sentences."""
        utc = utc_of(picture.stamp_ns)
        time = f"{utc:%H%M%S}.{utc.microsecond // 10_000:02d}" if picture.stamp_ns else ""
        date = f"{utc:%d%m%y}" if picture.stamp_ns else ""
        given = picture.lat is not None
        mode = NOT_VALID if not given else ESTIMATED if picture.is_degraded else AUTONOMOUS
        quality = NO_FIX if not given else DEAD_RECKONING if picture.is_degraded else GPS
        place = f"{_angle(picture.lat, 'NS', 2)},{_angle(picture.lon, 'EW', 3)}"
        knots, track = _number(picture.speed_mps, 1.0 / KNOT, 2), _number(picture.track, 1.0 / DEGREE, 2)
        kmh = _number(picture.speed_mps, 3.6, 2)
        bodies = [
            f"GGA,{time},{place},{quality},,{_dilution(picture)},{_heights(picture)},,",
            f"RMC,{time},{'A' if given else 'V'},{place},{knots},{track},{date},,,{mode}",
            f"VTG,{track},T,,M,{knots},N,{kmh},K,{mode if picture.speed_mps is not None else NOT_VALID}",
            f"GST,{time},{_sigmas(picture)}",
        ]
        return [sentence(self._talker + body) for body in bodies]


def _number(value: float | None, factor: float, digits: int) -> str:
    return "" if value is None else f"{value * factor:.{digits}f}"


def _angle(angle: float | None, sides: str, digits: int) -> str:
    """``ddmm.mmmmm,N``; the minutes are rounded before they are split, so that none reads 60."""
    if angle is None:
        return ","
    degrees, minutes = divmod(round(abs(angle) / DEGREE * 60.0 * 1e5), 60 * 10**5)
    return f"{degrees:0{digits}d}{minutes / 1e5:08.5f},{sides[angle < 0.0]}"


def _dilution(picture: Picture) -> str:
    if picture.cov_pos is None:
        return ""
    return f"{min(math.sqrt(0.5 * (picture.cov_pos[0, 0] + picture.cov_pos[1, 1])) / RANGE_ERROR_M[GPS], 99.9):.1f}"


def _heights(picture: Picture) -> str:
    if picture.height is None:
        return ",M,,M"
    return f"{picture.height - picture.sea_level:.1f},M,{picture.sea_level:.1f},M"


def _sigmas(picture: Picture) -> str:
    """RMS, ellipse (axes in m, true bearing of the major one in deg), sigmas of latitude, longitude and height in m."""
    if picture.cov_pos is None:
        return ",,,,,,"
    (minor, major), axes = np.linalg.eigh(picture.cov_pos[:2, :2])
    bearing = math.atan2(axes[1, 1], axes[0, 1]) / DEGREE % 180.0
    north, east, down = np.sqrt(np.diag(picture.cov_pos))
    rms, height = math.sqrt(0.5 * (minor + major)), "" if picture.height is None else f"{down:.1f}"
    return f"{rms:.1f},{math.sqrt(major):.1f},{math.sqrt(max(minor, 0.0)):.1f},{bearing:.1f},{north:.1f},{east:.1f},{height}"
