"""Result files of a replay: one CSV of solutions per navigator, of its errors, its aids' innovations and its further states."""

import csv
import json
import math
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Integrity, NavSolution
from lowcostnav_ros.estimation.aiding import AidStatus
from lowcostnav_ros.replay.columns import NavColumns
from lowcostnav_ros.replay.metrics import AXES, Errors

SOLUTION_HEADER = (
    "t_s,lat_deg,lon_deg,height_m,vn_mps,ve_mps,vd_mps,roll_deg,pitch_deg,heading_deg,sigma_north_m,sigma_east_m,sigma_down_m,"
    "sigma_heading_deg,wind_north_mps,wind_east_mps,sigma_wind_mps,mode"
)
ERRORS_HEADER = ",".join(["t_s", *AXES, *(f"sigma_{axis}" for axis in AXES)])
AIDS_HEADER = "t_s,aid,label,observation,innovation,sigma,test_ratio,accepted,reason"
STATES_HEADER = "t_s,state,value,sigma"
INTEGRITY_HEADER = "t_s,verdict,hpl_m,vpl_m,lasting_hpl_m,lasting_vpl_m,excluded,alarm"
NAVIGATOR_FILES = {"": SOLUTION_HEADER, "_errors": ERRORS_HEADER, "_aids": AIDS_HEADER, "_states": STATES_HEADER}
NAVIGATOR_FILES |= {"_integrity": INTEGRITY_HEADER}
"""Files of one navigator: what follows its name, and the header."""
SMOOTHED_FILES = {"_smoothed": SOLUTION_HEADER, "_smoothed_errors": ERRORS_HEADER}
"""And of one that was smoothed."""
TRUTH_HEADER = "t_s,lat_deg,lon_deg,height_m,vn_mps,ve_mps,vd_mps,roll_deg,pitch_deg,heading_deg"
TRUTH_WIND_HEADER = "t_s,wind_north_mps,wind_east_mps"
SUMMARY = "summary.json"
GPS_HEADER = "t_s,lat_deg,lon_deg,height_m,withheld"

_TRUTH_FORMAT = ",".join(("%.10f", "%.10f", "%.4f", *("%.5f",) * 3, *("%.6f",) * 3))
_SOLUTION_FORMAT = ",".join((_TRUTH_FORMAT, *("%.4f",) * 3, "%.6f", *("%.4f",) * 3))
_ERROR_FORMAT = ",".join(("%.5f",) * (2 * len(AXES)))
STATES_PERIOD_NS = 1_000_000_000
"""States and integrity, which change slowly, are written this far apart."""


@contextmanager
def results_in(folder: Path) -> Iterator[Path]:
    """Give a folder to write results to; they take the place of an earlier run's in ``folder`` when all are there, else nothing is left."""
    part = folder / ".partial"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    try:
        yield part
        for earlier in _results_of(folder):
            earlier.unlink(missing_ok=True)
        for new in part.iterdir():
            new.replace(folder / new.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _results_of(folder: Path) -> list[Path]:
    """Files of an earlier run: what its summary names."""
    try:
        names = [str(name) for name in json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["navigators"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    parts = [f"{name}{part}" for name in names for part in (*NAVIGATOR_FILES, *SMOOTHED_FILES)]
    parts += ["truth", "truth_wind", "gps", *(f"recorded_{name}" for name in names)]
    return [folder / SUMMARY, *(folder / f"{part}.csv" for part in parts)]


def seconds_text(stamp_ns: int) -> str:
    """A stamp in seconds with all nine decimals, exact."""
    sign, size = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{size // 1_000_000_000}.{size % 1_000_000_000:09d}"


def _cells(form: str, values: Iterable[float]) -> list[str]:
    return (form % tuple(values)).replace("nan", "").split(",")


class Table:
    """A CSV file that is written as the replay goes; opened with its header at once, so it exists even without rows."""

    def __init__(self, path: Path, header: str) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(header.split(","))

    def rows(self, rows: Iterable[Sequence[Any]]) -> None:
        """Append rows."""
        self._writer.writerows(rows)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def solution_rows(columns: NavColumns, modes: Sequence[str]) -> list[list[str]]:
    """Rows of :data:`SOLUTION_HEADER`: degrees, metres, seconds; blank where a navigator estimates nothing."""
    sigma_pos = np.sqrt(np.diagonal(columns.cov_pos, axis1=1, axis2=2))
    sigma_wind = np.sqrt(np.trace(columns.cov_wind, axis1=1, axis2=2) / 2.0)
    values = np.column_stack([
        _degrees(columns.position), columns.vel_n, np.degrees(columns.euler), sigma_pos,
        np.degrees(columns.sigma_euler[:, 2]), columns.wind_n, sigma_wind,
    ])  # fmt: skip
    stamps = columns.stamps_ns.tolist()
    return [[seconds_text(t), *_cells(_SOLUTION_FORMAT, row), m] for t, row, m in zip(stamps, values.tolist(), modes, strict=True)]


def truth_rows(columns: NavColumns) -> list[list[str]]:
    """Rows of :data:`TRUTH_HEADER`."""
    values = np.column_stack([_degrees(columns.position), columns.vel_n, np.degrees(columns.euler)])
    return [[seconds_text(t), *_cells(_TRUTH_FORMAT, row)] for t, row in zip(columns.stamps_ns.tolist(), values.tolist(), strict=True)]


def wind_rows(columns: NavColumns) -> list[list[str]]:
    """Rows of :data:`TRUTH_WIND_HEADER`."""
    rows = zip(columns.stamps_ns.tolist(), columns.wind_n.tolist(), strict=True)
    return [[seconds_text(stamp), f"{north:.4f}", f"{east:.4f}"] for stamp, (north, east) in rows]


def error_rows(errors: Errors) -> list[list[str]]:
    """Rows of :data:`ERRORS_HEADER`: estimate minus reference, then the navigator's own sigmas."""
    values = np.hstack([errors.values, errors.sigmas]).tolist()
    return [[seconds_text(t), *_cells(_ERROR_FORMAT, row)] for t, row in zip(errors.stamps_ns.tolist(), values, strict=True)]


def aid_rows(status: AidStatus, computed: bool) -> list[list[str]]:
    """Rows of :data:`AIDS_HEADER` for one use of an aid, one per component.

    Parameters
    ----------
    status : AidStatus
    computed : bool
        Whether this use has an innovation; without one there is a single row with the reason and no numbers.
    """
    head = [seconds_text(status.stamp_ns), status.name]
    tail = ["yes" if status.accepted else "no", status.reason]
    vectors = status.observation, status.innovation, status.innovation_variance
    if not computed or any(vector is None for vector in vectors):
        return [[*head, "", "", "", "", "", *tail]]
    columns = zip(status.labels, *(np.asarray(vector) for vector in vectors), strict=True)
    return [[*head, label, f"{z:.9g}", f"{y:.6g}", f"{v**0.5:.6g}", f"{status.test_ratio:.5g}", *tail] for label, z, y, v in columns]


def gps_row(stamp_ns: int, lat: float, lon: float, height: float, withheld: bool) -> list[str]:
    """One row of :data:`GPS_HEADER`; latitude and longitude given in rad."""
    lat_deg, lon_deg = f"{math.degrees(lat):.10f}", f"{math.degrees(lon):.10f}"
    return [seconds_text(stamp_ns), lat_deg, lon_deg, "" if math.isnan(height) else f"{height:.4f}", "yes" if withheld else "no"]


def state_rows(solution: NavSolution) -> list[list[str]]:
    """Rows of :data:`STATES_HEADER`: biases, scale factors and what else a navigator reports by name."""
    stamp = seconds_text(solution.stamp_ns)
    return [[stamp, name, f"{value:.9g}", f"{sigma:.6g}"] for name, (value, sigma) in (solution.states or {}).items()]


def integrity_row(stamp_ns: int, integrity: Integrity) -> list[str]:
    """Row of :data:`INTEGRITY_HEADER`; blank where there is no protection level."""
    levels = (integrity.hpl_m, integrity.vpl_m, integrity.lasting_hpl_m, integrity.lasting_vpl_m)
    cells = ["" if level is None else f"{level:.2f}" for level in levels]
    return [seconds_text(stamp_ns), integrity.verdict, *cells, " ".join(integrity.excluded), integrity.alarm]


def _degrees(position: np.ndarray) -> np.ndarray:
    return np.column_stack([np.degrees(position[:, :2]), position[:, 2]])
