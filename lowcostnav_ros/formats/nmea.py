"""NMEA 0183 sentences of a receiver: GGA, RMC, VTG, GST, GSA, ZDA and the pressure height of a glider's recorder (PGRMZ).

A position is published as its GGA comes.  Its sigma is what GST states for the same second, else the dilution of GGA times the range
error that the fix quality promises.  The day is that of RMC or ZDA; a time of day belongs to the day that brings it nearest to the last
full date.  The sentences carry no vertical velocity: that component is marked as not measured.

References
----------
NMEA 0183, version 4.10, and the receiver manuals that repeat it.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, date, datetime
from functools import reduce
from operator import xor
from typing import ClassVar

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, GpsPosition, GpsVelocity, Measurement, Pressure
from lowcostnav_ros.base.units import FOOT, KNOT
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.framing import MORE, NONE, Protocol
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.physics import atmosphere

LONGEST = 250
"""Bytes of a sentence; the standard allows 82, makers' own are longer."""
RANGE_ERROR_M = {"1": 3.0, "2": 1.5, "3": 2.0, "4": 0.03, "5": 0.4, "8": 3.0}
"""1-sigma range error by fix quality of GGA: single, differential or SBAS, PPS, fixed and floating ambiguities, simulated."""
_NOT_MEASURED = {"6": "position is dead reckoning of the receiver", "7": "position was put in by hand"}
DEFAULT_DILUTION, VERTICAL = 1.5, 1.7
"""HDOP where none is stated; vertical over horizontal dilution where no GSA states it."""
SPEED_SIGMA_MPS, PRESSURE_SIGMA_PA = 0.3, 60.0
DAY_NS, SECOND = 86_400 * 10**9, 10**9
_STATED_NS = 2 * SECOND


def _length(buffer: bytearray, start: int) -> int:
    end = buffer.find(b"\n", start, start + LONGEST)
    if end < 0:
        return NONE if len(buffer) - start >= LONGEST else MORE
    return end + 1 - start


def checksum(body: bytes) -> int:
    """Exclusive or of the bytes between ``$`` and ``*``."""
    return reduce(xor, body, 0)


def _is_sound(frame: bytes) -> bool:
    body, star, stated = frame[1:].rstrip(b"\r\n").rpartition(b"*")
    try:
        return bool(star) and int(stated[:2], 16) == checksum(body) and body.isascii()
    except ValueError:
        return False


NMEA = Protocol("NMEA", b"$", _length, _is_sound)


class NmeaParser(Parser):
    """Sentences of one receiver."""

    protocols: ClassVar[tuple[Protocol, ...]] = (NMEA,)

    def __init__(self, day: date | None = None) -> None:
        super().__init__()
        self._last_ns: int | None = None if day is None else _midnight_ns(day) + DAY_NS // 2
        self._early: list[tuple[str, list[str]]] = []
        self._dilution_vertical: float | None = None
        self._stated: tuple[int, np.ndarray] | None = None
        self._readers: dict[str, Callable[[list[str]], Iterable[Measurement]]] = {
            "GGA": self._gga, "RMC": self._rmc, "GST": self._gst, "GSA": self._gsa, "ZDA": self._zda, "RMZ": self._rmz,
        }  # fmt: skip

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Turn one sentence into measurements."""
        address, *cells = frame[1:].rpartition(b"*")[0].decode("ascii").split(",")
        name = address[-3:] if address[0:1] != "P" or address == "PGRMZ" else address
        reader = self._readers.get(name)
        if reader is None:
            self.account.left_out[f"NMEA {name[:12]}"] += 1
            return
        try:
            yield from reader(cells)
        except (ValueError, IndexError, OverflowError):
            self.account.refused[f"NMEA {name} with a field that is no number"] += 1

    def close(self) -> Iterator[Measurement]:
        """Yield the rest; positions whose day never came are refused."""
        yield from super().close()
        if self._early:
            self.account.refused["NMEA GGA without a date: no RMC or ZDA states one"] += len(self._early)
            self._early.clear()

    def _stamp_ns(self, time: str) -> int | None:
        """UTC of a time of day, on the day nearest to the last full date; None before the first."""
        if self._last_ns is None:
            return None
        of_day = time_of_day_ns(time)
        midnight = self._last_ns - self._last_ns % DAY_NS
        return min((midnight + day * DAY_NS + of_day for day in (-1, 0, 1)), key=lambda stamp: abs(stamp - self._last_ns))  # type: ignore[operator]

    def _gga(self, cells: list[str]) -> Iterator[Measurement]:
        time, quality = cells[0], cells[5]
        if quality in ("0", "") or not time:
            self.account.refused["no fix"] += 1
            return
        if quality not in RANGE_ERROR_M:
            self.account.refused[_NOT_MEASURED.get(quality, "fix of unknown quality")] += 1
            return
        stamp_ns = self._stamp_ns(time)
        if stamp_ns is None:
            if len(self._early) < 100:
                self._early.append(("GGA", cells))
            return
        lat, lon = angle(cells[1], cells[2], "NS", 90.0), angle(cells[3], cells[4], "EW", 180.0)
        above_sea = float(cells[8])
        separation = float(cells[10]) if cells[10] else float(undulation(lat, lon))
        if not cells[10]:
            self.account.remark("GGA states no geoid separation: heights are made ellipsoidal by the shipped geoid, 0.5 m RMS.")
        if self.is_new("gps/fix", stamp_ns):
            self.account.origins.setdefault("gps/fix", "GGA: deg and minutes, m above sea level + geoid separation = m above the ellipsoid")
            yield GpsPosition(stamp_ns, "gps/fix", lat, lon, above_sea + separation, self._cov(stamp_ns, quality, cells[7]))

    def _cov(self, stamp_ns: int, quality: str, dilution: str) -> np.ndarray:
        if self._stated is not None and abs(stamp_ns - self._stated[0]) <= _STATED_NS:
            return self._stated[1]
        level = RANGE_ERROR_M[quality] * min(max(float(dilution) if dilution else DEFAULT_DILUTION, 0.5), 50.0)
        over = self._dilution_vertical or VERTICAL
        return np.diag([0.5 * level**2, 0.5 * level**2, (over * level) ** 2])

    def _rmc(self, cells: list[str]) -> Iterator[Measurement]:
        time, status, speed, track, day = cells[0], cells[1], cells[6], cells[7], cells[8]
        if status != "A" or (len(cells) > 11 and cells[11] in ("E", "N", "M")):
            self.account.refused["no fix"] += 1
            return
        stamp_ns = _midnight_ns(datetime.strptime(day, "%d%m%y").date()) + time_of_day_ns(time)
        yield from self._dated(stamp_ns)
        if not speed:
            return
        mps, towards = float(speed) * KNOT, math.radians(float(track)) if track else None
        if mps > 600.0 or (towards is not None and not 0.0 <= towards <= 2.0 * math.pi) or mps < 0.0:
            self.account.refused["velocity implausible"] += 1
        elif towards is None and mps > 0.5:
            self.account.refused["speed without a track"] += 1
        elif self.is_new("gps/vel", stamp_ns):
            self.account.origins.setdefault("gps/vel", "RMC: speed in kt and track; no vertical velocity")
            vel_n = np.array([mps * math.cos(towards or 0.0), mps * math.sin(towards or 0.0), 0.0])
            yield GpsVelocity(stamp_ns, "gps/vel", vel_n, np.diag([SPEED_SIGMA_MPS**2, SPEED_SIGMA_MPS**2, UNKNOWN_VARIANCE]))

    def _zda(self, cells: list[str]) -> Iterator[Measurement]:
        if cells[0] and cells[3]:
            day = date(int(cells[3]), int(cells[2]), int(cells[1]))
            yield from self._dated(_midnight_ns(day) + time_of_day_ns(cells[0]))

    def _dated(self, stamp_ns: int) -> Iterator[Measurement]:
        """Take over a full date; what waited for the first follows."""
        if not 0 < stamp_ns < 2**31 * SECOND:
            self.account.refused["date out of range"] += 1
            return
        self._last_ns = stamp_ns
        early, self._early = self._early, []
        for _, cells in early:
            yield from self._gga(cells)

    def _gst(self, cells: list[str]) -> tuple[Measurement, ...]:
        stamp_ns = self._stamp_ns(cells[0]) if cells[0] else None
        sigmas = [float(cell) if cell else math.nan for cell in cells[5:8]]
        if stamp_ns is not None and len(sigmas) == 3 and all(0.0 < sigma < 1000.0 for sigma in sigmas):
            self._stated = stamp_ns, np.diag(np.square(sigmas))
        return ()

    def _gsa(self, cells: list[str]) -> tuple[Measurement, ...]:
        level, vertical = (float(cells[k]) if cells[k] else 0.0 for k in (15, 16))
        self._dilution_vertical = vertical / level if 0.5 <= level < 50.0 and 0.5 <= vertical < 50.0 else None
        return ()

    def _rmz(self, cells: list[str]) -> Iterator[Measurement]:
        height_m = float(cells[0]) * (FOOT if cells[1].lower() == "f" else 1.0)
        if self._last_ns is None or not -1000.0 < height_m < 20_000.0:
            self.account.refused["pressure height before the first date, or out of range"] += 1
        elif self.is_new("air/static_pressure", self._last_ns):
            self.account.origins.setdefault("air/static_pressure", "PGRMZ: pressure height in ft, by the standard atmosphere")
            yield Pressure(self._last_ns, "air/static_pressure", float(atmosphere.pressure(height_m)), PRESSURE_SIGMA_PA**2)


def _midnight_ns(day: date) -> int:
    return int(datetime(day.year, day.month, day.day, tzinfo=UTC).timestamp()) * SECOND


def time_of_day_ns(text: str) -> int:
    """Return nanoseconds since midnight of ``hhmmss.sss``; raises ValueError for what is none."""
    hours, minutes, seconds = int(text[0:2]), int(text[2:4]), float(text[4:])
    if not (0 <= hours < 24 and 0 <= minutes < 60 and 0.0 <= seconds < 61.0):
        raise ValueError(text)
    return (hours * 3600 + minutes * 60) * SECOND + round(seconds * SECOND)


def angle(text: str, side: str, sides: str, limit_deg: float) -> float:
    """Return rad of ``dddmm.mmm`` with its side; raises ValueError for what is none."""
    whole, minutes = divmod(float(text), 100.0)
    degrees = whole + minutes / 60.0
    if side not in sides or not side or minutes >= 60.0 or not 0.0 <= degrees <= limit_deg:
        raise ValueError(text)
    return math.radians(-degrees if side == sides[1] else degrees)
