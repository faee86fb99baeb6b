"""Broadcast ephemerides from RINEX navigation files, versions 2 (GPS) and 3 (GPS and Galileo I/NAV of a mixed file)."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.ephemeris import VALID_S, Ephemeris, EphemerisStore
from lowcostnav_ros.gnss.gps_time import WEEK_NS, from_calendar, leap_second_conflict, nearest_tow
from lowcostnav_ros.gnss.ionosphere import Klobuchar
from lowcostnav_ros.gnss.rinex import Header, number, read_header
from lowcostnav_ros.gnss.signals import GALILEO, GPS, SYSTEM_NAMES

_INAV_BITS = 0b101
"""Data sources E1-B and E5b-I: the clock and group delay of the E1 user."""
_NUMBERS, _REQUIRED = 27, 20  # clock and six lines of orbit; from the codes on L2 on, fields are blank in some files


@dataclass(slots=True)
class Navigation:
    """A navigation file: ephemerides, ionosphere model, what was rejected (counted by reason) and remarks in sentences."""

    store: EphemerisStore
    klobuchar: Klobuchar | None
    rejected: Counter
    remarks: list[str] = field(default_factory=list)


def parse_navigation(text: str) -> Navigation:
    """Read a RINEX navigation file.

    Raises
    ------
    GnssError
        For another kind or version of file, or one in which no ephemeris can be used.
    """
    lines = text.splitlines()
    header, first = read_header(lines, "N")
    rejected: Counter[str] = Counter()
    store = EphemerisStore()
    for record in _records(lines[first:]):
        ephemeris, reason = _ephemeris(record, header.version)
        if ephemeris is None:
            rejected[reason] += 1
        else:
            rejected.update([reason] if reason else [])
            store.add(ephemeris)
    if not len(store):
        reasons = ", ".join(f"{count} x {reason}" for reason, count in rejected.items()) or "it has no records"
        raise GnssError(f"The navigation file holds no usable GPS or Galileo ephemeris ({reasons}); get another.")
    return Navigation(store, header.klobuchar(), rejected + store.rejected, _remarks(header, store))


def joined(parts: Sequence[Navigation]) -> Navigation:
    """Several navigation files as one, such as one for each system; the ionosphere model is the first there is."""
    store = EphemerisStore(ephemeris for part in parts for ephemeris in part.store)
    rejected = sum((part.rejected for part in parts), store.rejected)
    klobuchar = next((part.klobuchar for part in parts if part.klobuchar is not None), None)
    return Navigation(store, klobuchar, rejected, list(dict.fromkeys(remark for part in parts for remark in part.remarks)))


def _remarks(header: Header, store: EphemerisStore) -> list[str]:
    announced = header.leap_seconds()
    system, sat_id = store.satellites()[0]
    conflict = leap_second_conflict(announced, store.latest(system, sat_id).toe_ns) if announced is not None else ""
    return [conflict] if conflict else []


def _records(lines: list[str]) -> list[list[str]]:
    """Group lines into records: a record begins where the satellite's columns are not blank."""
    records: list[list[str]] = []
    for line in lines:
        if line[0:3].strip():
            records.append([line])
        elif records and line.strip():
            records[-1].append(line)
    return records


def _ephemeris(record: list[str], version: float) -> tuple[Ephemeris | None, str]:
    """Ephemeris of a record, or None, and a reason to count (a corrected week is counted too)."""
    head = record[0]
    system = head[0] if version >= 3.0 else GPS
    if system not in (GPS, GALILEO):
        return None, f"{SYSTEM_NAMES.get(system, 'unknown system')} is not used"
    values = _numbers(record, 4 if version >= 3.0 else 3)
    if len(values) < _NUMBERS or any(math.isnan(v) for v in values[:_REQUIRED]):
        return None, "incomplete record"
    try:
        sat_id = int(head[1:3] if version >= 3.0 else head[0:2])
        toc = from_calendar(*_date(head, version))
        return _build(system, sat_id, toc, values)
    except ValueError:  # GnssError is one: no such date, no orbit
        return None, "impossible record"


def _numbers(record: list[str], start: int) -> list[float]:
    """The three clock numbers of the first line and all numbers of the lines after it, NaN where blank."""
    values = [number(record[0][start + 19 * k : start + 19 * (k + 1)]) for k in range(1, 4)]
    for line in record[1:]:
        values += [number(line[start + 19 * k : start + 19 * (k + 1)]) for k in range(4)]
    return values


def _date(head: str, version: float) -> tuple[int, int, int, int, int, float]:
    parts = (head[4:23] if version >= 3.0 else head[2:22]).split()
    year, month, day, hour, minute = (int(p) for p in parts[:5])
    return year, month, day, hour, minute, float(parts[5])


def _build(system: str, sat_id: int, toc: int, v: list[float]) -> tuple[Ephemeris | None, str]:
    (af0, af1, af2), (issue, crs, dn, m0), (cuc, e, cus, root) = v[0:3], v[3:7], v[7:11]
    (toe_s, cic, node, cis), (i0, crc, perigee, node_rate) = v[11:15], v[15:19]
    idot, source, week = v[19], v[20], v[21]
    ura, health, delay = v[23], v[24], v[25]
    if system == GALILEO:
        if math.isnan(source):
            return None, "incomplete record"
        if not int(source) & _INAV_BITS:
            return None, "Galileo F/NAV is not used"
        delay = v[26]
    if not ura >= 0.0:  # -1 and NaN: no accuracy prediction
        return None, "no accuracy stated"
    toe = nearest_tow(toe_s, toc)
    corrected = "" if toe // WEEK_NS == week else "week number corrected from the date"
    orbit = (root, e, m0, node, i0, perigee, node_rate, idot, dn, cuc, cus, crc, crs, cic, cis)
    rest = (0.0 if math.isnan(delay) else delay, max(ura, 1.0), health == 0.0, int(issue), VALID_S[system])
    return Ephemeris(system, sat_id, toe, toc, *orbit, af0, af1, af2, *rest), corrected
