"""A study of outages as one HTML page: table, the worst in sentences, maps of the starts, error against time since the loss."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from lowcostnav_ros.replay.words import distance
from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import HALF, Curve, Dots, Item, TimeAxis, time_chart
from lowcostnav_ros.report.document import details, document, html_table, section
from lowcostnav_ros.report.flight.figures import colour_of
from lowcostnav_ros.report.map_chart import Track, map_chart
from lowcostnav_ros.studies.outages.result import End, Flown, Outage, OutageStudy
from lowcostnav_ros.studies.outages.tables import outage_table, window_table

SCALE = ("#1a9850", "#91cf60", "#fdbf2f", "#f46d43", "#d73027", "#6a0f1f")
"""From good to bad."""
SIGMAS = (0.5, 1.0, 2.0, 3.0, 4.0)
DOT = 9.0
DRAWN = 200
"""So many single outages are drawn at most."""


def write_page(study: OutageStudy, path: Path) -> int:
    """Write the page; return its size in bytes."""
    text = page_of(study)
    path.write_text(text, encoding="utf-8")
    return len(text.encode())


def page_of(study: OutageStudy) -> str:
    """The page as text."""
    names = list(dict.fromkeys(flown.navigator for flown in study.flown))
    span = f"{study.last_stamp_s - study.first_stamp_s:.0f} s of flight, GPS lost every {study.every_s:g} s"
    sections = [
        f"<header><h1>{svg.escape(study.recording)}: had GPS been lost here</h1><p>{svg.escape(span)}</p>"
        f'<div class="findings"><p>{svg.escape(outage_finding(study))}</p></div></header>',
        section("Errors", html_table(outage_table(study))),
        section("The worst", _sentences(study, names)),
        *(section(flown.label, *_one(study, flown, colour_of(flown.navigator, names))) for flown in study.flown),
    ]
    return document(f"{study.recording}: outages", sections)


def outage_finding(study: OutageStudy) -> str:
    """The study in one sentence: the longest outages, the navigator that came through them best."""
    best = min(study.flown, key=lambda flown: flown.statistics[-1].max_m)
    found = best.statistics[-1]
    half, worst = (distance(metres) for metres in (found.median_m, found.max_m))
    lost = f"Had GPS been lost for {found.length_s:g} s"
    if found.windows == 1:
        return f"{lost}, at the one moment tried, {best.navigator} had been within {worst}."
    return f"{lost}, at any of {found.windows} moments, {best.navigator} had been within {half} in half of them, {worst} at worst."


def outage_section(study: OutageStudy) -> str:
    """The study as one section of another page: table, the worst, and for each navigator its errors and a map."""
    names = list(dict.fromkeys(flown.navigator for flown in study.flown))
    each = []
    for flown in study.flown:
        longest_s = max(s.length_s for s in flown.statistics)
        parts = [error_chart(study, flown, colour_of(flown.navigator, names)), *maps_of(study, flown, longest_s)[:1]]
        each.append(details(f"{flown.label}: errors and where", "".join(parts)))
    return section("Had GPS been lost", html_table(outage_table(study)), _sentences(study, names), *each)


def _sentences(study: OutageStudy, names: list[str]) -> str:
    lines = [(colour_of(flown.navigator, names), line) for flown in study.flown for line in flown.worst]
    items = "".join(f'<li style="border-color:{colour}">{svg.escape(line)}</li>' for colour, line in lines)
    return f'<ul class="sentences">{items}</ul>'


def _one(study: OutageStudy, flown: Flown, colour: str) -> list[str]:
    lengths_s = [s.length_s for s in flown.statistics]
    parts = [error_chart(study, flown, colour), *start_charts(study, flown)]
    for length_s in reversed(lengths_s):
        maps = "".join(maps_of(study, flown, length_s))
        parts.append(maps if length_s == lengths_s[-1] else details(f"Maps of {length_s:g} s", maps))
    return [*parts, details("Every outage", html_table(window_table(flown)))]


def maps_of(study: OutageStudy, flown: Flown, length_s: float) -> list[str]:
    """Two maps of the starts: coloured by the error after one length, and by that error over its sigma."""
    ends = flown.ends(length_s)
    largest = max((end.horizontal_m for _, end in ends), default=1.0)
    steps = [t for t in svg.nice_ticks(0.0, largest, 5) if t > 0.0] or [largest]
    where = f"where GPS was lost, {length_s:g} s later"
    return [
        _titled(f"Horizontal error [m] {where}", _map(study, ends, lambda end: end.horizontal_m, steps)),
        _titled(f"Error over sigma {where}", _map(study, ends, lambda end: end.error_over_sigma, SIGMAS)),
    ]


def _titled(title: str, drawing: str) -> str:
    return f'<p class="note"><b>{svg.escape(title)}</b></p>{drawing}' if drawing else ""


def _map(study: OutageStudy, ends: Sequence[tuple[Outage, End]], value: Callable[[End], float], steps: Sequence[float]) -> str:
    """Dots at the starts in a colour for each class of values; the classes end at ``steps``."""
    way = np.array(study.track_deg).reshape(-1, 2)
    tracks = [Track(way[:, 0], way[:, 1], "#b6c0c8", "flight")]
    classes = np.searchsorted(steps, [value(end) for _, end in ends])
    for k in range(len(steps) + 1):
        places = np.array([(o.lat_deg, o.lon_deg) for (o, _), c in zip(ends, classes, strict=True) if c == k]).reshape(-1, 2)
        label = f"to {steps[k]:g}" if k < len(steps) else f"above {steps[-1]:g}"
        if len(places):
            colour = SCALE[round(k * (len(SCALE) - 1) / len(steps))]
            tracks.append(Track(places[:, 0], places[:, 1], colour, label, dots=True, size=DOT))
    return map_chart(tracks) if ends else ""


def error_chart(study: OutageStudy, flown: Flown, colour: str) -> str:
    """Horizontal error against the time since the loss: every outage, their median and 95 %, and the median of the sigmas."""
    t_s = np.arange(0.0, max(study.lengths_s) + 0.5)
    errors, sigmas = (_by_second([getattr(o, name) for o in flown.outages], len(t_s)) for name in ("horizontal_m", "sigma_m"))
    t_s = t_s[: errors.shape[1]]
    few = errors[:: max(1, len(errors) // DRAWN)]
    items: list[Item] = [Curve(t_s, row, "#cfd6dc", "each outage", 0.8) for row in few]
    for share, label, dash in ((50, "median", None), (95, "95 %", "5 3")):
        items.append(Curve(t_s, np.nanpercentile(errors, share, axis=0), colour, label, 2.2, dash))
    items.append(Curve(t_s, np.nanmedian(sigmas, axis=0), "var(--ink)", "sigma, median", 1.4, "2 3"))
    top = 1.05 * float(np.nanmax(errors))
    axis = TimeAxis(0.0, float(t_s[-1]))
    return time_chart("Horizontal error [m] against the time since GPS was lost", axis, items, height=240, limits=(0.0, top))


def _by_second(rows: Sequence[Sequence[float | None]], seconds: int) -> np.ndarray:
    """Values (outages, seconds) without seconds at which there is none."""
    values = np.full((len(rows), seconds), np.nan)
    for k, row in enumerate(rows):
        values[k, : len(row)] = [np.nan if v is None else v for v in row]
    return values[:, : 1 + int(np.flatnonzero(np.isfinite(values).any(axis=0)).max(initial=0))]


def start_charts(study: OutageStudy, flown: Flown) -> list[str]:
    """Error and sigma at the end of each outage against its start, a chart for each length."""
    axis, charts = TimeAxis(study.first_stamp_s, study.last_stamp_s), []
    for length_s in (s.length_s for s in flown.statistics):
        ends = flown.ends(length_s)
        t_s, sigma = np.array([o.start_s for o, _ in ends]), np.array([e.sigma_m for _, e in ends])
        worse = np.array([e.horizontal_m for _, e in ends])
        beyond = worse > 3.0 * sigma
        items: list[Item] = [
            Dots(t_s, sigma, "#8a8f94", "sigma", 3.0),
            Dots(t_s[~beyond], worse[~beyond], SCALE[0], "error", 4.5),
            Dots(t_s[beyond], worse[beyond], SCALE[4], "beyond 3 sigma", 4.5),
        ]
        limits = 0.0, 1.06 * float(max(worse.max(), sigma.max()))
        charts.append(time_chart(f"Error [m] {length_s:g} s after a loss at ...", axis, items, width=HALF, limits=limits))
    return charts
