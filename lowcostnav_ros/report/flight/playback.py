"""What the page plays: place, attitude, height, speed, errors and mode of every navigator at even times, in whole numbers."""

import contextlib
import json
import math
from typing import Any

import numpy as np

from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.navigators.registry import known_modes
from lowcostnav_ros.physics.geomagnetism import declination, year_of_stamp
from lowcostnav_ros.report.chart import TimeAxis
from lowcostnav_ros.report.flight.figures import GAP_S, TRUTH_COLOUR, colour_of, reference_of
from lowcostnav_ros.report.flight.result_folder import Columns, Result
from lowcostnav_ros.report.map_chart import Ground

MOST, LEAST_STEP_S = 1200, 0.5
"""Times that are kept at most, and the least between two of them."""
SCALES = {"roll_deg": 10.0, "pitch_deg": 10.0, "heading_deg": 10.0, "height_m": 1.0, "speed_mps": 10.0}
SCALES |= {"sigma_north_m": 10.0, "sigma_east_m": 10.0, "error_m": 10.0, "ratio": 100.0}
SCALES |= {"climb_mps": 10.0, "track_deg": 10.0, "sigma_heading_deg": 10.0, "sigma_down_m": 10.0}
"""Steps in a unit of what is kept."""
_TURNING = ("roll_deg", "heading_deg", "track_deg")


def playback(result: Result, ground: Ground | None, axis: TimeAxis) -> str:
    """The data of the player as JSON; an empty string where there is nothing to move.

    Parameters
    ----------
    result : Result
    ground : Ground or None
        Of the map the aircraft moves on.
    axis : TimeAxis
        Of the charts.
    """
    step_s = max(LEAST_STEP_S, (axis.end_s - axis.start_s) / MOST)
    at_s = np.arange(axis.start_s, axis.end_s + 0.5 * step_s, step_s)
    names, ways = list(result.navigators), list[dict[str, Any]]()
    own = {name: (_with_errors(one.solutions, one.errors), colour_of(name, names)) for name, one in result.navigators.items()}
    given = {reference_of(result): (result.truth, TRUTH_COLOUR), "GPS fixes": (result.gps, "#9aa5ad")}
    for name, (columns, colour) in {**given, **own}.items():
        if len(columns.get("t_s", ())) > 1:
            ways.append({"name": name, "given": name in given, "colour": colour, **_way(columns, at_s, ground)})
    if not ways:
        return ""
    modes = {mode: look for mode, (look, _) in known_modes().items()}
    data = {"start": axis.start_s, "step": step_s, "scales": SCALES, "modes": modes, "ways": ways, **_there(ground, axis.start_s)}
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def _there(ground: Ground | None, start_s: float) -> dict[str, float]:
    """Geoid and declination in the middle of the flight: an altimeter and a compass do not read height and heading of the charts."""
    if ground is None:
        return {}
    out = {"undulation_m": round(float(undulation(ground.lat0, ground.lon0)), 1)}
    year = year_of_stamp(int(start_s * 1e9))
    with contextlib.suppress(ValueError):  # beyond the years of the model
        out |= {} if year is None else {"declination_deg": round(math.degrees(declination(ground.lat0, ground.lon0, 0.0, year)), 2)}
    return out


def _way(columns: Columns, at_s: np.ndarray, ground: Ground | None) -> dict[str, Any]:
    """One navigator at the times, columns as differences, None where it gave nothing."""
    t_s = columns["t_s"]
    row = np.searchsorted(t_s, at_s).clip(1, len(t_s) - 1)
    silent = (at_s < t_s[0]) | (at_s > t_s[-1]) | (t_s[row] - t_s[row - 1] > GAP_S)
    columns = dict(columns)
    if "vn_mps" in columns:
        columns["speed_mps"] = np.hypot(columns["vn_mps"], columns["ve_mps"])
        columns["track_deg"] = np.degrees(np.arctan2(columns["ve_mps"], columns["vn_mps"]))
        columns["climb_mps"] = -columns["vd_mps"]
    out: dict[str, Any] = {}
    for name, scale in SCALES.items():
        if name in columns and np.isfinite(columns[name]).any():
            values = columns[name]
            if name in _TURNING:
                known = np.isfinite(values)
                values = np.interp(at_s, t_s[known], np.unwrap(values[known], period=360.0))
            else:
                values = np.interp(at_s, t_s, values)
            out[name] = _steps(np.where(silent, np.nan, values * scale))
    if ground is not None and np.isfinite(columns.get("lat_deg", np.nan)).any():
        x, y = ground.units(columns["lat_deg"], columns["lon_deg"])
        out |= {key: _steps(np.where(silent, np.nan, np.interp(at_s, t_s, v))) for key, v in (("x", x), ("y", y))}
    if "mode" in columns:
        words = list(dict.fromkeys(columns["mode"].tolist()))
        rows = np.searchsorted(t_s, at_s, side="right").clip(1) - 1
        out["words"] = words
        out["mode"] = _steps(np.where(silent, np.nan, np.array([words.index(m) for m in columns["mode"][rows].tolist()], dtype=float)))
    return out


def _with_errors(solutions: Columns, errors: Columns) -> Columns:
    """Solutions with the size of the horizontal error and its multiple of sigma, where there is a reference within a gap."""
    if not len(solutions.get("t_s", ())) or not len(errors.get("north_m", ())):
        return solutions
    known = np.isfinite(errors["north_m"])
    if not known.any():
        return solutions
    t_s = errors["t_s"][known]
    size = np.hypot(errors["north_m"], errors["east_m"])[known]
    sigma = np.hypot(errors["sigma_north_m"], errors["sigma_east_m"])[known]
    near = np.abs(t_s[np.searchsorted(t_s, solutions["t_s"]).clip(0, len(t_s) - 1)] - solutions["t_s"]) <= GAP_S
    found = {"error_m": size, "ratio": size / np.maximum(sigma, 1e-9)}
    return {**solutions, **{key: np.where(near, np.interp(solutions["t_s"], t_s, v), np.nan) for key, v in found.items()}}


def _steps(values: np.ndarray) -> list[int | None]:
    """Rounded values as differences from the last known one."""
    last, out = 0, list[int | None]()
    for value in np.round(values).tolist():
        if value != value:
            out.append(None)
            continue
        out.append(int(value) - last)
        last = int(value)
    return out
