"""Lanes: spans of time and single moments, a line for each name, under the axis of the charts."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import BOTTOM, TOP, Frame, TimeAxis, time_grid

WIDTH, LEFT, LANE, THIN, APART = 960, 236, 24, 14, 8
LONGEST = 42
"""Characters of a name."""


@dataclasses.dataclass(frozen=True)
class Span:
    """From ``start`` to ``end`` on the axis, with a word inside where there is room and what a reader is told who points at it."""

    start: float
    end: float
    colour: str
    word: str = ""
    hint: str = ""


@dataclasses.dataclass(frozen=True)
class Lane:
    """A line of spans, or of red ticks at ``moments``, which is thinner; ``apart``: with room below it."""

    name: str
    spans: Sequence[Span] = ()
    moments: np.ndarray | None = None
    hint: str = ""
    apart: bool = False


def lanes(title: str, axis: TimeAxis, rows: Sequence[Lane], left: int = LEFT, width: int = WIDTH) -> str:
    """Draw them; an empty string without any."""
    if not rows:
        return ""
    inside, beside, y = list[str](), [svg.text(2, 13, title, class_="title")], 0
    frame = Frame(axis, width, 0, left=left)
    for lane in rows:
        fields, words = _spans(lane, frame, y) if lane.moments is None else _moments(lane, lane.moments, frame, y)
        inside.append(fields)
        beside.append(words)
        y += (LANE if lane.moments is None else THIN) + APART * lane.apart
    whole = Frame(axis, width, y + TOP + BOTTOM, left=left)
    return whole.drawing(title, svg.element("g", time_grid(whole), class_="axes"), "".join(inside), "".join(beside))


def _spans(lane: Lane, frame: Frame, y: int) -> tuple[str, str]:
    """The fields in units, and the name of the lane and the words in pixels."""
    fields, words = [], [svg.text(frame.left - 8, TOP + y + 14, lane.name, class_="lane", text_anchor="end")]
    for span in lane.spans:
        x, width = float(frame.x(span.start)), max(8.0, float(frame.x(span.end) - frame.x(span.start)))
        title = svg.element("title", svg.escape(span.hint)) if span.hint else ""
        fields.append(svg.element("rect", title, x=f"{x:.0f}", y=y, width=f"{width:.0f}", height=LANE - 6, fill=span.colour))
        if not span.word:
            continue
        room = float(frame.pixel_x(span.end) - frame.pixel_x(span.start))
        ends = {"data_from": f"{span.start:.6g}" if span.start < 1e5 else f"{span.start:.2f}"}
        ends |= {"data_to": f"{span.end:.6g}" if span.end < 1e5 else f"{span.end:.2f}"}
        hidden = None if room > 7.0 * len(span.word) + 8 else "hidden"
        dark = "fill:#1d252c" if _is_light(span.colour) else None
        at = float(frame.pixel_x(span.start)) + 6
        words.append(svg.text(at, TOP + y + 13, span.word, class_="mode", style=dark, visibility=hidden, **ends))
    return "".join(fields), "".join(words)


def _moments(lane: Lane, moments: np.ndarray, frame: Frame, y: int) -> tuple[str, str]:
    short = lane.name if len(lane.name) <= LONGEST else lane.name[: LONGEST - 1] + "\N{HORIZONTAL ELLIPSIS}"
    ticks = "".join(f"M{v:g} {y + 2}v8" for v in np.unique(np.round(frame.x(moments))))
    title = svg.element("title", svg.escape(lane.hint or lane.name))
    name = svg.element("text", svg.escape(short) + title, x=frame.left - 8, y=TOP + y + 10, class_="refusal", text_anchor="end")
    return svg.element("path", d=ticks, class_="refused"), name


def _is_light(colour: str) -> bool:
    """Whether dark words are read better on a colour, #rrggbb."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return 0.299 * red + 0.587 * green + 0.114 * blue > 150.0
