"""The binary protocol of u-blox receivers: NAV-PVT (NAV-SOL of old ones), NAV-COV, RXM-RAWX and RXM-SFRBX, with NMEA between the frames.

Raw measurements become ``gnss/raw``, corrected by the ephemerides of the same stream, so that a navigator flies on the receiver's own
satellites.  Sentences of NMEA are used until the first NAV-PVT comes, which says the same and more.

References
----------
u-blox F9 HPG 1.32, interface description (UBX-22008968).
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, Measurement
from lowcostnav_ros.formats.framing import MORE, NONE, Protocol
from lowcostnav_ros.formats.nmea import NMEA, NmeaParser
from lowcostnav_ros.gnss.correction import CorrectionSettings
from lowcostnav_ros.gnss.ephemeris import EphemerisStore
from lowcostnav_ros.gnss.gps_time import SECOND, WEEK_S, from_week, unix_ns
from lowcostnav_ros.gnss.raw_epoch import RawEpoch, screened
from lowcostnav_ros.gnss.rinex_nav import Navigation
from lowcostnav_ros.gnss.signals import GALILEO, GPS, L1_WAVELENGTH_M
from lowcostnav_ros.gnss.subframes import SubframeReader, crc24q
from lowcostnav_ros.gnss.track import Follower
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic

LARGEST = 4096
"""Bytes of a payload: 127 signals of RAWX."""
ANY_HEIGHT = 1.0e8
"""Variance, m^2, of the height of a two-dimensional fix."""


def checksum(body: bytes) -> bytes:
    """Fletcher check sum, two bytes, of class, identifier, length and payload."""
    values = np.frombuffer(body, np.uint8).astype(np.int64)
    return bytes((int(values.sum()) & 255, int(values @ np.arange(len(values), 0, -1)) & 255))


def frame_of(kind: int, identifier: int, payload: bytes) -> bytes:
    """Build a frame."""
    body = struct.pack("<BBH", kind, identifier, len(payload)) + payload
    return b"\xb5\x62" + body + checksum(body)


def _length(buffer: bytearray, start: int) -> int:
    if len(buffer) - start < 6:
        return MORE
    size = buffer[start + 4] | buffer[start + 5] << 8
    return NONE if size > LARGEST else size + 8


def _rtcm_length(buffer: bytearray, start: int) -> int:
    if len(buffer) - start < 3:
        return MORE
    return NONE if buffer[start + 1] & 0xFC else (buffer[start + 1] << 8 | buffer[start + 2]) + 6


UBX = Protocol("UBX", b"\xb5\x62", _length, lambda frame: checksum(frame[2:-2]) == frame[-2:])
RTCM = Protocol(
    "RTCM", b"\xd3", _rtcm_length, lambda f: crc24q(int.from_bytes(f[:-3], "big"), 8 * len(f) - 24) == int.from_bytes(f[-3:], "big")
)
_PVT = struct.Struct("<I HBBBBB B Ii BBBB ii ii II iii ii II H".replace(" ", ""))
_SOL = struct.Struct("<IihBB3iI3iI")
_COV = struct.Struct("<IBBB9x12f")
_SIGNAL = np.dtype([
    ("pseudorange", "<f8"), ("phase", "<f8"), ("doppler", "<f4"), ("system", "u1"), ("sat_id", "u1"), ("signal", "u1"), ("frequency", "u1"),
    ("lock", "<u2"), ("cn0", "u1"), ("sigmas", "u1", 3), ("status", "u1"), ("reserved", "u1"),
])  # fmt: skip
_SYSTEMS = {0: GPS, 2: GALILEO}
_VALID_DATE_TIME = 0b011


class UbloxParser(NmeaParser):
    """Frames of one receiver; without ``is_locating`` raw measurements are only looked at for the time."""

    protocols = (UBX, NMEA, RTCM)

    def __init__(self) -> None:
        super().__init__()
        self.is_locating = True
        self.use(Navigation(EphemerisStore(), None, Counter()))
        self._near_gps: int | None = None
        self._waiting: tuple[int, list[GpsPosition | GpsVelocity]] | None = None
        self._has_pvt = self._has_cov = False
        self._handlers: dict[tuple[int, int], Callable[[bytes], Iterator[Measurement]]] = {
            (0x01, 0x07): self._pvt, (0x01, 0x06): self._sol, (0x01, 0x36): self._cov_of,
            (0x02, 0x15): self._rawx, (0x02, 0x13): self._sfrbx,
        }  # fmt: skip

    def use(self, navigation: Navigation) -> None:
        """Begin with ephemerides known beforehand, such as those of the whole of a recording; those that come are added."""
        self.navigation = navigation
        self._subframes = SubframeReader(navigation)
        self._follower = Follower(navigation, CorrectionSettings())

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Turn one frame into measurements."""
        if protocol == NMEA.name:
            for one in super().take(protocol, frame):
                if not self._has_pvt or not one.source.startswith("gps/"):
                    yield one
            return
        handler = self._handlers.get((frame[2], frame[3])) if protocol == UBX.name else None
        if handler is None:
            self.account.left_out[f"UBX class 0x{frame[2]:02x} message 0x{frame[3]:02x}" if protocol == UBX.name else protocol] += 1
            return
        try:
            yield from handler(frame[6:-2])
        except (struct.error, ValueError, OverflowError):
            self.account.refused[f"UBX 0x{frame[2]:02x} 0x{frame[3]:02x} with a content that is none"] += 1

    def close(self) -> Iterator[Measurement]:
        """Yield the rest."""
        yield from super().close()
        yield from self._released()

    def _pvt(self, payload: bytes) -> Iterator[Measurement]:
        yield from self._released()
        (tow, year, month, day, hour, minute, second, valid, _t_acc, nano, kind, flags, _flags2, _satellites, lon, lat, height, _sea,
         h_acc, v_acc, north, east, down, _speed, _heading, s_acc, _heading_acc, _dop) = _PVT.unpack_from(payload)  # fmt: skip
        self._has_pvt = True
        if kind not in (2, 3, 4) or not flags & 1:
            self.account.refused["no fix"] += 1
            return
        if valid & _VALID_DATE_TIME != _VALID_DATE_TIME:
            self.account.refused["fix without a valid date and time"] += 1
            return
        stamp_ns = int(datetime(year, month, day, hour, minute, min(second, 59), tzinfo=UTC).timestamp()) * SECOND + nano
        stamp_ns += SECOND * (second > 59)
        if abs(nano) > SECOND or not 0 < h_acc < 2**31 or not 0 < s_acc < 2**31 or abs(lat) > 900_000_000 or abs(lon) > 1_800_000_000:
            raise ValueError
        if not self.is_new("gps/fix", stamp_ns):
            return
        vertical = ANY_HEIGHT if kind == 2 else (1e-3 * v_acc) ** 2
        level, speed = 0.5 * (1e-3 * h_acc) ** 2, (1e-3 * s_acc) ** 2 / 3.0  # hAcc is of both axes together, sAcc of three
        place = np.radians(1e-7 * lat), np.radians(1e-7 * lon), 1e-3 * height
        fix = GpsPosition(stamp_ns, "gps/fix", *place, np.diag([level, level, vertical]))
        velocity = GpsVelocity(stamp_ns, "gps/vel", 1e-3 * np.array([north, east, down], float), speed * np.eye(3))
        self.account.origins["gps/fix"] = "NAV-PVT: 1e-7 deg, mm above the ellipsoid, sigmas of hAcc and vAcc"
        self.account.origins["gps/vel"] = "NAV-PVT: mm/s north east down, sigma of sAcc"
        self._waiting = tow, [fix, velocity]
        if not self._has_cov:
            yield from self._released()

    def _sol(self, payload: bytes) -> Iterator[Measurement]:
        """Position and velocity of the generations before NAV-PVT, in ECEF."""
        if self._has_pvt:
            return
        tow_ms, tow_ns, week, kind, flags, *numbers = _SOL.unpack_from(payload)
        parts = numbers[:3], numbers[3], numbers[4:7], numbers[7]
        place_e, accuracy_m, velocity_e, speed_accuracy = (1e-2 * np.array(part, float) for part in parts)
        if kind not in (2, 3, 4) or flags & 0b1101 != 0b1101 or week <= 0 or not 6.2e6 < np.linalg.norm(place_e) < 6.5e6:
            self.account.refused["no fix, or one without a valid time"] += 1
            return
        stamp_ns = unix_ns(from_week(week, 1e-3 * tow_ms) + tow_ns)
        if not self.is_new("gps/fix", stamp_ns):
            return
        lat, lon, height = ecef_to_geodetic(place_e)
        level, speed = float(accuracy_m) ** 2 / 3.0, float(speed_accuracy) ** 2 / 3.0  # both of three axes together
        self.account.origins["gps/fix"] = "NAV-SOL: cm in ECEF, sigma of pAcc"
        self.account.origins["gps/vel"] = "NAV-SOL: cm/s in ECEF, sigma of sAcc"
        vertical = ANY_HEIGHT if kind == 2 else 2.0 * level
        yield GpsPosition(stamp_ns, "gps/fix", lat, lon, height, np.diag([level, level, vertical]))
        yield GpsVelocity(stamp_ns, "gps/vel", dcm_ne(lat, lon) @ velocity_e, speed * np.eye(3))

    def _cov_of(self, payload: bytes) -> Iterator[Measurement]:
        """Covariances of the epoch that waits for them; a stream that has them once is waited for from then on."""
        tow, _version, position_valid, velocity_valid, *values = _COV.unpack_from(payload)
        self._has_cov = True
        if self._waiting is None or self._waiting[0] != tow or not position_valid or not velocity_valid or not np.all(np.isfinite(values)):
            return
        fix, velocity = self._waiting[1]
        for one, (nn, ne, nd, ee, ed, dd) in ((fix, values[:6]), (velocity, values[6:])):
            cov = np.array([[nn, ne, nd], [ne, ee, ed], [nd, ed, dd]])
            if min(nn, ee, dd) > 0.0 and np.linalg.eigvalsh(cov)[0] > 0.0:
                one.cov_n[:] = cov
        self.account.origins["gps/fix"] = "NAV-PVT: 1e-7 deg, mm above the ellipsoid, covariance of NAV-COV"
        self.account.origins["gps/vel"] = "NAV-PVT: mm/s north east down, covariance of NAV-COV"
        yield from self._released()

    def _released(self) -> Iterator[Measurement]:
        waiting, self._waiting = self._waiting, None
        yield from waiting[1] if waiting else ()

    def _sfrbx(self, payload: bytes) -> Iterator[Measurement]:
        system, sat_id, signal, _frequency, count = payload[0:5]
        words = struct.unpack_from(f"<{count}I", payload, 8)
        if self._near_gps is not None and _SYSTEMS.get(system) == GPS and signal == 0:
            self._subframes.gps(sat_id, words, self._near_gps)
        elif self._near_gps is not None and _SYSTEMS.get(system) == GALILEO and signal == 1:
            self._subframes.galileo(sat_id, words, self._near_gps)
        yield from ()

    def _rawx(self, payload: bytes) -> Iterator[Measurement]:
        tow_s, week, _leap, count = struct.unpack_from("<dHbB", payload)
        if count == 0 or week == 0 or not 0.0 <= tow_s <= WEEK_S:
            self.account.refused["raw epoch without a time or a satellite"] += 1
            return
        signals = np.frombuffer(payload, _SIGNAL, count, 16)
        self._near_gps = from_week(week, tow_s)
        if not self.is_locating:
            return
        raw = raw_epoch(self._near_gps, signals)
        if not len(raw):
            self.account.refused["raw epoch without code on GPS L1 or Galileo E1"] += 1
            return
        located = self._follower.take(screened(raw, self.account.refused))
        for _, sentence in self._follower.out.remarks:
            self.account.remark(sentence)
        self._follower.out.remarks.clear()
        if located.epoch is None:
            self.account.refused["raw epoch before a first position from its ephemerides"] += 1
        elif self.is_new("gnss/raw", located.epoch.stamp_ns):
            self.account.origins["gnss/raw"] = "RXM-RAWX: code and Doppler of GPS L1 C/A and Galileo E1, ephemerides of RXM-SFRBX"
            yield located.epoch


def raw_epoch(gps_ns: int, signals: np.ndarray) -> RawEpoch:
    """Return what navigators use of the signals of a RAWX message: valid codes of GPS L1 C/A and Galileo E1, one a satellite."""
    usable = (signals["system"] == 0) & (signals["signal"] == 0) | (signals["system"] == 2) & (signals["signal"] <= 1)
    rows = signals[usable & (signals["status"] & 1 == 1) & np.isfinite(signals["doppler"]) & np.isfinite(signals["pseudorange"])]
    _, first = np.unique(rows["system"].astype(int) << 8 | rows["sat_id"], return_index=True)
    rows = rows[first]
    doppler = -L1_WAVELENGTH_M * rows["doppler"].astype(float)
    systems = np.array([_SYSTEMS[int(system)] for system in rows["system"]], "U1")
    return RawEpoch(gps_ns, systems, rows["sat_id"].astype(int), rows["pseudorange"].astype(float), doppler, rows["cn0"].astype(float))
