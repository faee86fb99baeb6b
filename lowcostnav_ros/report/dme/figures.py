"""Figures of a DME plan: stations in view, HDOP of the best pair, expected error along the way, interrogation schedule."""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from lowcostnav_ros.base.units import NAUTICAL_MILE as NM
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.benchmarks_vor import REQUIREMENT_M
from lowcostnav_ros.radionav.interrogation import REPLY_S, SEARCH_S
from lowcostnav_ros.radionav.plan import pair_changes
from lowcostnav_ros.report.dme.plan import Leg, Level, Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HDOP_LEVELS = (1.41, 1.6, 2.0, 3.0, 5.0, 10.0)
COUNT_LEVELS = (-0.5, 0.5, 1.5, 2.5, 4.5, 8.5, 99.5)
COUNT_NAMES = ("0", "1", "2", "3-4", "5-8", "9+")
SCHEDULE_S = 120.0
LABEL = {"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.5}
DASHES = ("-", "--", ":", "-.")


def draw_coverage(figure: "Figure", plan: Plan) -> None:
    """Number of usable stations on a map, one panel per altitude."""
    values = [level.coverage.audible for level in plan.levels]
    bar = _maps(figure, plan, values, "stations in line of sight and service volume", "YlGnBu", COUNT_LEVELS, "stations")
    bar.set_ticks([0.5 * (a + b) for a, b in pairwise(COUNT_LEVELS)], labels=COUNT_NAMES)


def draw_hdop(figure: "Figure", plan: Plan) -> None:
    """HDOP of the best pair on a map, one panel per altitude; grey where no pair gives a position."""
    values = [np.ma.masked_invalid(level.coverage.hdop_pair) for level in plan.levels]
    title = "HDOP of the best pair (1.41 is the best there is; grey: no pair)"
    _maps(figure, plan, values, title, "RdYlGn_r", HDOP_LEVELS, "HDOP", extend="max")


def _maps(figure: "Figure", plan: Plan, values: Sequence[Any], title: str, colours: str, bounds: tuple, label: str, **norm: Any) -> Any:
    """Colours on a map, one panel per altitude; return the colour bar."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm

    colour_map = colormaps[colours].with_extremes(over="#7f2704")
    columns = min(2, len(plan.levels))
    rows = -(-len(plan.levels) // columns)
    figure.set_size_inches(5.2 * columns + 1.2, 4.9 * rows + 0.5)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).ravel()
    figure.suptitle(title)
    drawn = {"cmap": colour_map, "norm": BoundaryNorm(bounds, colour_map.N, **norm), "shading": "nearest"}
    images = []
    for ax, level, value in zip(axes, plan.levels, values, strict=False):
        images.append(ax.pcolormesh(plan.offsets_m / NM, plan.offsets_m / NM, value, **drawn))
        ax.set_facecolor("#dddddd")
        _map(ax, plan, level)
    for ax in axes[len(plan.levels) :]:
        ax.set_visible(False)
    return figure.colorbar(images[-1], ax=list(axes[: len(plan.levels)]), shrink=0.7, label=label)


def _map(ax: "Axes", plan: Plan, level: Level) -> None:
    """Stations inside the map, the ways flown, axes in nautical miles."""
    frame = LocalFrame(*plan.centre)
    edge = plan.offsets_m[-1]
    for station in plan.table:
        north, east, _ = frame.to_ned(station.lat, station.lon, 0.0)
        if abs(north) <= edge and abs(east) <= edge:
            ax.plot(east / NM, north / NM, "k^", ms=5, mfc="white")
            ax.annotate(station.ident, (east / NM, north / NM), (3, 3), textcoords="offset points", fontsize=7, bbox=LABEL)
    for leg in level.legs:
        ned = frame.to_ned(leg.route.lat, leg.route.lon, 0.0)
        ax.plot(ned[:, 1] / NM, ned[:, 0] / NM, "k-", lw=1.3)
    ax.set(xlim=(-edge / NM, edge / NM), ylim=(-edge / NM, edge / NM), aspect="equal", title=f"{level.altitude_m:.0f} m above sea level")
    ax.set(xlabel="east [NM]", ylabel="north [NM]")


def draw_error(figure: "Figure", plan: Plan) -> None:
    """Expected error along the way against the requirement, and below it the stations asked at the highest altitude."""
    legs = plan.levels[-1].legs
    figure.set_size_inches(9.0, 4.6 + 0.45 * len(legs))
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=(4.0, 0.5 + 0.45 * len(legs)))
    for number, level in enumerate(plan.levels):
        for k, leg in enumerate(level.legs):
            label = f"{level.altitude_m:.0f} m" if k == 0 else None
            distance = leg.route.time_s * leg.route.speed / NM
            top.plot(distance, leg.sigma.horizontal(), color=f"C{number}", ls=DASHES[k % 4], lw=1.2, label=label)
    top.axhline(REQUIREMENT_M, color="k", lw=1, ls=(0, (6, 4)))
    top.annotate("0.5 NM", (0.0, REQUIREMENT_M), (2, 3), textcoords="offset points", fontsize=8)
    top.set(ylabel="expected horizontal 1-sigma [m]", ylim=(0.0, None), title="backup navigator, GPS lost at the start, one receiver")
    if len(legs) > 1:
        for leg, dash in zip(legs, DASHES, strict=False):
            top.plot([], [], color="k", ls=dash, lw=1.2, label=leg.name)
    top.set_xlim(0.0, max(leg.route.time_s[-1] * leg.route.speed for leg in legs) / NM)
    top.legend(fontsize=8, ncols=2, loc="lower right")
    for row, leg in enumerate(legs):
        _asked(below, row, leg)
    below.set(yticks=range(len(legs)), yticklabels=[leg.name for leg in legs], ylim=(len(legs) - 0.4, -0.6), xlabel="distance flown [NM]")
    below.set_title(f"stations asked at {plan.levels[-1].altitude_m:.0f} m (red: fewer than two; red line: poor geometry)", fontsize=9)


def _asked(ax: "Axes", row: int, leg: Leg) -> None:
    for k, (begin, end, pair) in enumerate(pair_changes(leg.points)):
        colour = "#c0392b" if len(pair) < 2 else ("#9ecae1", "#c7e9c0")[k % 2]
        ax.barh(row, (end - begin) / NM, left=begin / NM, height=0.7, color=colour, ec="white")
        ax.text(0.5 * (begin + end) / NM, row, "-".join(pair) or "none", ha="center", va="center", fontsize=7)
    for p in leg.points:
        if p.pair and p.poor:
            ax.plot(p.distance_m / NM, row + 0.42, "r_", ms=6)


def draw_schedule(figure: "Figure", plan: Plan) -> None:
    """The first two minutes of the schedule at the highest altitude: search, then measurement, station by station."""
    figure.set_size_inches(9.0, 2.6)
    ax = figure.subplots()
    replies = [r for r in plan.levels[-1].legs[0].replies if r.time_s <= SCHEDULE_S]
    names = list(dict.fromkeys(r.station for r in replies))
    for r in replies:
        row = names.index(r.station)
        ax.barh(row, SEARCH_S, left=r.time_s - REPLY_S - SEARCH_S, height=0.5, color="#bdbdbd")
        ax.barh(row, REPLY_S, left=r.time_s - REPLY_S, height=0.5, color="#08519c")
    ax.set(yticks=range(len(names)), yticklabels=names, xlim=(0.0, SCHEDULE_S), xlabel="time [s]")
    ax.set_title("interrogations: 4 s search (grey), 1 s measurement (blue)", fontsize=10)


FIGURES = {"coverage.png": draw_coverage, "hdop.png": draw_hdop, "error.png": draw_error, "schedule.png": draw_schedule}
