"""Broadcast navigation messages, bit by bit: the GPS L1 C/A subframes and the Galileo E1-B pages of a receiver, to ephemerides.

References
----------
IS-GPS-200, figures 20-1 and tables 20-I, 20-III, 20-X; Galileo OS SIS ICD 2.0, tables 35 to 52.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.ephemeris import VALID_S, Ephemeris
from lowcostnav_ros.gnss.gps_time import nearest_tow
from lowcostnav_ros.gnss.ionosphere import Klobuchar
from lowcostnav_ros.gnss.rinex_nav import Navigation
from lowcostnav_ros.gnss.signals import GALILEO, GPS

_URA_M = (2.4, 3.4, 4.85, 6.85, 9.65, 13.65, 24.0, 48.0, 96.0, 192.0, 384.0, 768.0, 1536.0, 3072.0, 6144.0)
_IONOSPHERE_PAGE = 56
_CRC24Q = 0x1864CFB


@dataclass(frozen=True, slots=True)
class Bits:
    """A message as one number of ``size`` bits, the first sent the most significant."""

    value: int
    size: int

    def u(self, start: int, n: int) -> int:
        """Unsigned number of ``n`` bits from ``start``."""
        return self.value >> (self.size - start - n) & (1 << n) - 1

    def s(self, start: int, n: int, exponent: int, scale: float = 1.0) -> float:
        """Number in two's complement times 2^``exponent`` times ``scale``."""
        number = self.u(start, n)
        return math.ldexp(number - (1 << n if number >> (n - 1) else 0), exponent) * scale

    def long(self, start: int, n: int, exponent: int, scale: float = 1.0) -> float:
        """Unsigned number times 2^``exponent`` times ``scale``."""
        return math.ldexp(self.u(start, n), exponent) * scale


@dataclass(slots=True)
class SubframeReader:
    """Collects the parts of each satellite's message and adds what is complete to ``navigation``."""

    navigation: Navigation
    _gps: dict[int, dict[int, Bits]] = field(default_factory=dict)
    _galileo: dict[int, dict[int, Bits]] = field(default_factory=dict)
    _built: dict[tuple[str, int], tuple[int, ...]] = field(default_factory=dict)

    def gps(self, sat_id: int, words: Sequence[int], near_gps: int) -> None:
        """Take a subframe of ten words of 30 bits, the parity the last six, near a GPS time in ns."""
        if len(words) < 10 or not 1 <= sat_id <= 32:
            return
        value = 0
        for word in words[:10]:
            value = value << 24 | word >> 6 & 0xFFFFFF
        frame = Bits(value, 240)
        number = frame.u(43, 3)
        if number == 4 and frame.u(50, 6) == _IONOSPHERE_PAGE:
            self.navigation.klobuchar = _klobuchar(frame)
        if number in (1, 2, 3):
            parts = self._gps.setdefault(sat_id, {})
            parts[number] = frame
            if len(parts) == 3:
                issues = parts[1].u(168, 8), parts[2].u(48, 8), parts[3].u(216, 8)
                if len(set(issues)) == 1:
                    self._add(GPS, sat_id, (*issues, parts[2].u(216, 16)), lambda: _gps_ephemeris(sat_id, parts, near_gps))

    def galileo(self, sat_id: int, words: Sequence[int], near_gps: int) -> None:
        """Take an I/NAV page of eight words of 32 bits, the even half in the first four, near a GPS time in ns."""
        if len(words) < 8 or not 1 <= sat_id <= 36:
            return
        even, odd = (Bits(sum(word << 32 * (3 - k) for k, word in enumerate(words[at : at + 4])), 128) for at in (0, 4))
        if even.u(0, 1) or not odd.u(0, 1) or even.u(1, 1) or crc24q(even.u(0, 114) << 82 | odd.u(0, 82), 196) != odd.u(82, 24):
            return
        page = Bits(even.u(2, 112) << 16 | odd.u(2, 16), 128)
        number = page.u(0, 6)
        if not 1 <= number <= 5:
            return
        parts = self._galileo.setdefault(sat_id, {})
        parts[number] = page
        if len(parts) == 5:
            issues = tuple(parts[k].u(6, 10) for k in (1, 2, 3, 4))
            if len(set(issues)) == 1:
                self._add(GALILEO, sat_id, (*issues, parts[1].u(16, 14)), lambda: _galileo_ephemeris(sat_id, parts, near_gps))

    def _add(self, system: str, sat_id: int, issue: tuple[int, ...], build: Callable[[], Ephemeris | None]) -> None:
        """Build an ephemeris once for each issue."""
        if self._built.get((system, sat_id)) == issue:
            return
        try:
            ephemeris = build()
        except GnssError:
            self.navigation.rejected["impossible record"] += 1
            return
        if ephemeris is not None:
            self._built[system, sat_id] = issue
            self.navigation.store.add(ephemeris)


def _gps_ephemeris(sat_id: int, parts: dict[int, Bits], near_gps: int) -> Ephemeris | None:
    one, two, three = parts[1], parts[2], parts[3]
    accuracy = one.u(60, 4)
    if accuracy >= len(_URA_M):
        return None
    toe, toc = (nearest_tow(16.0 * seconds, near_gps) for seconds in (two.u(216, 16), one.u(176, 16)))
    pi = math.pi
    return Ephemeris(
        GPS, sat_id, toe, toc,
        sqrt_a=two.long(184, 32, -19), eccentricity=two.long(136, 32, -33), mean_anomaly=two.s(88, 32, -31, pi),
        node=three.s(64, 32, -31, pi), inclination=three.s(112, 32, -31, pi), perigee=three.s(160, 32, -31, pi),
        node_rate=three.s(192, 24, -43, pi), inclination_rate=three.s(224, 14, -43, pi), motion_correction=two.s(72, 16, -43, pi),
        cuc=two.s(120, 16, -29), cus=two.s(168, 16, -29), crc=three.s(144, 16, -5), crs=two.s(56, 16, -5),
        cic=three.s(48, 16, -29), cis=three.s(96, 16, -29),
        af0=one.s(216, 22, -31), af1=one.s(200, 16, -43), af2=one.s(192, 8, -55), group_delay_s=one.s(160, 8, -31),
        ura_m=_URA_M[accuracy], healthy=one.u(64, 6) == 0, issue=two.u(48, 8), valid_s=VALID_S[GPS],
    )  # fmt: skip


def _klobuchar(frame: Bits) -> Klobuchar:
    alpha = (frame.s(56, 8, -30), frame.s(64, 8, -27), frame.s(72, 8, -24), frame.s(80, 8, -24))
    beta = (frame.s(88, 8, 11), frame.s(96, 8, 14), frame.s(104, 8, 16), frame.s(112, 8, 16))
    return Klobuchar(alpha, beta)


def _galileo_ephemeris(sat_id: int, parts: dict[int, Bits], near_gps: int) -> Ephemeris | None:
    one, two, three, four, five = (parts[k] for k in range(1, 6))
    accuracy = _sisa_m(three.u(120, 8))
    if accuracy is None:
        return None
    toe, toc = (nearest_tow(60.0 * seconds, near_gps) for seconds in (one.u(16, 14), four.u(54, 14)))
    pi = math.pi
    return Ephemeris(
        GALILEO, sat_id, toe, toc,
        sqrt_a=one.long(94, 32, -19), eccentricity=one.long(62, 32, -33), mean_anomaly=one.s(30, 32, -31, pi),
        node=two.s(16, 32, -31, pi), inclination=two.s(48, 32, -31, pi), perigee=two.s(80, 32, -31, pi),
        node_rate=three.s(16, 24, -43, pi), inclination_rate=two.s(112, 14, -43, pi), motion_correction=three.s(40, 16, -43, pi),
        cuc=three.s(56, 16, -29), cus=three.s(72, 16, -29), crc=three.s(88, 16, -5), crs=three.s(104, 16, -5),
        cic=four.s(22, 16, -29), cis=four.s(38, 16, -29),
        af0=four.s(68, 31, -34), af1=four.s(99, 21, -46), af2=four.s(120, 6, -59), group_delay_s=five.s(57, 10, -32),
        ura_m=accuracy, healthy=five.u(69, 2) == 0 and five.u(72, 1) == 0, issue=one.u(6, 10), valid_s=VALID_S[GALILEO],
    )  # fmt: skip


def _sisa_m(index: int) -> float | None:
    """Signal in space accuracy, m; None where there is no prediction."""
    for first, base, step in ((100, 2.0, 0.16), (75, 1.0, 0.04), (50, 0.5, 0.02), (0, 0.0, 0.01)):
        if index >= first:
            return max(base + (index - first) * step, 1.0) if index <= 125 else None
    return None


def crc24q(value: int, size: int) -> int:
    """Check sum of ``size`` bits, as Galileo pages and RTCM messages carry it."""
    register = value << 24
    for bit in range(size + 23, 23, -1):
        if register >> bit & 1:
            register ^= _CRC24Q << (bit - 24)
    return register
