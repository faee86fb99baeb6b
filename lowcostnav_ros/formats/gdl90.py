"""GDL 90: heartbeat, ownship, ownship geometric altitude, and the ID and AHRS messages that tablets added.

Where there is no position, the heartbeat's validity bit is 0 and the ownship report holds zeros with NIC and NACp 0, as section 3.4 asks.
NACp comes of the filter's 95 % radius, its best three categories of the height's half band, too.  NIC comes of protection levels alone:
where a navigator has none it is 0, unknown, since no sigma says how large an error is that nothing has noticed.  The report's altitude is
pressure altitude; without static pressure it is invalid.

References
----------
GDL 90 Data Interface Specification, 560-1058-00 revision A, Garmin AT 2007 (the Public ICD).
ForeFlight, GDL 90 Extended Specification: messages 0x65.
RTCA DO-282: NIC and NACp.
"""

import binascii
import math
import struct
from collections.abc import Callable
from datetime import UTC, datetime

from lowcostnav_ros.base.units import DEGREE, FOOT, FOOT_PER_MINUTE, KNOT
from lowcostnav_ros.formats.cockpit import Picture

FLAG, ESCAPE, TOGGLE = 0x7E, 0x7D, 0x20
_ANY = math.inf
NACP_M = (
    (3.0, 4.0, 11), (10.0, 15.0, 10), (30.0, 45.0, 9), (92.6, _ANY, 8), (185.2, _ANY, 7), (555.6, _ANY, 6), (926.0, _ANY, 5),
    (1852.0, _ANY, 4), (3704.0, _ANY, 3), (7408.0, _ANY, 2), (18_520.0, _ANY, 1),
)  # fmt: skip
"""95 % radius and half band of the height, m, below which each category begins (table 12)."""
NIC_M = (
    (7.5, 11.0, 11), (25.0, 37.5, 10), (75.0, 112.0, 9), (185.2, _ANY, 8), (370.4, _ANY, 7), (1111.2, _ANY, 6), (1852.0, _ANY, 5),
    (3704.0, _ANY, 4), (7408.0, _ANY, 3), (14_816.0, _ANY, 2), (37_040.0, _ANY, 1),
)  # fmt: skip
"""The same of the horizontal and vertical protection levels."""
NO_ALTITUDE, NO_SPEED, NO_CLIMB, NO_ANGLE, NO_WORD, NO_VFOM = 0xFFF, 0xFFF, 0x800, 0x7FFF, 0xFFFF, 0x7FFF
AIRBORNE_MPS = 15.0
LIGHT, ICAO, SELF_ASSIGNED = 1, 0, 1
"""Emitter category of a light aircraft; kinds of addresses (table 9)."""


def check_sum(message: bytes) -> int:
    """Frame check sequence of a message (section 2.2.3)."""
    # CRC-CCITT, whose register takes a byte in at its low end: the last two have not been divided yet
    return binascii.crc_hqx(message[:-2], 0) ^ int.from_bytes(message[-2:], "big")


def framed(message: bytes) -> bytes:
    """The message with its check sum, between flags, flags and escapes within it escaped (section 2.2)."""
    out = bytearray([FLAG])
    for byte in message + struct.pack("<H", check_sum(message)):
        out += bytes([ESCAPE, byte ^ TOGGLE]) if byte in (FLAG, ESCAPE) else bytes([byte])
    return bytes(out) + bytes([FLAG])


def category(radius_m: float | None, height_m: float | None, table: tuple[tuple[float, float, int], ...]) -> int:
    """Category of a radius and of a height's half band, m; without the height none of the best three, without the radius 0, unknown."""
    if radius_m is None:
        return 0
    return next((number for level, up, number in table if radius_m < level and (up == _ANY or (height_m is not None and height_m < up))), 0)


class Gdl90:
    """Messages of one aircraft.

    Parameters
    ----------
    address : int
        ICAO 24-bit address; 0 where the aircraft has none.
    call_sign : str
        At most eight letters and digits.
    """

    def __init__(self, address: int = 0, call_sign: str = "") -> None:
        self._address, self._call_sign = address, call_sign.encode("ascii")[:8].ljust(8)

    def frames(self, picture: Picture, is_second: bool) -> list[bytes]:
        """Return the AHRS message and, once a second, all others, each framed."""
        messages: list[Callable[[Picture], bytes]] = [heartbeat, self.ownship, geometric_altitude, self.identity] if is_second else []
        return [framed(make(picture)) for make in (*messages, ahrs)]

    def ownship(self, picture: Picture) -> bytes:
        """Message 10."""
        lat, lon = picture.lat, picture.lon
        if lat is None or lon is None:
            where, quality = bytes(6), 0
        else:
            where = _signed(lat / math.pi * 2**23, 24) + _signed(lon / math.pi * 2**23, 24)
            nic = category(picture.hpl_m, picture.vpl_m, NIC_M)
            quality = nic << 4 | category(picture.radius_95_m, picture.height_95_m, NACP_M)
        flown = picture.speed_mps
        airborne = flown is not None and flown > AIRBORNE_MPS
        misc = airborne << 3 | picture.is_degraded << 2 | (picture.track is not None)
        speed = NO_SPEED if flown is None else min(round(flown / KNOT), 0xFFE)
        climb = NO_CLIMB if picture.vel_n is None else max(-510, min(510, round(-picture.vel_n[2] / FOOT_PER_MINUTE / 64.0))) & 0xFFF
        track = 0 if picture.track is None else round(picture.track / math.pi * 128.0) & 0xFF
        words = (_altitude(picture.pressure_height_m) << 4 | misc).to_bytes(2, "big") + bytes([quality])
        words += (speed << 12 | climb).to_bytes(3, "big") + bytes([track, LIGHT])
        kind = ICAO if self._address else SELF_ASSIGNED
        return bytes([10, kind]) + self._address.to_bytes(3, "big") + where + words + self._call_sign + b"\0"

    def identity(self, picture: Picture) -> bytes:
        """The ID message: geometric altitudes are above the ellipsoid."""
        return struct.pack(">BBB8s8s16sI", 0x65, 0, 1, b"\xff" * 8, b"LCNAV", b"lowcostnav_ros", 0)


def heartbeat(picture: Picture) -> bytes:
    """Message 0: whether the position is valid, and the second of the day, which is that of the solution."""
    seconds = int(picture.stamp_ns // 10**9 % 86_400)
    valid = picture.lat is not None
    return bytes([0, valid << 7 | 1, (seconds >> 16) << 7 | (picture.stamp_ns > 0)]) + (seconds & 0xFFFF).to_bytes(2, "little") + bytes(2)


def geometric_altitude(picture: Picture) -> bytes:
    """Message 11: above the ellipsoid in steps of 5 ft, with the 95 % figure of merit; not given: no figure, and the warning."""
    if picture.height is None or picture.height_95_m is None:
        return struct.pack(">BhH", 11, 0, 0x8000 | NO_VFOM)
    steps = max(-32_768, min(32_767, round(picture.height / (5.0 * FOOT))))
    return struct.pack(">BhH", 11, steps, min(math.ceil(picture.height_95_m), 0x7EEE))


def ahrs(picture: Picture) -> bytes:
    """The AHRS message, true heading."""
    angles = [NO_ANGLE if angle is None else round(angle / DEGREE * 10.0) for angle in (picture.roll, picture.pitch)]
    heading = NO_WORD if picture.heading is None else round(picture.heading / DEGREE * 10.0) % 3600
    speeds = [NO_WORD if speed is None else max(round(speed / KNOT), 0) for speed in (picture.cas_mps, picture.tas_mps)]
    return struct.pack(">BBhhHHH", 0x65, 1, *angles, heading, *speeds)


def utc_of(stamp_ns: int) -> datetime:
    """The UTC of a stamp."""
    return datetime.fromtimestamp(stamp_ns // 10**9, UTC).replace(microsecond=stamp_ns % 10**9 // 1000)


def _signed(value: float, bits: int) -> bytes:
    half = 1 << (bits - 1)
    return (max(-half, min(half - 1, round(value))) & ((1 << bits) - 1)).to_bytes(bits // 8, "big")


def _altitude(height_m: float | None) -> int:
    """Pressure altitude in steps of 25 ft above -1000 ft."""
    steps = NO_ALTITUDE if height_m is None else round((height_m / FOOT + 1000.0) / 25.0)
    return steps if 0 <= steps < NO_ALTITUDE else NO_ALTITUDE
