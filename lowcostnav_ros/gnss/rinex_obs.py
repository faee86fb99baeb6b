"""Pseudoranges and Dopplers of GPS L1 and Galileo E1 from RINEX observation files, versions 2 and 3."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.gps_time import SECOND, from_calendar
from lowcostnav_ros.gnss.raw_epoch import RawEpoch, screened
from lowcostnav_ros.gnss.rinex import Header, number, read_header
from lowcostnav_ros.gnss.signals import GALILEO, GPS, L1_WAVELENGTH_M, SYSTEM_NAMES

_CODES_3 = {GPS: "CSLXPWYM", GALILEO: "CXBZA"}
"""Tracking modes of band 1, best first."""
_EVENT_HEADER = {2, 3, 4, 5}
_KEPT_SHARE = 0.1
"""Share of the epochs that must keep the header's interval for it to be accepted."""


@dataclass(slots=True)
class Observations:
    """An observation file.

    Attributes
    ----------
    epochs : list of RawEpoch
    approx_position_e : ndarray, shape (3,), or None
        Of the header, ECEF, m.
    interval_s : float or None
        Of the header, or the median spacing of the epochs where the header has none that they keep; None where neither is known.
    interval_inferred : bool
        Whether it is the median spacing.
    missing_epochs : int
        Epochs that the interval promises and the file does not hold.
    holes : int
        Stretches without epochs that these make up.
    rejected : Counter
        Observations and epochs rejected, by reason.
    remarks : list of str
        One sentence each.
    """

    epochs: list[RawEpoch] = field(default_factory=list)
    approx_position_e: np.ndarray | None = None
    interval_s: float | None = None
    interval_inferred: bool = False
    missing_epochs: int = 0
    holes: int = 0
    rejected: Counter = field(default_factory=Counter)
    remarks: list[str] = field(default_factory=list)


def parse_observations(text: str) -> Observations:
    """Read a RINEX observation file; code C/A of L1 (C1, C1C) or the E1 code of Galileo, and the Doppler that goes with it.

    Raises
    ------
    GnssError
        For another kind or version of file, another time scale than GPS, no code on L1, or no epoch at all.
    """
    lines = text.splitlines()
    header, first = read_header(lines, "O")
    scale = (header.first("TIME OF FIRST OBS") or "")[48:51].strip()
    if scale not in ("", "GPS", "GAL"):
        raise GnssError(f"The file counts time in {scale}; convert it to GPS time.")
    read = _Version3(header) if header.version >= 3.0 else _Version2(header)
    out = Observations(interval_s=_positive(header.first("INTERVAL")), approx_position_e=_position(header))
    for epoch in read.epochs(lines, first, out.rejected):
        _append(out, epoch)
    if not out.epochs:
        raise GnssError("The observation file holds no usable epoch; get another.")
    _count_missing(out)
    return out


def _append(out: Observations, epoch: RawEpoch) -> None:
    if out.epochs and epoch.gps_ns <= out.epochs[-1].gps_ns:
        out.rejected["epoch not after the one before"] += 1
        return
    out.epochs.append(screened(epoch, out.rejected))


def _count_missing(out: Observations) -> None:
    """Count the epochs that are not there, against the header's interval or, without one, the median spacing."""
    steps_s = np.diff([epoch.gps_ns for epoch in out.epochs]) / SECOND
    if not steps_s.size:
        return
    stated_s, median_s = out.interval_s, float(np.median(steps_s))
    if stated_s and np.mean(np.abs(steps_s - stated_s) < 0.1 * stated_s) < _KEPT_SHARE:  # a thinned file that kept its header
        out.remarks.append(f"The header states an interval of {stated_s:g} s, but the epochs are {median_s:g} s apart, which is used.")
        stated_s = None
    out.interval_s, out.interval_inferred = stated_s or median_s, stated_s is None
    absent = np.maximum(np.rint(steps_s / out.interval_s).astype(int) - 1, 0)
    out.missing_epochs, out.holes = int(absent.sum()), int(np.count_nonzero(absent))


def _positive(line: str | None) -> float | None:
    value = number(line[0:10]) if line else 0.0
    return value if value > 0.0 else None


def _position(header: Header) -> np.ndarray | None:
    line = header.first("APPROX POSITION XYZ")
    if line is None:
        return None
    xyz = np.array([number(line[14 * k : 14 * (k + 1)]) for k in range(3)])
    return xyz if np.all(np.isfinite(xyz)) and np.linalg.norm(xyz) > 6.0e6 else None


def _value(text: str, index: int, start: int = 0) -> float:
    value = number(text[start + 16 * index : start + 16 * index + 14])
    return float("nan") if value == 0.0 else value  # zero stands for "not measured" in both versions


def _raw(gps: int, rows: list[tuple[str, int, float, float, float]]) -> RawEpoch:
    columns = list(zip(*rows, strict=True)) if rows else [()] * 5
    doppler = -L1_WAVELENGTH_M * np.array(columns[3], float)  # a Doppler is positive when approaching
    cn0 = np.nan_to_num(np.array(columns[4], float))
    return RawEpoch(gps, np.array(columns[0], "U1"), np.array(columns[1], int), np.array(columns[2], float), doppler, cn0)


class _Version2:
    """Epochs of version 2: one list of types for all systems, five values a line, satellites on the epoch line."""

    def __init__(self, header: Header) -> None:
        listed = header.lines.get("# / TYPES OF OBSERV", [])
        self.types = [t for line in listed for t in line[6:60].split()]
        if "C1" not in self.types:
            raise GnssError(f"The file has no C/A code on L1 (C1), only {', '.join(self.types) or 'nothing'}; convert it with C1.")
        self.index = {t: k for k, t in enumerate(self.types)}
        self.lines_per_satellite = -(-len(self.types) // 5)

    def epochs(self, lines: list[str], at: int, rejected: Counter) -> Iterator[RawEpoch]:
        while at < len(lines):
            line = lines[at]
            at += 1
            flag, count = number(line[26:29]), number(line[29:32])
            if not line.strip() or not (flag == flag and count == count):
                rejected.update(["unreadable line"] if line.strip() else [])
                continue
            if int(flag) in _EVENT_HEADER:
                at += int(count)  # header records in the middle of the data
                continue
            satellites = line[32:68]
            for _ in range((int(count) - 1) // 12):
                satellites += lines[at][32:68] if at < len(lines) else ""
                at += 1
            body, at = lines[at : at + int(count) * self.lines_per_satellite], at + int(count) * self.lines_per_satellite
            if int(flag) == 6:
                continue  # cycle slips, not observations
            if len(body) < int(count) * self.lines_per_satellite:
                rejected["epoch cut off"] += 1
                return
            yield from self._epoch(line, satellites, body, rejected)

    def _epoch(self, line: str, satellites: str, body: list[str], rejected: Counter) -> Iterator[RawEpoch]:
        try:
            year, month, day, hour, minute = (int(line[k : k + 3]) for k in (0, 3, 6, 9, 12))
            gps = from_calendar(year, month, day, hour, minute, float(line[15:26]))
        except ValueError:
            rejected["impossible date"] += 1
            return
        rows = []
        for k in range(len(body) // self.lines_per_satellite):
            system, sat_id = satellites[3 * k : 3 * k + 1].strip() or GPS, number(satellites[3 * k + 1 : 3 * k + 3])
            if system not in (GPS, GALILEO):
                rejected[f"{SYSTEM_NAMES.get(system, 'unknown system')} is not used"] += 1
                continue
            text = "".join(one.ljust(80)[:80] for one in body[k * self.lines_per_satellite : (k + 1) * self.lines_per_satellite])
            code, doppler, strength = (_value(text, self.index[t]) if t in self.index else float("nan") for t in ("C1", "D1", "S1"))
            if code == code and sat_id == sat_id:
                rows.append((system, int(sat_id), code, doppler, strength))
            else:
                rejected["no code on L1"] += 1
        yield _raw(gps, rows)


class _Version3:
    """Epochs of version 3: types by system, one line a satellite."""

    def __init__(self, header: Header) -> None:
        self.columns: dict[str, tuple[int, int | None, int | None]] = {}
        types: dict[str, list[str]] = {}
        system = ""
        for line in header.lines.get("SYS / # / OBS TYPES", []):
            system = line[0:1].strip() or system
            types.setdefault(system, []).extend(line[6:60].split())
        for system, modes in _CODES_3.items():
            listed = types.get(system, [])
            mode = next((m for m in modes if f"C1{m}" in listed), None)
            if mode:
                doppler, strength = (listed.index(f"{k}1{mode}") if f"{k}1{mode}" in listed else None for k in "DS")
                self.columns[system] = listed.index(f"C1{mode}"), doppler, strength
        if not self.columns:
            raise GnssError("The file has no code on GPS L1 or Galileo E1; convert it with C1C.")

    def epochs(self, lines: list[str], at: int, rejected: Counter) -> Iterator[RawEpoch]:
        while at < len(lines):
            line = lines[at]
            at += 1
            count = number(line[32:35])
            if not line.startswith(">") or count != count:
                rejected.update(["unreadable line"] if line.strip() else [])
                continue
            body, at = lines[at : at + int(count)], at + int(count)
            if line[31:32].strip() not in ("", "0", "1"):
                continue
            if len(body) < count:
                rejected["epoch cut off"] += 1
                return
            yield from self._epoch(line, body, rejected)

    def _epoch(self, line: str, body: list[str], rejected: Counter) -> Iterator[RawEpoch]:
        try:
            year, month, day, hour, minute = (int(t) for t in line[1:18].split())
            gps = from_calendar(year, month, day, hour, minute, float(line[18:29]))
        except ValueError:
            rejected["impossible date"] += 1
            return
        rows = []
        for text in body:
            system, sat_id = text[0:1], number(text[1:3])
            if system not in self.columns:
                rejected[f"{SYSTEM_NAMES.get(system, 'unknown system')} is not used"] += 1
                continue
            code, doppler, strength = (float("nan") if c is None else _value(text, c, 3) for c in self.columns[system])
            if code == code and sat_id == sat_id:
                rows.append((system, int(sat_id), code, doppler, strength))
            else:
                rejected["no code on L1"] += 1
        yield _raw(gps, rows)
