"""A located recording of satellite observations in numbers: a summary, tables on the terminal, one CSV row per epoch."""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.gnss.gps_time import SECOND, unix_ns, week_and_tow
from lowcostnav_ros.gnss.raim import RaimResult
from lowcostnav_ros.gnss.rinex_nav import Navigation
from lowcostnav_ros.gnss.rinex_obs import Observations
from lowcostnav_ros.gnss.track import Located, Track
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic
from lowcostnav_ros.report.gnss.words import SPREAD, date, spread
from lowcostnav_ros.report.terminal import print_report

ELSEWHERE_M = 1000.0
"""Median distance from the header's coordinates above which they cannot be those of a receiver at rest."""
MOST_REMARKS = 6


@dataclass(frozen=True, slots=True, eq=False)
class TrackSummary:
    """A recording, what became of it, and its errors.

    Attributes
    ----------
    name : str
    observations : Observations
    navigation : Navigation
    track : Track
    reference_e : ndarray, shape (3,), or None
        Header coordinates, ECEF, m.
    errors_n : ndarray, shape (n, 3)
        Of all epochs, NED, m: from the reference, or from the median position without one; NaN without a usable position.
    """

    name: str
    observations: Observations
    navigation: Navigation
    track: Track
    reference_e: np.ndarray | None
    errors_n: np.ndarray

    @property
    def results(self) -> list[RaimResult]:
        """Results of the epochs whose position can be used."""
        return [one.result for one in self.track.located if one.usable and one.result]

    def compared_n(self) -> np.ndarray:
        """Errors (n, 3), NED, m, of the epochs with a usable position; none without coordinates to compare with."""
        return self.errors_n[np.isfinite(self.errors_n[:, 0])] if self.reference_e is not None else np.zeros((0, 3))


def summarise(name: str, observations: Observations, navigation: Navigation, track: Track) -> TrackSummary:
    """Put a located recording together with the errors against the coordinates in its header."""
    places = epochs_of(track, lambda result: result.fix.position_e, 3)
    reference = observations.approx_position_e
    errors = np.full_like(places, math.nan)
    if np.isfinite(places).any():
        origin = np.nanmedian(places, axis=0) if reference is None else reference
        errors = (places - origin) @ dcm_ne(*ecef_to_geodetic(origin)[:2]).T
    return TrackSummary(name, observations, navigation, track, reference, errors)


def epochs_of(track: Track, value: Callable[[RaimResult], Any], width: int) -> np.ndarray:
    """A value of every epoch's result, NaN where its position cannot be used, shape (n, width)."""
    rows = [value(one.result) if one.usable and one.result else math.nan for one in track.located]
    return np.array([np.broadcast_to(row, width) for row in rows], dtype=float).reshape(-1, width)


def print_track(summary: TrackSummary) -> None:
    """Print the tables and sentences."""
    print_report(heading(summary), (spread_table(summary), error_table(summary)), sentences(summary))


def heading(summary: TrackSummary) -> str:
    """Name, time and number of epochs in a line."""
    located = summary.track.located
    return f"{summary.name}: {len(located)} epochs, {date(located[0].gps_ns)} to {date(located[-1].gps_ns)} GPS time"


def spread_table(summary: TrackSummary) -> Table:
    """Smallest, median, 95 % and largest of satellites, dilutions and protection levels."""
    good = summary.results
    columns: dict[str, tuple[list[float], int]] = {
        "satellites observed": ([one.satellites for one in summary.track.located], 0),
        "satellites used": ([len(result.fix.rows) for result in good], 0),
    }
    columns |= {dop.upper(): ([getattr(result.fix.dops, dop) for result in good], 2) for dop in ("hdop", "vdop", "pdop")}
    columns |= {"HPL, m": ([result.hpl_m for result in good], 1), "VPL, m": ([result.vpl_m for result in good], 1)}
    rows = [(name, *spread(values, digits)) for name, (values, digits) in columns.items() if len(values)]
    return Table.plain("Satellites, dilutions, protection levels", ("", *SPREAD), rows)


def error_table(summary: TrackSummary) -> Table:
    """RMS, mean and largest error and the stated sigma, north, east, down and 3D; no row without coordinates to compare with."""
    errors = summary.compared_n()
    title, heads = "Position minus the coordinates in the header", ("", "north", "east", "down", "3D")
    if not len(errors):
        return Table.plain(title, heads, ())
    rms, mean, largest = np.sqrt(np.mean(errors**2, axis=0)), errors.mean(axis=0), np.abs(errors).max(axis=0)
    stated = np.sqrt(np.mean([np.diag(result.fix.cov_n) for result in summary.results], axis=0))
    rows = {
        "RMS, m": (*rms, np.linalg.norm(rms)),
        "mean, m": (*mean, np.linalg.norm(mean)),
        "largest, m": (*largest, np.linalg.norm(errors, axis=1).max()),
        "stated 1-sigma, m": (*stated, np.linalg.norm(stated)),
    }
    return Table.plain(title, heads, [(name, *(f"{value:.2f}" for value in values)) for name, values in rows.items()])


def sentences(summary: TrackSummary) -> list[str]:
    """Integrity, what was not used and why, the clock: what the tables do not show."""
    track, observations = summary.track, summary.observations
    verdicts = track.verdicts()
    lines = [f"Integrity: {counted(verdicts)}.", *_refusals(track), *_epochs_sentences(observations)]
    if excluded := _excluded(track):
        lines.append(f"Contradicted the others and excluded: {excluded}.")
    unused = {"Satellites": track.rejected, "Observations": observations.rejected, "Ephemerides": summary.navigation.rejected}
    lines += [f"{what} not used: {counted(rejected)}." for what, rejected in unused.items() if rejected]
    lines += [*_clock_sentences(track), *observations.remarks, *summary.navigation.remarks]
    if summary.navigation.klobuchar is None:
        lines.append("The navigation files hold no ionosphere model; several metres of delay remain, most of it in height.")
    if summary.reference_e is not None and np.isfinite(summary.errors_n).any():
        away = float(np.nanmedian(np.linalg.norm(summary.errors_n, axis=1)))
        if away > ELSEWHERE_M:
            lines.append(f"The receiver was {away / 1000.0:.0f} km from the coordinates in the header; they are no reference for it.")
    return lines


def _refusals(track: Track) -> list[str]:
    first: dict[str, tuple[int, int]] = {}
    for one in (one for one in track.located if one.refusal):
        gps_ns, count = first.get(one.refusal, (one.gps_ns, 0))
        first[one.refusal] = gps_ns, count + 1
    lines = [f"{count} {_epochs(count)} without a position, the first at {date(at)}: {why}" for why, (at, count) in first.items()]
    return [*lines[:MOST_REMARKS], *_more(len(lines) - MOST_REMARKS, "more reasons for no position")]


def _epochs(count: int) -> str:
    return "epoch" if count == 1 else "epochs"


def _more(count: int, what: str) -> list[str]:
    return [f"... and {count} {what}."] if count > 0 else []


def _epochs_sentences(observations: Observations) -> list[str]:
    if observations.interval_s is None:
        return []
    source = "their median spacing, the header has no interval that fits" if observations.interval_inferred else "the header's interval"
    every = f"every {observations.interval_s:g} s ({source})"
    if not observations.missing_epochs:
        return [f"Epochs {every}; none is missing."]
    holes = "one hole" if observations.holes == 1 else f"{observations.holes} holes"
    return [f"Epochs {every}; {observations.missing_epochs} are missing, in {holes}."]


def _excluded(track: Track) -> str:
    names = sorted({one.result.excluded for one in track.located if one.result and one.result.excluded})
    return ", ".join(f"{n} in {sum(1 for o in track.located if o.result and o.result.excluded == n)} epochs" for n in names)


def _clock_sentences(track: Track) -> list[str]:
    lines = [f"{date(gps_ns)}: {sentence}" for gps_ns, sentence in track.remarks[:MOST_REMARKS]]
    lines += _more(len(track.remarks) - MOST_REMARKS, "more like these about the receiver's clock")
    if track.resets:
        lines.append(f"The receiver set its clock in {track.resets} {_epochs(track.resets)} in all.")
    if track.runaway_epochs:
        lines.append(f"The receiver clock ran away at {track.runaway_epochs} of {len(track.located)} epochs.")
    return lines


HEAD = [
    "stamp_s", "gps_week", "gps_tow_s", "verdict", "lat_deg", "lon_deg", "height_m", "sigma_north_m", "sigma_east_m", "sigma_down_m",
    "clock_m", "satellites", "used", "hdop", "vdop", "pdop", "hpl_m", "vpl_m", "vel_north_mps", "vel_east_mps", "vel_down_mps",
    "error_north_m", "error_east_m", "error_down_m", "excluded", "reason",
]  # fmt: skip


def write_csv(summary: TrackSummary, path: Path) -> None:
    """Write one row per epoch; a cell without a number is empty, errors are there where the header has coordinates.

    ``stamp_s`` is the time of validity, UTC since 1970: the receiver's own time less its clock error.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(HEAD)
        for one, error in zip(summary.track.located, summary.errors_n, strict=True):
            cells = _cells(one, error if summary.reference_e is not None else None)
            out.writerow([cells.get(name, "") for name in HEAD])


def _cells(one: Located, error_n: np.ndarray | None) -> dict[str, Any]:
    week, tow_s = week_and_tow(one.gps_ns)
    stamp_ns = one.epoch.stamp_ns if one.epoch is not None else unix_ns(one.gps_ns)
    cells: dict[str, Any] = {
        "stamp_s": f"{stamp_ns // SECOND}.{stamp_ns % SECOND:09d}", "gps_week": week, "gps_tow_s": f"{tow_s:.7f}",
        "verdict": one.verdict, "satellites": one.satellites, "reason": one.refusal,
    }  # fmt: skip
    if one.result is None:
        return cells
    fix = one.result.fix
    cells |= {"excluded": one.result.excluded, "reason": one.result.reason, "used": len(fix.rows)}
    numbers = {"lat_deg": (math.degrees(fix.lat), 9), "lon_deg": (math.degrees(fix.lon), 9), "height_m": (fix.height, 3)}
    numbers |= {"clock_m": (next(iter(fix.clocks_m.values())), 3), "hpl_m": (one.result.hpl_m, 2), "vpl_m": (one.result.vpl_m, 2)}
    numbers |= {f"sigma_{axis}_m": (math.sqrt(fix.cov_n[k, k]), 3) for k, axis in enumerate(("north", "east", "down"))}
    numbers |= {name: (getattr(fix.dops, name), 3) for name in ("hdop", "vdop", "pdop")}
    if one.velocity is not None:
        numbers |= {f"vel_{axis}_mps": (one.velocity.vel_n[k], 3) for k, axis in enumerate(("north", "east", "down"))}
    if error_n is not None:
        numbers |= {f"error_{axis}_m": (error_n[k], 3) for k, axis in enumerate(("north", "east", "down"))}
    return cells | {name: f"{value:.{digits}f}" for name, (value, digits) in numbers.items() if math.isfinite(value)}
