"""Charts of a DME plan: stations in view, HDOP of the best pair, expected error along the way, what is asked when."""

import math
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.base.units import FOOT
from lowcostnav_ros.base.units import NAUTICAL_MILE as NM
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.benchmarks_vor import REQUIREMENT_M
from lowcostnav_ros.radionav.interrogation import REPLY_S, SEARCH_S
from lowcostnav_ros.radionav.plan import pair_changes
from lowcostnav_ros.replay.result import Place
from lowcostnav_ros.report.chart import Axis, Curve, TimeAxis, time_chart
from lowcostnav_ros.report.dme.plan import Leg, Level, Plan
from lowcostnav_ros.report.document import details
from lowcostnav_ros.report.lanes import Lane, Span, lanes
from lowcostnav_ros.report.map_chart import Cells, Track, map_chart

HDOP_LEVELS = (1.6, 2.0, 3.0, 5.0, 10.0)
HDOP_COLOURS = ("#1a9850", "#91cf60", "#d9ef8b", "#fee08b", "#fc8d59", "#7f2704")
COUNT_LEVELS = (1, 2, 3, 5, 9)
COUNT_COLOURS = ("#d9d9d9", "#edf8b1", "#a1dab4", "#41b6c4", "#2c7fb8", "#253494")
COUNT_WORDS = ("no station", "1 station", "2", "3 to 4", "5 to 8", "9 and more")
SCHEDULE_S = 120.0
COLOURS = ("#1f77b4", "#d95f02", "#2a9d5c", "#7a5195", "#8c6d31", "#56b4e9")
DASHES = (None, "7 3", "2 3", "7 3 2 3")


def drawings(plan: Plan) -> list[str]:
    """All of them; the maps of the lower altitudes folded away."""
    *others, last = [(_height(level), _maps(plan, level)) for level in plan.levels]
    return [f"<h3>{last[0]}</h3>{last[1]}", *(details(*one) for one in others), error(plan), asked(plan), schedule(plan)]


def _height(level: Level) -> str:
    return f"{level.altitude_m / FOOT:.0f} ft ({level.altitude_m:.0f} m) above sea level"


def _maps(plan: Plan, level: Level) -> str:
    counts = np.searchsorted(COUNT_LEVELS, level.coverage.audible, side="right")
    hdop = level.coverage.hdop_pair
    classes = np.where(np.isfinite(hdop), np.searchsorted(HDOP_LEVELS, np.nan_to_num(hdop)), -1)
    words = [*(f"to {v:g}" for v in HDOP_LEVELS), f"above {HDOP_LEVELS[-1]:g}"]
    first = "<p class='note'><b>Stations in line of sight and service volume</b></p>"
    second = "<p class='note'><b>HDOP of the best pair</b>; 1.41 is the best there is; clear: no pair</p>"
    one, other = _map(plan, level, counts, COUNT_COLOURS, COUNT_WORDS), _map(plan, level, classes, HDOP_COLOURS, words)
    return f"{first}{one}{second}{other}"


def _map(plan: Plan, level: Level, classes: np.ndarray, colours: Sequence[str], words: Sequence[str]) -> str:
    """Colours, stations and the ways flown."""
    cells = Cells(plan.offsets_m, plan.offsets_m, classes, colours, words, LocalFrame(*plan.centre))
    ways = [Track(np.degrees(leg.route.lat), np.degrees(leg.route.lon), "var(--ink)", leg.name, 2.0, DASHES[k % 4])
            for k, leg in enumerate(level.legs)]  # fmt: skip
    stations = [Place(s.ident, math.degrees(s.lat), math.degrees(s.lon)) for s in plan.table]
    return map_chart(ways, stations, cells=cells)


def error(plan: Plan) -> str:
    """Expected error along the way at every altitude against the requirement."""
    curves, far = list[Curve](), 0.0
    for number, level in enumerate(plan.levels):
        for k, leg in enumerate(level.legs):
            distance = leg.route.time_s * leg.route.speed / NM
            far = max(far, float(distance[-1]))
            label = f"{level.altitude_m / FOOT:.0f} ft" + (f" {leg.name}" if len(level.legs) > 1 else "")
            curves.append(Curve(distance, leg.sigma.horizontal(), COLOURS[number % len(COLOURS)], label, 1.4, DASHES[k % 4]))
    limit = Curve(np.array([0.0, far]), np.full(2, REQUIREMENT_M), "#c0392b", "0.5 NM", 1.2, "6 4")
    title = "Expected horizontal 1-sigma [m] of the backup navigator, GPS lost at the start, against the distance flown"
    top = 1.06 * max(REQUIREMENT_M, *(float(np.nanmax(c.values)) for c in curves))
    axis = Axis(0.0, far, name="NM")
    if len(plan.levels[0].legs) == 1:
        return time_chart(title, axis, [limit, *curves], height=260, limits=(0.0, top))
    names = [leg.name for leg in plan.levels[0].legs]
    each = [[c for c in curves if c.label.endswith(f" {name}")] for name in names]
    charts = [(f"{title}, {name}", [limit, *one]) for name, one in zip(names, each, strict=True)]
    return "".join(time_chart(title, axis, items, height=170, limits=(0.0, top)) for title, items in charts)


def asked(plan: Plan) -> str:
    """The stations asked along the way at the highest altitude; red: fewer than two, dark: poor geometry."""
    level = plan.levels[-1]
    far = max(leg.route.time_s[-1] * leg.route.speed for leg in level.legs) / NM
    title = f"Stations asked at {_height(level)}; red: fewer than two, red ticks: poor geometry"
    rows = [lane for leg in level.legs for lane in _asked(leg)]
    return lanes(title, Axis(0.0, float(far), name="NM"), rows, left=100)


def _asked(leg: Leg) -> list[Lane]:
    spans = []
    for k, (begin, end, pair) in enumerate(pair_changes(leg.points)):
        colour = "#c0392b" if len(pair) < 2 else ("#9ecae1", "#c7e9c0")[k % 2]
        word = "-".join(pair) or "none"
        spans.append(Span(begin / NM, end / NM, colour, word, f"{word}, {begin / NM:.0f} to {end / NM:.0f} NM"))
    poor = np.array([p.distance_m / NM for p in leg.points if p.pair and p.poor])
    return [Lane(leg.name, spans), *([Lane("poor geometry", moments=poor)] if len(poor) else [])]


def schedule(plan: Plan) -> str:
    """The first two minutes of the schedule at the highest altitude: search, then measurement, station by station."""
    replies = [r for r in plan.levels[-1].legs[0].replies if r.time_s <= SCHEDULE_S]
    spans: dict[str, list[Span]] = {}
    for r in replies:
        begin = r.time_s - REPLY_S
        searched = Span(begin - SEARCH_S, begin, "#bdbdbd", "", f"{r.station}: search")
        spans.setdefault(r.station, []).extend([searched, Span(begin, r.time_s, "#08519c", "", f"{r.station}: measurement")])
    title = f"Interrogations: {SEARCH_S:g} s search (grey), {REPLY_S:g} s measurement (blue)"
    return lanes(title, TimeAxis(0.0, SCHEDULE_S), [Lane(name, own) for name, own in spans.items()], left=62)
