"""The figures of a report: which columns go into which chart."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lowcostnav_ros.base.units import MILLI_G
from lowcostnav_ros.gnss.accuracy import CATEGORIES_M
from lowcostnav_ros.navigators.registry import label_of
from lowcostnav_ros.replay.result import ReplayResult
from lowcostnav_ros.replay.words import compared_with
from lowcostnav_ros.report.chart import HALF, Band, Curve, Dots, Item, TimeAxis, time_chart
from lowcostnav_ros.report.flight.result_folder import Columns, NavigatorResult, Result
from lowcostnav_ros.report.map_chart import Ellipse, Ground, Track, map_chart

TRUTH_COLOUR, SMOOTHED_COLOUR = "var(--ink)", "#00856a"
_SPARE = ("#7a5195", "#8c6d31", "#56b4e9", "#5f7f3a")
ELLIPSE_EVERY_S = 60.0
ATTITUDE = {"roll_deg": "Roll [deg]", "pitch_deg": "Pitch [deg]", "heading_deg": "True heading [deg]"}
MOTION = {"height_m": "Height above the ellipsoid [m]", "speed_mps": "Ground speed [m/s]"}
WIND = {"wind_north_mps": "Wind toward north [m/s]", "wind_east_mps": "Wind toward east [m/s]"}
FIELD_UNITS = {
    "_radps": ("deg/h", math.degrees(3600.0)),
    "_mps2": ("mg", 1.0 / MILLI_G),
    "_mps": ("m/s", 1.0),
    "_rad": ("deg", math.degrees(1.0)),
    "_ut": ("uT", 1.0),
    "_m": ("m", 1.0),
    "_s": ("s", 1.0),
}
"""By how a name in code ends: unit of the field, and factor to it."""
GAP_S = 5.0
"""A curve is broken where nothing was estimated for longer than this."""

ERROR_TITLES = {
    "north_m": "North error [m]",
    "east_m": "East error [m]",
    "down_m": "Down error [m]",
    "vn_mps": "North velocity error [m/s]",
    "ve_mps": "East velocity error [m/s]",
    "vd_mps": "Down velocity error [m/s]",
    "roll_deg": "Roll error [deg]",
    "pitch_deg": "Pitch error [deg]",
    "heading_deg": "Heading error [deg]",
    "wind_north_mps": "North wind error [m/s]",
    "wind_east_mps": "East wind error [m/s]",
}


def colour_of(name: str, names: list[str]) -> str:
    """Colour of a navigator, the same in all figures: its own, or a spare one."""
    others = [n for n in names if not label_of(n).colour]
    return label_of(name).colour or _SPARE[others.index(name) % len(_SPARE)]


def axis_of(summary: ReplayResult) -> TimeAxis:
    """The axis of time of a flight, with its outages."""
    return TimeAxis(summary.first_stamp_s, summary.last_stamp_s, list(summary.without_gps.intervals_s))


def reference_of(result: Result) -> str:
    """What the errors are formed against, in a word: truth, or the filter that stands in for it."""
    return compared_with(result.summary.recording) or "truth"


def ground_map(result: Result) -> tuple[str, Ground | None]:
    """Map with truth, fixes, recorded and replayed solutions, stations, and two-sigma ellipses without GPS; and its ground."""
    names = list(result.navigators)
    tracks = []
    if len(result.truth.get("t_s", ())):
        tracks.append(Track(result.truth["lat_deg"], result.truth["lon_deg"], TRUTH_COLOUR, reference_of(result), 2.4))
    if len(result.gps.get("t_s", ())):
        for kind, colour, label in (("no", "#9aa5ad", "GPS fixes"), ("yes", "#e0a030", "withheld fixes")):
            rows = result.gps["withheld"] == kind
            if rows.any():
                tracks.append(Track(result.gps["lat_deg"][rows], result.gps["lon_deg"][rows], colour, label, dots=True))
    for name, columns in result.recorded.items():
        tracks.append(Track(columns["lat_deg"], columns["lon_deg"], "#777777", f"{name} recorded", 3.2, "2 3"))
    ellipses = []
    for name, navigator in result.navigators.items():
        if _known(navigator.solutions, "lat_deg"):
            place = navigator.solutions["lat_deg"], navigator.solutions["lon_deg"]
            tracks.append(Track(*place, colour_of(name, names), name, dash=label_of(name).dash or None))
            if _known(navigator.smoothed, "lat_deg"):
                place = navigator.smoothed["lat_deg"], navigator.smoothed["lon_deg"]
                tracks.append(Track(*place, colour_of(name, names), f"{name} smoothed", 1.3, dash="7 3"))
            ellipses += _ellipses(navigator, colour_of(name, names), result.summary.without_gps.intervals_s)
    return map_chart(tracks, result.summary.stations, ellipses), Ground.under(tracks)


def _ellipses(navigator: NavigatorResult, colour: str, outages: Sequence[tuple[float, float]]) -> list[Ellipse]:
    columns, out = navigator.solutions, []
    for start, end in outages:
        for t in np.arange(start, end + 0.5, ELLIPSE_EVERY_S):
            row = int(np.searchsorted(columns["t_s"], t))
            names = ("lat_deg", "lon_deg", "sigma_north_m", "sigma_east_m")
            values = [float(columns[n][row]) for n in names] if row < len(columns["t_s"]) else []
            if values and np.isfinite(values).all():
                lat_deg, lon_deg, *sigmas = values
                words = f"{navigator.name}, 2 sigma {t - start:.0f} s after the loss of GPS"
                out.append(Ellipse(lat_deg, lon_deg, sigmas[0], sigmas[1], colour, words))
    return out


def error_figures(navigator: NavigatorResult, axis: TimeAxis, colour: str, word: str = "error") -> list[str]:
    """Errors inside their one- and two-sigma bands, one chart per component that has any; ``word``: what the reference makes of them."""
    errors = navigator.errors
    charts = []
    for name, title in ERROR_TITLES.items():
        if _known(errors, name):
            rows = np.isfinite(errors[name])  # withheld fixes give position and velocity in turns
            t, values, sigma = _broken(errors["t_s"][rows], errors[name][rows], errors[f"sigma_{name}"][rows])
            items: list[Item] = [Band(t, sigma, colour), Curve(t, values, colour, "in 1 and 2 sigma")]
            if _known(navigator.smoothed_errors, name):
                after = navigator.smoothed_errors
                rows = np.isfinite(after[name])
                t, values, sigma = _broken(after["t_s"][rows], after[name][rows], after[f"sigma_{name}"][rows])
                items += [Band(t, sigma, SMOOTHED_COLOUR), Curve(t, values, SMOOTHED_COLOUR, "smoothed", 1.2)]
            width = 960 if name in ("north_m", "east_m", "heading_deg") else HALF
            charts.append(time_chart(title.replace("error", word), axis, items, width=width))
    return charts


def requirement_figures(result: Result, axis: TimeAxis) -> list[str]:
    """Horizontal and vertical error of all navigators under the limits of the precision-approach categories."""
    names, charts = list(result.navigators), []
    ends = np.array([axis.start_s, axis.end_s])
    for column, (title, side) in {"north_m": ("Horizontal error [m]", 0), "down_m": ("Vertical error [m]", 1)}.items():
        curves, largest = [], 0.0
        for name, navigator in result.navigators.items():
            errors = navigator.errors
            if _known(errors, column):
                size = np.abs(errors["down_m"]) if side else np.hypot(errors["north_m"], errors["east_m"])
                rows = np.isfinite(size)
                t, values, _ = _broken(errors["t_s"][rows], size[rows], size[rows])
                curves.append(Curve(t, values, colour_of(name, names), name, 1.3, label_of(name).dash or None))
                largest = max(largest, float(size[rows].max()))
        highest = CATEGORIES_M["I"][side]
        lines = [Curve(ends, np.full(2, limits[side]), "#c0392b", f"cat {name}", 1.1, dash)
                 for (name, limits), dash in zip(CATEGORIES_M.items(), ("2 3", "5 4", None), strict=True)]  # fmt: skip
        top = 1.05 * min(max(largest, highest), 3.0 * highest)
        beyond = f", off scale up to {largest:.0f} m" if largest > top else ""
        charts.append(time_chart(title.replace("]", f"{beyond}]"), axis, [*lines, *curves], limits=(0.0, top)) if curves else "")
        if beyond:
            charts.append(time_chart(title.replace("]", ", whole range]"), axis, curves, limits=(0.0, 1.05 * largest)))
    return charts


def compared_figures(result: Result, axis: TimeAxis, titles: Mapping[str, str]) -> list[str]:
    """Columns of all navigators, each with its title, over the truth."""
    charts = []
    for column, title in titles.items():
        is_wind = column.startswith("wind")
        truth, colour, width = (result.truth_wind, "#8a8f94", 1.0) if is_wind else (_with_speed(result.truth), TRUTH_COLOUR, 2.2)
        items: list[Item] = [Curve(*_track_of(truth, column), colour, reference_of(result), width)] if _known(truth, column) else []
        estimates: list[Item] = list(_solution_curves(result, column))
        if column == "height_m" and _known(result.gps, column):
            estimates.insert(0, Dots(result.gps["t_s"], result.gps[column], "#9aa5ad", "GPS fixes"))
        limits = (0.0, 360.0) if column == "heading_deg" else None
        charts.append(time_chart(title, axis, [*items, *estimates], limits=limits) if estimates or not is_wind else "")
    return charts


def in_words(name: str) -> tuple[str, float]:
    """A quantity as it is named in code, ``gyro_bias_x_radps``, as a title with the unit of the field, and the factor to that unit."""
    for suffix, (unit, factor) in FIELD_UNITS.items():
        if name.endswith(suffix):
            return f"{name.removesuffix(suffix).replace('_', ' ')} [{unit}]", factor
    return name.replace("_", " "), 1.0


def name_of(state: str) -> str:
    """A state as it is named in code, in words without its unit."""
    return in_words(state)[0].partition(" [")[0]


def state_figures(navigator: NavigatorResult, axis: TimeAxis, colour: str) -> list[str]:
    """Biases and whatever else a navigator reports by name, each with its one- and two-sigma lines."""
    states = navigator.states
    charts = []
    for name in dict.fromkeys(states["state"].tolist()) if states else ():
        rows = states["state"] == name
        title, factor = in_words(str(name))
        t, value, sigma = states["t_s"][rows], factor * states["value"][rows], factor * states["sigma"][rows]
        items: list[Item] = [Band(t, sigma, colour, value), Curve(t, value, colour, "estimate")]
        low, high = np.nanquantile(value - 2.0 * sigma, 0.04), np.nanquantile(value + 2.0 * sigma, 0.96)
        limits = (float(low), float(high)) if high > low else None  # the first seconds' sigmas would flatten all the rest
        charts.append(time_chart(title, axis, items, width=HALF, height=120, limits=limits))
    return charts


def aid_figures(navigator: NavigatorResult, axis: TimeAxis, colour: str) -> list[str]:
    """Innovations inside two sigma and test ratios, accepted and refused apart, per aid and component."""
    aids = navigator.aids
    if not aids or len(aids["t_s"]) == 0:
        return []
    computed = np.isfinite(aids["innovation"])
    keys = dict.fromkeys(zip(aids["aid"][computed].tolist(), aids["label"][computed].tolist(), strict=True))
    charts = []
    for aid, label in keys:
        rows = computed & (aids["aid"] == aid) & (aids["label"] == label)
        words, factor = in_words(label)
        t, y, used = aids["t_s"][rows], factor * aids["innovation"][rows], aids["accepted"][rows] == "yes"
        t_band, _, sigma = _broken(t, y, factor * aids["sigma"][rows], gap_s=60.0)
        dots = [Dots(t[used], y[used], colour, "used"), Dots(t[~used], y[~used], "#c0392b", "refused", 3.2)]
        title = f"{aid}: innovation of {words}"
        charts.append(time_chart(title, axis, [Band(t_band, sigma, "#8a8f94"), *dots], width=HALF, height=130))
    return charts


def integrity_figure(navigator: NavigatorResult, axis: TimeAxis, colour: str) -> str:
    """Horizontal error below its protection levels, and the alarm."""
    integrity, errors = navigator.integrity, navigator.errors
    if not _known(integrity, "hpl_m"):
        return ""
    top = float(np.nanquantile(integrity["hpl_m"], 0.95)) * 1.2
    items = []
    for column, label, dash in (("hpl_m", "protection level", None), ("lasting_hpl_m", "against a lasting fault", "4 3")):
        if _known(integrity, column):
            t, level, _ = _broken(integrity["t_s"], integrity[column], integrity[column])
            items.append(Curve(t, level, "var(--ink)", label, 1.2, dash))
    if _known(errors, "north_m"):
        horizontal = np.hypot(errors["north_m"], errors["east_m"])
        t, error, _ = _broken(errors["t_s"], horizontal, horizontal)
        items.append(Curve(t, error, colour, "error"))
    alarmed = integrity["t_s"][integrity["alarm"] != ""]
    if len(alarmed):
        items.append(Curve(np.full(2, alarmed[0]), np.array([0.0, top]), "#c0392b", "alarm", 1.6, "2 2"))
    return time_chart("Horizontal error and protection level [m]", axis, items, limits=(0.0, top))


def ratio_figure(navigator: NavigatorResult, axis: TimeAxis) -> str:
    """Test ratios of all aids of a navigator, gate at 1."""
    aids = navigator.aids
    if not aids or not np.isfinite(aids["test_ratio"]).any():
        return ""
    names = [n for n in dict.fromkeys(aids["aid"].tolist()) if np.isfinite(aids["test_ratio"][aids["aid"] == n]).any()]
    palette = ("#0072b2", "#d55e00", "#009e73", "#b4579a", "#8c6d31", "#56b4e9", "#7a5195", "#5f7f3a")
    items: list[Item] = [Curve(np.array([axis.start_s, axis.end_s]), np.ones(2), "#c0392b", "gate", 1.2, "5 4")]
    for k, name in enumerate(names):
        rows = (aids["aid"] == name) & np.isfinite(aids["test_ratio"])
        t, first = np.unique(aids["t_s"][rows], return_index=True)
        items.append(Dots(t, np.minimum(aids["test_ratio"][rows][first], 3.0), palette[k % len(palette)], name, 2.0))
    top = min(3.0, max(1.3, float(np.nanmax(aids["test_ratio"]))))
    return time_chart("Test ratio (refused above 1)", axis, items, height=130, limits=(0.0, 1.04 * top))


def _solution_curves(result: Result, column: str) -> list[Curve]:
    names = list(result.navigators)
    curves = []
    for name, navigator in result.navigators.items():
        columns = _with_speed(navigator.solutions)
        if _known(columns, column):
            curves.append(Curve(*_track_of(columns, column), colour_of(name, names), name, 1.3, label_of(name).dash or None))
    return curves


def _with_speed(columns: Columns) -> Columns:
    return {**columns, "speed_mps": np.hypot(columns["vn_mps"], columns["ve_mps"])} if "vn_mps" in columns else columns


def _track_of(columns: Columns, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a column, broken at gaps and, for a heading, where it passes north."""
    t, values, _ = _broken(columns["t_s"], columns[column], columns[column])
    if column == "heading_deg":
        values = values.copy()
        values[np.flatnonzero(np.abs(np.diff(values)) > 180.0)] = np.nan
    return t, values


def _broken(t: np.ndarray, values: np.ndarray, sigma: np.ndarray, gap_s: float = GAP_S) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Insert one NaN wherever nothing comes for longer than ``gap_s``."""
    at = np.flatnonzero(np.diff(t) > gap_s) + 1
    return np.insert(t, at, t[at - 1] + 1e-3), np.insert(values, at, np.nan), np.insert(sigma, at, np.nan)


def _known(columns: Columns, name: str) -> bool:
    return name in columns and len(columns[name]) > 0 and bool(np.isfinite(columns[name]).any())
