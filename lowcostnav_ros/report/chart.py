"""Charts: curves, sigma bands and dots over the flight, with GPS outages shaded, or over any other axis."""

import dataclasses
import math
import zlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from lowcostnav_ros.report import svg
from lowcostnav_ros.report.decimate import straightened, thin, thin_dots, thin_envelope

LEFT, RIGHT, TOP, BOTTOM = 62, 12, 20, 20
EDGE = 3.2
"""Half a digit of a tick's label, px: one that would pass the edge of the chart ends there."""
HALF = 474
"""Width of a chart that another stands beside."""
UNITS, LEVELS = 10_000, 4_000
"""Steps of time across a chart and of values up it."""
LONG_S = 3 * 3600.0
"""From here on the time is written in hours."""
FAR = 50
"""Values are kept up to so many heights of the chart beyond it."""


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
    """A sigma band: one-sigma values, drawn once and twice about zero, or about ``centre``."""

    t_s: np.ndarray
    sigma: np.ndarray
    colour: str
    centre: np.ndarray | None = None
    label: str = "sigma"


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
        long_s = self.end_s - self.start_s
        return (3600.0, "h") if long_s > LONG_S else (60.0, "min") if long_s > 600.0 else (1.0, "s")

    @property
    def data(self) -> dict[str, str | None]:
        """What the page's script must know of the axis, as attributes."""
        return {"start": f"{self.start_s:.3f}", "end": f"{self.end_s:.3f}"}

    def x(self, t_s: np.ndarray | float, left: float, right: float) -> Any:
        """Where stamps land on an axis from ``left`` to ``right``."""
        return left + (np.asarray(t_s) - self.start_s) / max(self.end_s - self.start_s, 1e-9) * (right - left)

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Stamps of the ticks and their labels, the last with the unit."""
        unit, name = self.unit
        ticks = svg.nice_ticks(0.0, (self.end_s - self.start_s) / unit, count)
        for value in ticks:
            yield self.start_s + value * unit, svg.tick_label(value, ticks) + (f" {name}" if value == ticks[-1] else "")

    def shading(self, top: float, height: float) -> str:
        """Outages, in units of the axis."""
        spans = ((float(self.x(a, 0, UNITS)), float(self.x(b, 0, UNITS))) for a, b in self.outages)
        return "".join(svg.element("rect", x=f"{a:.0f}", y=top, width=f"{b - a:.1f}", height=height, class_="outage") for a, b in spans)


@dataclasses.dataclass(frozen=True)
class Axis(TimeAxis):
    """An axis of something else than time from ``start_s`` to ``end_s`` of ``name``, its unit; logarithms to base ten where ``is_log``."""

    name: str = ""
    is_log: bool = False

    @property
    def data(self) -> dict[str, str | None]:
        """What the page's script must know of the axis, as attributes."""
        return {"start": f"{self.start_s:.9g}", "end": f"{self.end_s:.9g}", "across": self.name, "log": "x" if self.is_log else None}

    def ticks(self, count: int) -> Iterator[tuple[float, str]]:
        """Values of the ticks and their labels, the last with the unit."""
        ticks = ticks_of(self.start_s, self.end_s, count, self.is_log)
        for value, label in ticks:
            yield value, f"{label} {self.name}" if value == ticks[-1][0] else label


def ticks_of(low: float, high: float, count: int, is_log: bool) -> list[tuple[float, str]]:
    """Ticks and their labels; of logarithms the powers of ten."""
    if is_log:
        powers = range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1, max(1, round((high - low) / 10)))
        return [(float(k), f"{10.0**k:g}") for k in powers]
    ticks = svg.nice_ticks(low, high, count)
    return [(value, svg.tick_label(value, ticks)) for value in ticks]


@dataclasses.dataclass(frozen=True)
class Frame:
    """The box of a chart of ``width`` by ``height`` pixels and what is inside it, in units that a reader's zoom does not change.

    The inside is a drawing of its own, stretched into the box: what the page's script zooms is the part of it that is shown.
    """

    axis: TimeAxis
    width: int
    height: int
    low: float | None = None
    high: float | None = None
    left: int = LEFT
    is_log: bool = False

    def x(self, t_s: np.ndarray | float) -> Any:
        """Units of stamps."""
        return self.axis.x(t_s, 0, UNITS)

    def y(self, value: np.ndarray | float) -> Any:
        """Units of values, from the top down; what is far beyond the box is kept at :data:`FAR` heights of it."""
        assert self.low is not None and self.high is not None
        share = (self.high - np.asarray(value)) / (self.high - self.low)
        return np.clip(share, -FAR, FAR) * LEVELS

    @property
    def inner(self) -> tuple[int, int]:
        """Width and height of the box, pixels."""
        return self.width - self.left - RIGHT, self.height - TOP - BOTTOM

    def pixel_x(self, t_s: np.ndarray | float) -> Any:
        """Pixels of stamps."""
        return self.axis.x(t_s, self.left, self.width - RIGHT)

    def drawing(self, label: str, under: str, inside: str, over: str = "", unit: str = "") -> str:
        """The whole chart: ``inside`` in units within the box, the rest in pixels below and above it."""
        width, height = self.inner
        levels = LEVELS if self.low is not None else height
        shading = self.axis.shading(-FAR * levels, 2 * FAR * levels)
        box = {"x": self.left, "y": TOP, "width": width, "height": height, "viewBox": f"0 0 {UNITS} {levels}"}
        plot = svg.element("svg", shading + inside, class_="plot", preserveAspectRatio="none", **box)
        frame = svg.element("rect", x=self.left, y=TOP, width=width, height=height, class_="frame")
        data = {**self.axis.data, "unit": unit or None}
        if self.is_log:
            data["log"] = f"{data.get('log') or ''}y"
        data |= {} if self.low is None else {"low": f"{self.low:.6g}", "high": f"{self.high:.6g}"}
        kind = "chart" if self.width > HALF else "chart half"
        named = {f"data_{key}": value for key, value in data.items()}
        return svg.drawing(kind, label, self.width, self.height, under + frame + plot + over, **named)


def time_chart(
    title: str,
    axis: TimeAxis,
    items: Sequence[Item],
    width: int = 960,
    height: int = 150,
    limits: tuple[float, float] | None = None,
    is_log: bool = False,
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
    is_log : bool
        Values, not of a band, are drawn by their logarithms; so is what lies along an :class:`Axis` that says so.
    """
    if is_log:
        items = [dataclasses.replace(i, values=_logarithm(i.values)) for i in items if not isinstance(i, Band)]
    if isinstance(axis, Axis) and axis.is_log:
        items = [dataclasses.replace(i, t_s=_logarithm(i.t_s)) for i in items]
    items = [i for i in items if len(i.t_s) and np.isfinite(_values(i)).any()]
    if not items:
        return ""
    low, high = limits or _limits(items)
    frame = Frame(axis, width, height, low, high, is_log=is_log)
    ordered = [i for i in items if isinstance(i, Band)] + [i for i in items if not isinstance(i, Band)]
    inside = "".join(_drawn(frame, i) for i in ordered)
    over = svg.text(2, 13, title, class_="title") + _legend(items, width)
    unit = title.rpartition("[")[2].partition("]")[0].partition(",")[0] if "[" in title else ""
    return frame.drawing(title, svg.element("g", grid(frame), class_="axes"), inside, over, unit)


def _logarithm(values: np.ndarray) -> np.ndarray:
    """To base ten, NaN where there is none."""
    return np.log10(np.where(values > 0.0, values, np.nan))


def _drawn(frame: Frame, item: Item) -> str:
    """One item, named for the reader's cursor."""
    if isinstance(item, Band):
        return _band(frame, item)
    return _curve(frame, item) if isinstance(item, Curve) else _dots(frame, item)


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


def grid(frame: Frame) -> str:
    """Lines and labels of values and time."""
    assert frame.low is not None and frame.high is not None
    parts, lines = [], []
    base = frame.height - BOTTOM
    for value, label in ticks_of(frame.low, frame.high, 4, frame.is_log):
        y = TOP + float(frame.y(value)) / LEVELS * (base - TOP)
        line = f"M{frame.left} {y:.1f}H{frame.width - RIGHT}"
        is_zero = not value and not frame.is_log
        lines += [] if is_zero else [line]
        parts += [] if not is_zero else [svg.element("path", d=line, class_="zero")]
        parts.append(svg.text(frame.left - 6, y + 3.5, label, class_="tick end"))
    return svg.element("path", d="".join(lines), class_="grid") + "".join(parts) + time_grid(frame)


def time_grid(frame: Frame) -> str:
    """Lines and labels of the time."""
    parts, lines, base = [], [], frame.height - BOTTOM
    for t_s, label in frame.axis.ticks(10 if frame.width > 600 else 5):
        x = float(frame.pixel_x(t_s))
        lines.append(f"M{x:.1f} {TOP}V{base}")
        fits = x + EDGE * len(label) < frame.width
        parts.append(svg.text(x if fits else frame.width, base + 13, label, class_="tick mid" if fits else "tick end"))
    return svg.element("path", d="".join(lines), class_="grid") + "".join(parts)


def _curve(frame: Frame, curve: Curve) -> str:
    x, y = straightened(*_units(frame, *thin(curve.t_s, curve.values)))
    look = {"stroke": curve.colour, "stroke_width": curve.width, "stroke_dasharray": curve.dash}
    return svg.path(svg.path_data(x, y), data_kind="curve", data_label=curve.label or None, **look)


def _band(frame: Frame, band: Band) -> str:
    """Draw a band, each stretch without a gap (NaN) for itself: where nothing was estimated there was no sigma.

    A band about zero is drawn as its upper half, of which the others are copies.
    """
    centre = np.zeros(len(band.sigma)) if band.centre is None else band.centre
    halves: dict[float, list[str]] = {1.0: []} if band.centre is None else {2.0: [], 1.0: []}
    finite = np.flatnonzero(np.isfinite(band.sigma) & np.isfinite(centre))
    for rows in np.split(finite, np.flatnonzero(np.diff(finite) > 1) + 1):
        if not len(rows):
            continue
        t, sigma = thin_envelope(band.t_s[rows], band.sigma[rows])
        middle = np.interp(t, band.t_s[rows], centre[rows])
        for times, paths in halves.items():
            upper = straightened(*_units(frame, t, middle + times * sigma))
            lower = straightened(*_units(frame, t[::-1], middle[::-1] - times * sigma[::-1]))
            if band.centre is None:
                base = float(frame.y(0.0))
                lower = np.array([upper[0][-1], upper[0][0]]), np.full(2, round(base))
            paths.append(svg.path_data(np.concatenate([upper[0], lower[0]]), np.concatenate([upper[1], lower[1]]), closed=True))
    look = {"fill": band.colour, "stroke": "none"}
    if band.centre is not None:
        shown = {2.0: 0.13, 1.0: 0.2}
        parts = [svg.path("".join(paths), fill_opacity=shown[times], **look) for times, paths in halves.items()]
        return svg.element("g", "".join(parts), class_="band")
    data, base = "".join(halves[1.0]), float(frame.y(0.0))
    name = f"b{zlib.crc32(data.encode()):08x}"
    half = svg.path(data, data_kind="band", data_label=band.label, id=name, fill_opacity=0.2, **look)
    copies = ((-1, 1.0), (2, 0.65), (-2, 0.65))  # two sigma at 0.13
    uses = (svg.element("use", href=f"#{name}", transform=f"matrix(1 0 0 {k} 0 {(1 - k) * base:.1f})", opacity=o) for k, o in copies)
    return svg.element("g", half + "".join(uses), class_="band")


def _dots(frame: Frame, dots: Dots) -> str:
    order = np.argsort(dots.t_s, kind="stable")
    x, y = _units(frame, *thin_dots(dots.t_s[order], dots.values[order]))
    look = {"stroke": dots.colour, "stroke_width": dots.size, "stroke_linecap": "round"}
    return svg.path(svg.dots_data(x, y), data_kind="dots", data_label=dots.label or None, **look)


def _units(frame: Frame, t_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.round(frame.x(t_s)), np.round(frame.y(values))


def _legend(items: Sequence[Item], width: int) -> str:
    parts, x = [], float(width - RIGHT)
    entries = {i.label: i for i in items if not isinstance(i, Band) and i.label}
    for label, item in reversed(entries.items()):
        x -= 6.2 * len(label)
        if isinstance(item, Dots):
            mark = svg.element("circle", cx=f"{x - 10:.1f}", cy=9, r=2.5, fill=item.colour)
        else:
            ends: dict[str, Any] = {"x1": f"{x - 20:.1f}", "x2": f"{x - 5:.1f}", "y1": 9, "y2": 9}
            mark = svg.element("line", **ends, stroke=item.colour, stroke_width=2.5, stroke_dasharray=item.dash)
        parts.append(svg.element("g", mark + svg.text(x, 13, label, class_="legend"), class_="key", data_label=label))
        x -= 34
    return "".join(parts)
