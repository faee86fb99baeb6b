"""Time charts: curves, sigma bands and dots over the flight, with GPS outages shaded."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lowcostnav_ros.report import svg
from lowcostnav_ros.report.decimate import thin, thin_dots, thin_envelope

LEFT, RIGHT, TOP, BOTTOM = 62, 12, 20, 20


@dataclasses.dataclass(frozen=True)
class Curve:
    """A line: seconds and values; ``label`` for the legend, ``style`` an optional dash pattern."""

    t_s: np.ndarray
    values: np.ndarray
    colour: str
    label: str = ""
    width: float = 1.4
    dash: str | None = None


@dataclasses.dataclass(frozen=True)
class Band:
    """A sigma band around zero: one-sigma values, drawn once and twice."""

    t_s: np.ndarray
    sigma: np.ndarray
    colour: str


@dataclasses.dataclass(frozen=True)
class Dots:
    """Separate points."""

    t_s: np.ndarray
    values: np.ndarray
    colour: str
    label: str = ""
    size: float = 2.4


Item = Curve | Band | Dots


@dataclasses.dataclass(frozen=True)
class TimeAxis:
    """The common time axis: stamps of start and end, and what is shaded, in stamps (s)."""

    start_s: float
    end_s: float
    outages: Sequence[tuple[float, float]] = ()

    @property
    def unit(self) -> tuple[float, str]:
        """Seconds per unit of the axis, and its name."""
        return (60.0, "min") if self.end_s - self.start_s > 600.0 else (1.0, "s")

    def x(self, t_s: np.ndarray | float, left: int, right: int) -> Any:
        """Pixels of stamps on an axis from ``left`` to ``right``."""
        return left + (np.asarray(t_s) - self.start_s) / max(self.end_s - self.start_s, 1e-9) * (right - left)

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Stamps of the ticks and their labels, the last with the unit."""
        unit, name = self.unit
        ticks = svg.nice_ticks(0.0, (self.end_s - self.start_s) / unit, count)
        for value in ticks:
            yield self.start_s + value * unit, svg.tick_label(value, ticks) + (f" {name}" if value == ticks[-1] else "")

    def drawing(self, label: str, left: int, right: int, size: tuple[int, int], content: str) -> str:
        """A drawing along the axis, in which the common cursor is shown."""
        cursor: dict[str, Any] = {"data_start": f"{self.start_s:.3f}", "data_end": f"{self.end_s:.3f}"}
        return svg.drawing("chart", label, *size, content, **cursor, data_left=left, data_right=right)


@dataclasses.dataclass(frozen=True)
class Frame:
    """Where values land in a chart of ``width`` by ``height`` pixels."""

    axis: TimeAxis
    low: float
    high: float
    width: int
    height: int

    def x(self, t_s: np.ndarray | float) -> Any:
        """Pixels of stamps."""
        return self.axis.x(t_s, LEFT, self.width - RIGHT)

    def y(self, value: np.ndarray | float) -> Any:
        """Pixels of values, kept within a little of the frame."""
        share = (np.asarray(value) - self.low) / (self.high - self.low)
        return TOP + (1.0 - np.clip(share, -0.02, 1.02)) * (self.height - TOP - BOTTOM)


def time_chart(
    title: str,
    axis: TimeAxis,
    items: Sequence[Item],
    width: int = 960,
    height: int = 150,
    limits: tuple[float, float] | None = None,
) -> str:
    """Draw one chart; an empty string when there is nothing to draw.

    Parameters
    ----------
    title : str
        What is drawn, with its unit.
    axis : TimeAxis
    items : sequence of Curve, Band or Dots
        Drawn in this order, bands first.
    width, height : int
        Pixels.
    limits : (float, float), optional
        Value range; chosen from the data where None.
    """
    items = [i for i in items if len(i.t_s) and np.isfinite(_values(i)).any()]
    if not items:
        return ""
    frame = Frame(axis, *(limits or _limits(items)), width, height)
    bands = [i for i in items if isinstance(i, Band)]
    parts = [_shading(frame), *(_band(frame, b) for b in bands), _grid(frame)]
    parts += [_curve(frame, i) if isinstance(i, Curve) else _dots(frame, i) for i in items if not isinstance(i, Band)]
    parts += [svg.text(LEFT, 13, title, class_="title"), _legend(items, width)]
    return axis.drawing(title, LEFT, width - RIGHT, (width, height), "".join(parts))


def _values(item: Item) -> np.ndarray:
    return item.sigma if isinstance(item, Band) else item.values


def _limits(items: Sequence[Item]) -> tuple[float, float]:
    """Range of all curves, and of the bands as far as they are not far beyond the curves."""
    drawn = [_values(i)[np.isfinite(_values(i))] for i in items if not isinstance(i, Band)]
    drawn = [d for d in drawn if len(d)]
    low = min((float(d.min()) for d in drawn), default=0.0)
    high = max((float(d.max()) for d in drawn), default=0.0)
    for band in (i for i in items if isinstance(i, Band)):
        reach = 2.2 * float(np.nanquantile(band.sigma, 0.98))
        if drawn:
            reach = min(reach, 4.0 * max(abs(low), abs(high), 1e-9))
        low, high = min(low, -reach), max(high, reach)
    margin = 0.06 * (high - low) or 0.5 * max(abs(high), 1e-6)
    return low - margin, high + margin


def _shading(frame: Frame) -> str:
    spans = [(float(frame.x(a)), float(frame.x(b))) for a, b in frame.axis.outages]
    inner = frame.height - TOP - BOTTOM
    return "".join(svg.element("rect", x=f"{a:.1f}", y=TOP, width=f"{b - a:.1f}", height=inner, class_="outage") for a, b in spans)


def _grid(frame: Frame) -> str:
    parts = []
    ticks = svg.nice_ticks(frame.low, frame.high, 4)
    for value in ticks:
        y = float(frame.y(value))
        kind = "zero" if value == 0.0 else "grid"
        parts.append(svg.element("line", x1=LEFT, x2=frame.width - RIGHT, y1=f"{y:.1f}", y2=f"{y:.1f}", class_=kind))
        parts.append(svg.text(LEFT - 6, y + 3.5, svg.tick_label(value, ticks), class_="tick", text_anchor="end"))
    base = frame.height - BOTTOM
    for t_s, label in frame.axis.ticks(10 if frame.width > 600 else 5):
        x = float(frame.x(t_s))
        parts.append(svg.element("line", x1=f"{x:.1f}", x2=f"{x:.1f}", y1=TOP, y2=base, class_="grid"))
        parts.append(svg.text(x, base + 13, label, class_="tick", text_anchor="middle"))
    parts.append(svg.element("rect", x=LEFT, y=TOP, width=frame.width - LEFT - RIGHT, height=base - TOP, class_="frame"))
    return "".join(parts)


def _curve(frame: Frame, curve: Curve) -> str:
    t, values = thin(curve.t_s, curve.values)
    data = svg.path_data(frame.x(t), frame.y(values))
    return svg.path(data, fill="none", stroke=curve.colour, stroke_width=curve.width, stroke_dasharray=curve.dash, stroke_linejoin="round")


def _band(frame: Frame, band: Band) -> str:
    """Draw a band, each stretch without a gap (NaN) for itself: where nothing was estimated there was no sigma."""
    data: dict[float, list[str]] = {2.0: [], 1.0: []}
    finite = np.flatnonzero(np.isfinite(band.sigma))
    for rows in np.split(finite, np.flatnonzero(np.diff(finite) > 1) + 1):
        t, sigma = thin_envelope(band.t_s[rows], band.sigma[rows])
        x = np.concatenate([frame.x(t), frame.x(t)[::-1]])
        for times, paths in data.items():
            paths.append(svg.path_data(x, np.concatenate([frame.y(times * sigma), frame.y(-times * sigma)[::-1]]), closed=True))
    opacities = {2.0: 0.13, 1.0: 0.2}
    return "".join(svg.path("".join(paths), fill=band.colour, fill_opacity=opacities[k], stroke="none") for k, paths in data.items())


def _dots(frame: Frame, dots: Dots) -> str:
    t, values = thin_dots(dots.t_s, dots.values)
    data = svg.dots_data(np.asarray(frame.x(t)), np.asarray(frame.y(values)))
    return svg.path(data, fill="none", stroke=dots.colour, stroke_width=dots.size, stroke_linecap="round")


def _legend(items: Sequence[Item], width: int) -> str:
    parts, x = [], float(width - RIGHT)
    entries = {i.label: i for i in items if not isinstance(i, Band) and i.label}
    for label, item in reversed(entries.items()):
        x -= 6.2 * len(label)
        parts.append(svg.text(x, 13, label, class_="legend"))
        dash = item.dash if isinstance(item, Curve) else None
        parts.append(svg.element("line", x1=x - 20, x2=x - 5, y1=9, y2=9, stroke=item.colour, stroke_width=2.5, stroke_dasharray=dash))
        x -= 34
    return "".join(parts)
