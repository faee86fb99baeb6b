"""Drawings of position fixes, DME layouts, observability and networks."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.base.units import NAUTICAL_MILE as NM
from lowcostnav_ros.radionav.benchmarks_vor import LORAN_ERROR_M, vor_cross_track
from lowcostnav_ros.radionav.ellipse import Ellipse
from lowcostnav_ros.radionav.fixing import Range, Sight
from lowcostnav_ros.radionav.interrogation import REPLY_S, SEARCH_S, InterrogationSchedule
from lowcostnav_ros.radionav.layouts import double as double_layout
from lowcostnav_ros.radionav.layouts import hdop_map as hdop_of
from lowcostnav_ros.radionav.layouts import triple
from lowcostnav_ros.radionav.observability import Track
from lowcostnav_ros.reproduce.figures import SMALL, axes, legend
from lowcostnav_ros.studies.network import OPTIONS

Square = tuple[np.ndarray, np.ndarray, np.ndarray]


def hdop_map(figure: Any, stations: np.ndarray, square: Square, levels: Sequence[float]) -> None:
    """Layout and contours of HDOP."""
    figure.set_size_inches(9.5, 4.6)
    layout = axes(figure, (1, 2, 1), x="east [NM]", y="north [NM]", title="three stations 20 NM from the airport")
    closed = np.vstack((stations, stations[:1])) / NM
    layout.plot(closed[:, 1], closed[:, 0], "k--", lw=0.8)
    _stations(layout, stations)
    _airport(layout)
    layout.set(aspect="equal", xlim=(-30, 30), ylim=(-30, 30))
    contours = axes(figure, (1, 2, 2), x="east [NM]", y="north [NM]", title="HDOP")
    _contours(contours, square, square[2], levels)
    _stations(contours, stations)


def accuracy(figure: Any, stations: np.ndarray, square: Square, noise_m: float) -> None:
    """Contours of the 1-sigma position error."""
    figure.set_size_inches(5.4, 4.8)
    made = axes(figure, x="east [NM]", y="north [NM]", title=f"1-sigma position error [m] at {noise_m:g} m range noise")
    _contours(made, square, noise_m * square[2], (8.6, 9, 10, 11, 12, 13, 14, 15))
    _stations(made, stations)


def double(figure: Any, layouts: Sequence[np.ndarray], out_m: np.ndarray, errors: Sequence[np.ndarray]) -> None:
    """HDOP maps of the plain and the offset layout, and the errors of an approach from the south."""
    figure.set_size_inches(13.0, 4.4)
    axis = np.linspace(-30.0, 30.0, 121) * NM
    north, east = np.meshgrid(axis, axis, indexing="ij")
    for k, (stations, name) in enumerate(zip(layouts, ("beside the airport", "10 NM beyond it"), strict=True), 1):
        made = axes(figure, (1, 3, k), x="east [NM]", y="north [NM]", title=f"HDOP, two stations {name}")
        with np.errstate(invalid="ignore"):
            _contours(made, (north, east, None), np.minimum(hdop_of(stations, north, east), 50.0), (1.5, 2.0, 3.0, 5.0, 10.0))
        _stations(made, stations)
        _airport(made)
        made.plot([0, 0], [-30, 0], "k-", lw=1.2)
    curves = axes(figure, (1, 3, 3), x="distance to go [NM]", y="1-sigma error at 7.4 m noise [m]", title="approach from the south")
    for k, (error, name) in enumerate(zip(errors, ("beside", "beyond"), strict=True)):
        curves.plot(out_m / NM, error[:, 0], f"C{k}-", label=f"in-track, stations {name}")
        curves.plot(out_m / NM, error[:, 1], f"C{k}--", label=f"cross-track, stations {name}")
    curves.set(ylim=(0.0, 60.0), xlim=(20.0, 0.0))
    legend(curves)


def observability(
    figure: Any, tracks: Sequence[Track], straddling: np.ndarray, ahead: np.ndarray, values: Sequence[np.ndarray]
) -> None:
    """Tracks with their stations, a track that observes nothing across, and the singular values."""
    figure.set_size_inches(12.5, 4.6)
    plan = axes(figure, (1, 3, 1), x="east [NM]", y="north [NM]", title="trajectory I straight, II turning")
    for track, name in zip(tracks, ("I", "II"), strict=True):
        plan.plot(track.east / NM, track.north / NM, label=name)
    _stations(plan, straddling)
    plan.set_aspect("equal")
    legend(plan)
    in_line = axes(figure, (1, 3, 2), x="east [NM]", y="north [NM]", title="rank lost: stations along the track\n(north, east, slanted)")
    for k, course in enumerate((0.0, 90.0, 40.0)):
        unit = np.array([math.cos(course * DEGREE), math.sin(course * DEGREE)])
        ends = np.outer((-50.0, -35.0), unit)
        in_line.plot(ends[:, 1], ends[:, 0], f"C{k}-", lw=2)
        line = np.outer((-50.0, 35.0), unit)
        in_line.plot(line[:, 1], line[:, 0], f"C{k}:", lw=0.8)
        _stations(in_line, np.outer(ahead[:, 0], unit), f"C{k}")
    in_line.set_aspect("equal")
    bars = axes(figure, (1, 3, 3), x="number", y="normalised singular value", title="40 alternating ranges, 15 s apart")
    for k, (value, name) in enumerate(zip(values, ("I, 4 states", "I, 6 states", "II, 6 states"), strict=True)):
        bars.bar(np.arange(1, len(value) + 1) + 0.27 * (k - 1), np.maximum(value, 1e-4), 0.26, label=name)
    bars.set(yscale="log", ylim=(1e-3, 3.0))
    legend(bars)


def fixes(figure: Any, sights: Sequence[Sight], places: np.ndarray, ellipses: dict[str, Ellipse], weighted: Ellipse) -> None:
    """Range circles and bearing lines with both crossings, and the 1-sigma ellipses."""
    figure.set_size_inches(10.5, 5.0)
    plan = axes(figure, (1, 2, 1), x="east [NM]", y="north [NM]", title="two ranges: two solutions; bearings decide")
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for sight, name in zip(sights, ("A", "B", "", ""), strict=True):
        north, east = sight.station
        if isinstance(sight, Range):
            plan.plot(east + sight.measured * np.sin(turn), north + sight.measured * np.cos(turn), lw=1)
            plan.plot(east, north, "k^")
            plan.annotate(name, (east, north), (5, 5), textcoords="offset points")
        else:
            plan.plot([east, east + 30 * math.sin(sight.measured)], [north, north + 30 * math.cos(sight.measured)], "k--", lw=0.8)
    plan.plot(places[:, 1], places[:, 0], "o", mfc="none", ms=9)
    for place, name in zip(places, ("fix", "mirror"), strict=True):
        plan.annotate(name, place[::-1], (8, 8), textcoords="offset points", fontsize=SMALL)
    plan.set(aspect="equal", xlim=(-16, 42), ylim=(-25, 34))
    ellipse_axes = axes(figure, (1, 2, 2), x="east of the fix [NM]", y="north of the fix [NM]", title="1-sigma ellipses")
    for name, ellipse in ellipses.items():
        outline = ellipse.outline(np.zeros(2))
        ellipse_axes.plot(outline[:, 1], outline[:, 0], label=f"{name} {ellipse.minor:.4f} x {ellipse.major:.4f}")
    outline = weighted.outline(np.zeros(2))
    ellipse_axes.plot(outline[:, 1], outline[:, 0], "k--", label=f"all four, weighted {weighted.minor:.4f} x {weighted.major:.4f}")
    ellipse_axes.set(xlim=(-1.1, 1.1), ylim=(-0.8, 1.4), aspect="equal")
    legend(ellipse_axes, loc="upper right")


def vor(figure: Any) -> None:
    """Cross-track error over distance."""
    figure.set_size_inches(6.0, 4.0)
    made = axes(figure, x="distance from the VOR [NM]", y="cross-track error [NM]", title="VOR cross-track error")
    distance = np.linspace(0.0, 30.0, 61)
    for degrees in (1, 2, 3, 4, 5):
        made.plot(distance, vor_cross_track(distance, degrees * DEGREE), label=f"{degrees} deg")
    made.axhline(LORAN_ERROR_M / NM, color="k", ls=":", label="LORAN, nominal")
    made.axhline(0.5, color="k", ls="--", label="0.5 NM")
    legend(made)


def schedule(figure: Any, plan: InterrogationSchedule) -> None:
    """Search and measurement of one receiver that alternates between two stations."""
    figure.set_size_inches(8.0, 2.6)
    made = axes(figure, x="time [s]", y="", title="one receiver, two stations: 4 s search at 135/s (grey), 1 s measurement at 25/s (blue)")
    for turn in range(5):
        for slot in plan.slots(turn):
            made.barh(slot.channel, SEARCH_S, left=slot.begin_s, height=0.5, color="#bdbdbd")
            made.barh(slot.channel, REPLY_S, left=slot.begin_s + SEARCH_S, height=0.5, color="#08519c")
    made.set(yticks=(0, 1), yticklabels=("DME 1", "DME 2"), xlim=(0, 75))


def network(figure: Any) -> None:
    """Sites per option, and the coverage patterns behind double and triple."""
    figure.set_size_inches(12.0, 4.2)
    bars = axes(figure, (1, 3, 1), x="option", y="DME sites", title="sites for 200 airports (o: printed total)")
    names = [f"{o.name}\n{'double' if o.fold == 2 else 'triple'}\n{o.above_ground_ft:.0f} ft" for o in OPTIONS]
    existing = np.array([o.existing for o in OPTIONS])
    bars.bar(names, existing, label="existing", color="#6baed6")
    bars.bar(names, [o.additional for o in OPTIONS], bottom=existing, label="additional", color="#fdae6b")
    bars.plot(names, [o.total for o in OPTIONS], "ko", mfc="none")
    legend(bars, loc="upper left")
    axis = np.linspace(-30.0, 30.0, 121) * NM
    north, east = np.meshgrid(axis, axis, indexing="ij")
    for k, (stations, name) in enumerate(((double_layout(), "double"), (triple(), "triple")), 2):
        made = axes(figure, (1, 3, k), x="east [NM]", y="north [NM]", title=f"{name} coverage: where HDOP is below 3")
        usable = np.where(hdop_of(stations, north, east) < 3.0, 1.0, 0.0)
        made.contourf(axis / NM, axis / NM, usable, levels=(0.5, 1.5), colors=["#c7e9c0"])
        _stations(made, stations)
        _airport(made)
        made.set_aspect("equal")


def _contours(made: Any, square: tuple, values: np.ndarray, levels: Sequence[float]) -> None:
    north, east = square[0], square[1]
    drawn = made.contour(east / NM, north / NM, values, levels=levels, cmap="viridis")
    made.clabel(drawn, fontsize=SMALL, fmt="%g")
    made.set_aspect("equal")


def _stations(made: Any, stations: np.ndarray, colour: str = "k") -> None:
    made.plot(stations[:, 1] / NM, stations[:, 0] / NM, "^", color=colour, ms=7)


def _airport(made: Any) -> None:
    made.plot(0, 0, "s", color="#c0392b", ms=6)
