"""A located recording as one HTML page: sentences, tables, and time charts of errors, satellites, dilutions and protection levels."""

from pathlib import Path

import numpy as np

from lowcostnav_ros.gnss import raim
from lowcostnav_ros.gnss.gps_time import unix_ns
from lowcostnav_ros.report.chart import Band, Curve, Dots, TimeAxis, time_chart
from lowcostnav_ros.report.document import document, html_table, section
from lowcostnav_ros.report.gnss.track import TrackSummary, error_table, heading, sentences, spread_table
from lowcostnav_ros.report.svg import escape

BLUE, ORANGE, GREEN, RED = "#1f77b4", "#d95f02", "#2a9d5c", "#c0392b"
_COLOURS = {raim.HEALTHY: GREEN, raim.EXCLUDED: ORANGE, raim.NOT_POSSIBLE: "#8a8f94", raim.FAULTY: RED, "no position": "#222222"}


def write_page(summary: TrackSummary, path: Path) -> int:
    """Write the page; return its size in bytes."""
    text = page_of(summary)
    path.write_text(text, encoding="utf-8")
    return len(text.encode())


def page_of(summary: TrackSummary) -> str:
    """The page as text."""
    said = "".join(f'<li style="border-color:{BLUE}">{escape(line)}</li>' for line in sentences(summary))
    charts = _charts(summary)
    compared = "coordinates in the header" if summary.reference_e is not None else "median position"
    sections = [
        f"<header><h1>{escape(heading(summary))}</h1></header>",
        section("In sentences", f'<ul class="sentences">{said}</ul>'),
        section(
            "Tables",
            html_table(error_table(summary)),
            html_table(spread_table(summary)),
        ),
        section(f"Position minus the {compared}, in its stated 1 and 2 sigma", *(charts[axis] for axis in ("north", "east", "down"))),
        section("Geometry and protection levels", *(charts[name] for name in ("satellites", "dops", "levels"))),
    ]
    return document(summary.name, sections)


def _charts(summary: TrackSummary) -> dict[str, str]:
    located = summary.track.located
    t_s = np.array([unix_ns(one.gps_ns) for one in located]) * 1e-9
    axis = TimeAxis(float(t_s[0]), float(t_s[-1]))
    nothing = np.full(3, np.nan)
    sigma = np.array([np.sqrt(np.diag(one.result.fix.cov_n)) if one.usable else nothing for one in located])
    charts = {}
    for k, name in enumerate(("north", "east", "down")):
        items = [Band(t_s, sigma[:, k], BLUE), Curve(t_s, summary.errors_n[:, k], BLUE)]
        charts[name] = time_chart(f"{name} [m]", axis, items)

    def column(value) -> np.ndarray:
        numbers = np.array([float(value(one)) if one.usable else np.nan for one in located])
        return np.where(np.isfinite(numbers), numbers, np.nan)

    charts["satellites"] = _satellites(summary, t_s, axis)
    dops = [(BLUE, "hdop"), (ORANGE, "vdop"), (GREEN, "pdop")]
    curves = [Curve(t_s, column(lambda one, n=name: getattr(one.result.fix.dops, n)), colour, name.upper()) for colour, name in dops]
    charts["dops"] = time_chart("dilution of precision", axis, curves)
    levels = [(BLUE, "hpl_m", "horizontal"), (ORANGE, "vpl_m", "vertical")]
    curves = [Curve(t_s, column(lambda one, n=name: getattr(one.result, n)), colour, label) for colour, name, label in levels]
    charts["levels"] = time_chart("protection level [m]", axis, curves)
    return charts


def _satellites(summary: TrackSummary, t_s: np.ndarray, axis: TimeAxis) -> str:
    """Satellites used at each epoch in the colour of its verdict, all that were observed behind them."""
    located = summary.track.located
    words = np.array([one.verdict for one in located])
    used = np.array([float(len(one.result.fix.rows)) if one.result else 0.0 for one in located])
    observed = Curve(t_s, np.array([float(one.satellites) for one in located]), "#c3ccd3", "observed")
    dots = [Dots(t_s[words == word], used[words == word], colour, word, 4.0) for word, colour in _COLOURS.items()]
    return time_chart("satellites used, by verdict", axis, [observed, *dots])
