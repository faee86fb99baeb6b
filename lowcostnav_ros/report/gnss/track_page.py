"""A located recording as one HTML page: sentences, tables, and time charts of errors, satellites, dilutions and protection levels."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lowcostnav_ros.gnss import raim
from lowcostnav_ros.gnss.gps_time import unix_ns
from lowcostnav_ros.report.chart import Band, Curve, Dots, Item, TimeAxis, time_chart
from lowcostnav_ros.report.document import document, html_table, section
from lowcostnav_ros.report.gnss.track import TrackSummary, epochs_of, error_table, heading, sentences, spread_table
from lowcostnav_ros.report.map_chart import Track as MapTrack
from lowcostnav_ros.report.map_chart import map_chart
from lowcostnav_ros.report.svg import escape

BLUE, ORANGE, GREEN, RED = "#1f77b4", "#d95f02", "#2a9d5c", "#c0392b"
SATELLITES = ("#1f77b4", "#d95f02", "#2a9d5c", "#7a5195", "#8c6d31", "#56b4e9", "#e377c2", "#bcbd22", "#17becf", "#c0392b")
_COLOURS = {raim.HEALTHY: GREEN, raim.EXCLUDED: ORANGE, raim.NOT_POSSIBLE: "#8a8f94", raim.FAULTY: RED, "no position": "var(--ink)"}


def write_page(summary: TrackSummary, path: Path) -> int:
    """Write the page; return its size in bytes."""
    text = page_of(summary)
    path.write_text(text, encoding="utf-8")
    return len(text.encode())


def page_of(summary: TrackSummary) -> str:
    """The page as text."""
    items = "".join(f'<li style="border-color:{BLUE}">{escape(line)}</li>' for line in sentences(summary))
    charts = _charts(summary)
    compared = "coordinates in the header" if summary.reference_e is not None else "median position"
    sections = [
        f"<header><h1>{escape(heading(summary))}</h1></header>",
        section("In sentences", f'<ul class="sentences">{items}</ul>'),
        section("Tables", html_table(error_table(summary)), html_table(spread_table(summary))),
        section(f"Position minus the {compared}, in its stated 1 and 2 sigma", *(charts[axis] for axis in ("north", "east", "down"))),
        section("Geometry and protection levels", *(charts[name] for name in ("satellites", "dops", "levels"))),
        section("Map", _map(summary)),
        section("By satellite", *_by_satellite(summary)),
    ]
    return document(summary.name, sections)


def _charts(summary: TrackSummary) -> dict[str, str]:
    located = summary.track.located
    t_s = np.array([unix_ns(one.gps_ns) for one in located]) * 1e-9
    axis = TimeAxis(float(t_s[0]), float(t_s[-1]))
    sigma = epochs_of(summary.track, lambda result: np.sqrt(np.diag(result.fix.cov_n)), 3)
    charts = {}
    for k, name in enumerate(("north", "east", "down")):
        items: list[Item] = [Band(t_s, sigma[:, k], BLUE), Curve(t_s, summary.errors_n[:, k], BLUE)]
        charts[name] = time_chart(f"{name} [m]", axis, items)
    charts["satellites"] = _satellites(summary, t_s, axis)
    dops = epochs_of(summary.track, lambda result: [result.fix.dops.hdop, result.fix.dops.vdop, result.fix.dops.pdop], 3)
    levels = epochs_of(summary.track, lambda result: [result.hpl_m, result.vpl_m], 2)
    charts["dops"] = time_chart("dilution of precision", axis, _curves(t_s, dops, ("HDOP", "VDOP", "PDOP")))
    charts["levels"] = time_chart("protection level [m]", axis, _curves(t_s, levels, ("horizontal", "vertical")))
    return charts


def _map(summary: TrackSummary) -> str:
    places = np.degrees(epochs_of(summary.track, lambda result: [result.fix.lat, result.fix.lon], 2))
    return map_chart([MapTrack(places[:, 0], places[:, 1], BLUE, "positions", dots=True)])


def _by_satellite(summary: TrackSummary) -> list[str]:
    """Residuals of the pseudoranges that were used, and carrier-to-noise densities of all that were observed."""
    residuals: dict[str, list[tuple[float, float]]] = {}
    densities: dict[str, list[tuple[float, float]]] = {}
    for one in summary.track.located:
        if one.epoch is None:
            continue
        at_s, names = unix_ns(one.gps_ns) * 1e-9, [f"{s}{k:02d}" for s, k in zip(one.epoch.system, one.epoch.sat_id, strict=True)]
        for name, density in zip(names, one.epoch.cn0.tolist(), strict=True):
            densities.setdefault(name, []).append((at_s, density if density > 0.0 else np.nan))
        if one.result is not None:
            for row, residual in zip(one.result.fix.rows.tolist(), one.result.fix.residuals_m.tolist(), strict=True):
                residuals.setdefault(names[row], []).append((at_s, residual))
    t_s = [unix_ns(one.gps_ns) * 1e-9 for one in summary.track.located]
    axis = TimeAxis(t_s[0], t_s[-1])
    titles = {"Residual of the pseudorange, measured minus computed [m]": residuals, "C/N0 [dBHz]": densities}
    return [time_chart(title, axis, _dots(values), height=200) for title, values in titles.items()]


def _dots(values: dict[str, list[tuple[float, float]]]) -> list[Item]:
    rows = {name: np.array(values[name]) for name in sorted(values)}
    return [Dots(row[:, 0], row[:, 1], SATELLITES[k % len(SATELLITES)], name, 2.6) for k, (name, row) in enumerate(rows.items())]


def _curves(t_s: np.ndarray, values: np.ndarray, labels: Sequence[str]) -> list[Curve]:
    values = np.where(np.isfinite(values), values, np.nan)
    return [Curve(t_s, values[:, k], (BLUE, ORANGE, GREEN)[k], label) for k, label in enumerate(labels)]


def _satellites(summary: TrackSummary, t_s: np.ndarray, axis: TimeAxis) -> str:
    """Satellites used at each epoch in the colour of its verdict, all that were observed behind them."""
    located = summary.track.located
    words = np.array([one.verdict for one in located])
    used = np.array([float(len(one.result.fix.rows)) if one.result else 0.0 for one in located])
    observed = Curve(t_s, np.array([float(one.satellites) for one in located]), "#c3ccd3", "observed")
    dots = [Dots(t_s[words == word], used[words == word], colour, word, 4.0) for word, colour in _COLOURS.items()]
    return time_chart("satellites used, by verdict", axis, [observed, *dots])
