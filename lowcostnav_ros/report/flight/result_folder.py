"""Reading a replay's result folder back into columns."""

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np

from lowcostnav_ros.replay.result import ReplayResult
from lowcostnav_ros.replay.result_files import NAVIGATOR_FILES, SMOOTHED_FILES

Columns = dict[str, np.ndarray]
"""Column name to values, shape (n,); numbers as float64 (NaN where blank), text columns as str."""

_TEXT = {"mode", "aid", "label", "accepted", "reason", "state", "withheld", "verdict", "excluded", "alarm"}


class ReportError(ValueError):
    """A folder that cannot be reported on; the message is one sentence that says what to do."""


@dataclasses.dataclass(frozen=True)
class NavigatorResult:
    """Columns of one navigator's files."""

    name: str
    solutions: Columns
    errors: Columns
    aids: Columns
    states: Columns
    integrity: Columns
    smoothed: Columns
    smoothed_errors: Columns


@dataclasses.dataclass(frozen=True)
class Result:
    """Everything a report shows."""

    summary: ReplayResult
    navigators: dict[str, NavigatorResult]
    truth: Columns
    truth_wind: Columns
    gps: Columns
    recorded: dict[str, Columns]


def read_table(path: Path) -> Columns:
    """Read a result CSV; a file that does not exist has no columns.

    Raises
    ------
    ReportError
        When a cell is not a number where one belongs.
    """
    if not path.exists():
        return {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.reader(file)
            header = next(reader, [])
            cells = list(zip(*reader, strict=True)) or [()] * len(header)
        return {name: _column(name, column) for name, column in zip(header, cells, strict=True)}
    except (ValueError, csv.Error) as error:
        what = f"{path} is damaged or holds a cell that is not a number ({error})"
        raise ReportError(f"{what}; write the folder again with replay --out.") from error


def _column(name: str, cells: tuple[str, ...]) -> np.ndarray:
    if name in _TEXT:
        return np.array(cells, dtype=str)
    return np.array([float(c) if c else np.nan for c in cells], dtype=float)


def read_result(folder: Path) -> Result:
    """Read a folder written by ``replay --out``.

    Raises
    ------
    ReportError
        When the folder has no readable summary.
    """
    try:
        summary = ReplayResult.from_mapping(json.loads((folder / "summary.json").read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise ReportError(f"{folder} holds no readable summary.json; give a bag, or a folder written by replay --out.") from error
    parts = [*NAVIGATOR_FILES, *SMOOTHED_FILES]
    tables = {name: [read_table(folder / f"{name}{part}.csv") for part in parts] for name in summary.navigators}
    navigators = {name: NavigatorResult(name, *columns) for name, columns in tables.items()}
    recorded = {p.stem.removeprefix("recorded_"): read_table(p) for p in sorted(folder.glob("recorded_*.csv"))}
    truth, truth_wind, gps = (read_table(folder / f"{name}.csv") for name in ("truth", "truth_wind", "gps"))
    return Result(summary, navigators, truth, truth_wind, gps, recorded)
