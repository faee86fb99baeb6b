"""Charts of a plan of satellites in view: the sky with its tracks, satellites and dilutions over time, times in view."""

import math

import numpy as np

from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import Curve, TimeAxis, time_chart
from lowcostnav_ros.report.gnss.plan import GnssPlan
from lowcostnav_ros.report.lanes import Lane, Span, lanes

SIZE, RADIUS = 560, 240
BLUE, ORANGE, GREEN = "#1f77b4", "#d95f02", "#2a9d5c"


def drawings(plan: GnssPlan) -> list[str]:
    """All of them; what is shaded: no good position."""
    start_s = plan.start.timestamp()
    shaded = [(start_s + w.start_s, start_s + w.end_s) for w in plan.windows]
    axis = TimeAxis(start_s, start_s + float(plan.sky.time_s[-1]), shaded)
    return [sky(plan), *geometry(plan, axis), satellites(plan, axis)]


def sky(plan: GnssPlan) -> str:
    """Tracks over the sky, coloured where the satellite is in view; grey: what mask and cliffs hide."""
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    outer = svg.path_data(*_over(around, np.zeros(361)), closed=True)
    parts = [svg.path(outer + svg.path_data(*_over(around, plan.lowest(around)), closed=True), class_="hidden-sky", fill_rule="evenodd")]
    for elevation in (0, 30, 60):
        radius = RADIUS * (90 - elevation) / 90
        parts.append(svg.element("circle", cx=SIZE / 2, cy=SIZE / 2, r=f"{radius:.0f}", class_="grid"))
        parts.append(svg.text(SIZE / 2 + 3, SIZE / 2 - radius + 12, f"{elevation}\N{DEGREE SIGN}", class_="tick"))
    for name, azimuth in (("N", 0.0), ("E", 0.5 * math.pi), ("S", math.pi), ("W", 1.5 * math.pi)):
        x, y = (float(v[0]) for v in _over(np.array([azimuth]), np.array([math.radians(-7.0)])))
        parts.append(svg.text(x, y + 4, name, class_="station-name", text_anchor="middle"))
    return svg.drawing("sky", f"The sky: {plan.view}", SIZE, SIZE, "".join([*parts, *_tracks(plan)]))


def _tracks(plan: GnssPlan) -> list[str]:
    seen = plan.sky
    drawn, names = list[str](), list[str]()
    for j, name in enumerate(seen.names):
        up = seen.elevation[:, j] >= 0.0
        if not up.any():
            continue
        x, y = _over(seen.azimuth[:, j], np.where(up, seen.elevation[:, j], np.nan))
        title = svg.element("title", svg.escape(f"{name}, in view {100.0 * np.mean(seen.visible[:, j]):.0f} % of the time"))
        drawn.append(svg.path(svg.path_data(x, y), stroke="#8a8f94", stroke_width=0.6))
        data = svg.path_data(np.where(seen.visible[:, j], x, np.nan), y)
        drawn.append(svg.element("path", title, d=data or "M0 0", fill="none", stroke=_colour(name), stroke_width=1.8))
        first = int(np.argmax(seen.visible[:, j]))  # where it rises into view
        names.append(svg.text(float(x[first]), float(y[first]) + 4, name, class_="satellite", text_anchor="middle"))
    return drawn + names


def _over(azimuth: np.ndarray, elevation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where directions, rad, lie in the drawing, north up; the horizon is the circle."""
    radius = RADIUS * (1.0 - elevation / (0.5 * np.pi))
    return SIZE / 2 + radius * np.sin(azimuth), SIZE / 2 - radius * np.cos(azimuth)


def _colour(name: str) -> str:
    return BLUE if name[0] == "G" else ORANGE


def geometry(plan: GnssPlan, axis: TimeAxis) -> list[str]:
    """Satellites in view and the dilutions over time, with their limits."""
    seen = plan.sky
    t_s, counts = _steps(axis.start_s + seen.time_s, seen.counts.astype(float))
    ends = np.array([axis.start_s, axis.end_s])
    least = Curve(ends, np.full(2, 4.0), "#c0392b", "four", 1.1, "5 4")
    top = (0.0, float(counts.max()) + 1.0)
    charts = [time_chart("Satellites in view", axis, [least, Curve(t_s, counts, BLUE, "in view")], height=170, limits=top)]
    curves = [Curve(ends, np.full(2, plan.pdop_limit), "#c0392b", f"limit of PDOP {plan.pdop_limit:g}", 1.1, "5 4")]
    for dop, colour in (("hdop", BLUE), ("vdop", ORANGE), ("pdop", GREEN)):
        values = seen.column(dop)
        times, steps = _steps(axis.start_s + seen.time_s, np.where(np.isfinite(values), values, np.nan))
        curves.append(Curve(times, steps, colour, dop.upper()))
    return [*charts, time_chart("Dilution of precision", axis, curves, height=190, limits=(0.0, 2.0 * plan.pdop_limit))]


def _steps(t_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve that stays at each value until the next."""
    return np.repeat(t_s, 2)[1:], np.repeat(values, 2)[:-1]


def satellites(plan: GnssPlan, axis: TimeAxis) -> str:
    """When each satellite is in view, without those that never are."""
    seen, rows = plan.sky, list[Lane]()
    for j in np.flatnonzero(seen.visible.any(axis=0)):
        inside = np.concatenate(([False], seen.visible[:, j], [False]))
        edges = np.flatnonzero(inside[1:] != inside[:-1])
        times = [(axis.start_s + float(seen.time_s[a]), min(float(seen.time_s[b - 1]) + seen.step_s, float(seen.time_s[-1])))
                 for a, b in zip(edges[0::2], edges[1::2], strict=True)]  # fmt: skip
        name = seen.names[j]
        hints = [f"{name} {plan.clock(a - axis.start_s)} to {plan.clock(b)}" for a, b in times]
        spans = [Span(a, axis.start_s + b, _colour(name), "", words) for (a, b), words in zip(times, hints, strict=True)]
        rows.append(Lane(name, spans))
    return lanes("In view", axis, rows, left=62)
