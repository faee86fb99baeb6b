"""ARINC 429 words off a byte stream: position and velocity of a GPS sensor, attitude and body motion of an AHRS, DME distances.

A word holds, from bit 1: the label, whose octal digits stand first, the source or destination index (SDI), the data, the sign and status
matrix (SSM) and a parity bit that makes the number of ones odd.  Here a word is an integer whose bit 0 is bit 1 of the standard, with the
label turned round, as receiver chips hand it over: its value is the low byte.  A small microcontroller frames the words of a stream:

    A4 29   channel   word, 4 bytes, little endian   sum of the five bytes before, mod 256

Words carry no time of measurement, so a measurement is stamped when it came.  Of a label only words whose SSM says normal operation count.

References
----------
ARINC Specification 429 Part 1, attachments 1 and 2 (labels, ranges, resolutions); ARINC 743A (GNSS); ARINC 705 (AHRS); ARINC 709 (DME).
"""

import math
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, ImuBlock, Measurement, SlantRange
from lowcostnav_ros.base.units import DEGREE, FOOT, FOOT_PER_MINUTE, KNOT, NAUTICAL_MILE, STANDARD_GRAVITY
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.framing import MORE, Framer, Protocol
from lowcostnav_ros.formats.parser import ARRIVAL, Parser
from lowcostnav_ros.physics.rotation import euler_to_quat

SYNC = b"\xa4\x29"
FRAME = struct.Struct("<2sBIB")
NORMAL_BNR, NORMAL_BCD = 3, (0, 3)
"""SSM of normal operation: of a binary word; of a decimal one plus and minus."""
_BCD_WIDTHS = (3, 4, 4, 4, 4)
"""Bits of the five decimal digits, the first from bit 29 down."""


@dataclass(frozen=True)
class Binary:
    """A binary (BNR) label: two's complement from bit 29 down, full scale ``scale``; ``bits`` beside the sign, over 18 also in the SDI."""

    name: str
    scale: float
    bits: int
    unit: float = 1.0

    def value(self, word: int) -> float:
        """The value of a word, SI."""
        wide = 20 if self.bits > 18 else 18
        data = (word >> (28 - wide)) & ((1 << (wide + 1)) - 1)
        signed = data - (1 << (wide + 1)) if data >> wide else data
        return (signed >> (wide - self.bits)) * 2.0**-self.bits * self.scale * self.unit


@dataclass(frozen=True)
class Decimal:
    """A decimal (BCD) label: five digits, the last worth ``step``."""

    name: str
    step: float
    unit: float = 1.0

    def value(self, word: int) -> float:
        """The value of a word, SI; NaN where a digit is none."""
        total, at = 0, 29
        for width in _BCD_WIDTHS:
            at -= width
            digit = (word >> at) & ((1 << width) - 1)
            if digit > 9:
                return math.nan
            total = 10 * total + digit
        return (-1.0 if word >> 29 & 3 == 3 else 1.0) * total * self.step * self.unit


LABELS: Mapping[int, Binary | Decimal] = {
    0o110: Binary("latitude", 180.0, 20, DEGREE), 0o120: Binary("latitude_fine", 180.0 * 2.0**-20, 11, DEGREE),
    0o111: Binary("longitude", 180.0, 20, DEGREE), 0o121: Binary("longitude_fine", 180.0 * 2.0**-20, 11, DEGREE),
    0o076: Binary("height_above_sea", 131_072.0, 20, FOOT), 0o370: Binary("height", 131_072.0, 20, FOOT),
    0o247: Binary("radius_95", 16.0, 18, NAUTICAL_MILE), 0o136: Binary("height_95", 32_768.0, 18, FOOT),
    0o166: Binary("north", 4096.0, 15, KNOT), 0o174: Binary("east", 4096.0, 15, KNOT), 0o165: Binary("up", 32_768.0, 15, FOOT_PER_MINUTE),
    0o324: Binary("pitch", 180.0, 14, DEGREE), 0o325: Binary("roll", 180.0, 14, DEGREE),
    0o320: Binary("magnetic_heading", 180.0, 15, DEGREE), 0o314: Binary("true_heading", 180.0, 15, DEGREE),
    0o326: Binary("pitch_rate", 128.0, 13, DEGREE), 0o327: Binary("roll_rate", 128.0, 13, DEGREE),
    0o330: Binary("yaw_rate", 128.0, 13, DEGREE), 0o331: Binary("along", 4.0, 12, STANDARD_GRAVITY),
    0o332: Binary("across", 4.0, 12, STANDARD_GRAVITY), 0o333: Binary("normal", 4.0, 12, STANDARD_GRAVITY),
    0o202: Binary("dme", 512.0, 16, NAUTICAL_MILE), 0o201: Decimal("dme_decimal", 0.01, NAUTICAL_MILE),
    0o035: Decimal("dme_frequency_over_100", 0.001),
}  # fmt: skip
"""What is read of a bus; the rest is counted.  A full scale is that of the standard: 20 bits of 180 deg are 62.7 ft of latitude, so that
the fine words 120 and 121 matter."""
POSITION, VELOCITY = ("latitude", "longitude"), ("north", "east")
RATES, FORCES = ("roll_rate", "pitch_rate", "yaw_rate"), ("along", "across", "normal")
TOGETHER_NS, GOOD_NS = 40_000_000, 2 * 10**9
"""Words of one measurement come within this time, and within half the time after which they are repeated, or the words of two cycles would
be taken for those of one; a word that another needs is not older than the second time."""
RAYLEIGH_95, WITHIN_95 = 2.448, 1.960
FIX_SIGMA_M, HEIGHT_SIGMA_M, SPEED_SIGMA_MPS, CLIMB_SIGMA_MPS, DME_SIGMA_M = 33.0 * FOOT, 33.0 * FOOT, 0.5, 1.0, 0.17 * NAUTICAL_MILE
TILT_SIGMA, HEADING_SIGMA = 1.0 * DEGREE, 3.0 * DEGREE


def parity_is_odd(word: int) -> bool:
    """Whether a word has an odd number of ones."""
    return word.bit_count() % 2 == 1


def word_of(label: int, data: int, sdi: int = 0, ssm: int = NORMAL_BNR) -> int:
    """A word with its parity; ``data`` fills bits 11 to 29, from bit 9 on where it has more than 19 bits and takes the place of the SDI."""
    wide = data >> 19 != 0 or label in _WIDE
    word = label | (data << 8 if wide else sdi << 8 | data << 10) | ssm << 29
    return word | (0 if parity_is_odd(word) else 1 << 31)


_WIDE = frozenset(label for label, kind in LABELS.items() if isinstance(kind, Binary) and kind.bits > 18)


def encoded(label: int, value: float, sdi: int = 0) -> int:
    """A word of a value, SI: what a bus would carry; raises ValueError for a value beyond the label's range."""
    kind = LABELS[label]
    if isinstance(kind, Decimal):
        digits = f"{round(value / kind.unit / kind.step):05d}"
        data = 0
        for width, digit in zip(_BCD_WIDTHS, digits, strict=True):
            data = data << width | int(digit)
        return word_of(label, data, sdi, 0)
    steps = round(value / kind.unit / kind.scale * 2.0**kind.bits)
    if not -(1 << kind.bits) <= steps < 1 << kind.bits:
        raise ValueError(f"{kind.name} {value:g} is beyond the range of label {label:03o}.")
    wide = 20 if kind.bits > 18 else 18
    return word_of(label, (steps << (wide - kind.bits)) & ((1 << (wide + 1)) - 1), sdi)


def frame_of(word: int, channel: int = 0) -> bytes:
    """A word as the byte stream carries it."""
    body = struct.pack("<BI", channel, word)
    return SYNC + body + bytes([sum(body) & 0xFF])


def _length(buffer: bytearray, start: int) -> int:
    return FRAME.size if len(buffer) - start >= FRAME.size else MORE


ARINC = Protocol("ARINC 429", SYNC, _length, lambda frame: sum(frame[2:7]) & 0xFF == frame[7])


class ArincParser(Parser):
    """Words of one bus.

    Parameters
    ----------
    stations : mapping of frequency, in hundredths of a MHz, to ident
        DME stations by the frequency that they are tuned by: the bus carries no ident.
    declination : float
        Rad, east positive; added to a magnetic heading.
    gravity_positive : bool
        Whether the accelerations read +1 g on the axis that points down, as those of a Crossbow unit do.
    """

    clock = ARRIVAL

    def __init__(self, stations: Mapping[int, str] | None = None, declination: float = 0.0, gravity_positive: bool = False) -> None:
        super().__init__()
        self.framer: Framer = Framer((ARINC,))
        self._stations, self._declination, self._sign = stations or {}, declination, -1.0 if gravity_positive else 1.0
        self._values: dict[str, tuple[int, float]] = {}
        self._came: dict[str, int] = {}
        self._window_ns = TOGETHER_NS
        self._motion = 0, np.zeros(3), np.zeros(3)
        makers: tuple[tuple[Callable[[], Iterable[Measurement]], tuple[str, ...]], ...] = (
            (self._fix, (*POSITION, "latitude_fine", "longitude_fine")), (self._velocity, VELOCITY),
            (self._inertial, (*RATES, *FORCES)), (self._attitude, ("roll", "pitch", "true_heading", "magnetic_heading")),
            (self._dme, ("dme", "dme_decimal")),
        )  # fmt: skip
        self._makers = {name: make for make, names in makers for name in names}

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Take over a word and yield the measurement that it completes."""
        word = FRAME.unpack(frame)[2]
        kind = LABELS.get(word & 0xFF)
        if not parity_is_odd(word):
            self.account.refused["ARINC 429 word with even parity"] += 1
        elif kind is None:
            self.account.left_out[f"ARINC 429 label {word & 0xFF:03o}"] += 1
        elif (word >> 29 & 3) not in (NORMAL_BCD if isinstance(kind, Decimal) else (NORMAL_BNR,)):
            self.account.refused[f"ARINC 429 label {word & 0xFF:03o} not in normal operation"] += 1
            self._values.pop(kind.name, None)
        elif not math.isfinite(value := kind.value(word)):
            self.account.refused[f"ARINC 429 label {word & 0xFF:03o} with a digit that is none"] += 1
        else:
            self._values[kind.name] = self.arrived_ns, value
            self._window_ns = min(TOGETHER_NS, (self.arrived_ns - self._came.get(kind.name, 0)) // 2)
            self._came[kind.name] = self.arrived_ns
            if kind.name in self._makers:
                yield from self._makers[kind.name]()

    def _get(self, name: str, within_ns: int = GOOD_NS) -> float | None:
        at = self._values.get(name)
        return at[1] if at is not None and self.arrived_ns - at[0] <= within_ns else None

    def _group(self, *names: str) -> list[float] | None:
        """Values that came together; used once."""
        found = [value for value in (self._get(name, self._window_ns) for name in names) if value is not None]
        if len(found) < len(names):
            if all(name in self._values for name in names):
                self.account.refused[f"words of one measurement too far apart in time: {names[0]}"] += 1
            return None
        for name in names:
            del self._values[name]
        return found

    def _fix(self) -> Iterator[Measurement]:
        has_fine = self._get("latitude_fine") is not None or self._get("longitude_fine") is not None
        parts = self._group(*POSITION, *(f"{name}_fine" for name in POSITION if has_fine))
        if parts is None:
            return
        lat, lon = (parts[k] + (parts[k + 2] if has_fine else 0.0) for k in (0, 1))
        ellipsoidal, above_sea = self._get("height"), self._get("height_above_sea")
        if abs(lat) > 0.5 * math.pi or (ellipsoidal is None and above_sea is None):
            self.account.refused["position without a height, or of a latitude that is none"] += 1
            return
        height = ellipsoidal if ellipsoidal is not None else (above_sea or 0.0) + float(undulation(lat, lon))
        radius, vertical = self._get("radius_95"), self._get("height_95")
        level = FIX_SIGMA_M if not radius else radius / RAYLEIGH_95
        down = HEIGHT_SIGMA_M if not vertical else vertical / WITHIN_95
        if not has_fine:
            self.account.remark("Latitude and longitude come without their fine words: 19 m of resolution.")
            level = math.hypot(level, 180.0 * DEGREE * 2.0**-20 * 6.371e6 / math.sqrt(12.0))
        if self.is_new("gps/fix", self.arrived_ns):
            yield GpsPosition(self.arrived_ns, "gps/fix", lat, lon, height, np.diag([level**2, level**2, down**2]))

    def _velocity(self) -> Iterator[Measurement]:
        parts, up = self._group(*VELOCITY), self._get("up")
        if parts is not None and self.is_new("gps/vel", self.arrived_ns):
            variances = [SPEED_SIGMA_MPS**2, SPEED_SIGMA_MPS**2, CLIMB_SIGMA_MPS**2 if up is not None else 1.0e6]
            yield GpsVelocity(self.arrived_ns, "gps/vel", np.array([*parts, -(up or 0.0)]), np.diag(variances))

    def _inertial(self) -> Iterator[Measurement]:
        parts = self._group(*RATES, *FORCES)
        if parts is not None and self.is_new("imu/data_raw", self.arrived_ns):
            rate, force = np.array(parts[:3]), self._sign * np.array(parts[3:])
            self._motion = self.arrived_ns, rate, force
            yield ImuBlock.of("imu/data_raw", np.array([self.arrived_ns]), force[np.newaxis], rate[np.newaxis])

    def _attitude(self) -> Iterator[Measurement]:
        true = self._get("true_heading") is not None
        parts = self._group("roll", "pitch", "true_heading" if true else "magnetic_heading")
        at_ns, rate, force = self._motion
        if parts is None or self.arrived_ns - at_ns > TOGETHER_NS or not self.is_new("imu/data_fused", self.arrived_ns):
            return
        q_nb = euler_to_quat(parts[0], parts[1], parts[2] + (0.0 if true else self._declination))
        cov = np.diag([TILT_SIGMA**2, TILT_SIGMA**2, HEADING_SIGMA**2])
        yield Attitude(self.arrived_ns, "imu/data_fused", q_nb, cov, rate, force)

    def _dme(self) -> Iterator[Measurement]:
        """A distance, to the station that the frequency names."""
        distance = self._values.pop("dme", None) or self._values.pop("dme_decimal", None)
        frequency = self._get("dme_frequency_over_100")
        ident = self._stations.get(round(100.0 * (frequency + 100.0))) if frequency is not None else None
        if ident is None:
            self.account.refused["DME distance without a frequency (label 035) that names a station"] += 1
        elif distance is not None and self.is_new(f"dme/range {ident}", self.arrived_ns):
            yield SlantRange(self.arrived_ns, "dme/range", ident, distance[1], DME_SIGMA_M**2)
