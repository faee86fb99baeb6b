"""The time line: modes of every navigator, and when which aid was refused and why."""

from collections import Counter

import numpy as np

from lowcostnav_ros.navigators.registry import known_modes
from lowcostnav_ros.replay.runs import TIMEOUT_S
from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import TimeAxis
from lowcostnav_ros.report.flight.result_folder import NavigatorResult

WIDTH, LEFT, RIGHT, LANE = 960, 236, 12, 22
MAX_REFUSALS = 14
_OTHER = ("#7f8fa6", "#9b8579", "#6c8e8e", "#a17fa6")


def mode_spans(t_s: np.ndarray, modes: np.ndarray) -> list[tuple[float, float, str]]:
    """Runs of equal mode as (start, end, mode); a run lasts until the next begins, or until the last solution before a timeout.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    modes : ndarray of str, shape (n,)
    """
    if len(t_s) == 0:
        return []
    steps = np.diff(t_s)
    timed_out = steps > max(TIMEOUT_S, 3.0 * np.median(steps)) if len(steps) else np.zeros(0, dtype=bool)
    starts = np.concatenate([[0], np.flatnonzero((modes[1:] != modes[:-1]) | timed_out) + 1])
    ends = np.concatenate([np.where(timed_out[starts[1:] - 1], t_s[starts[1:] - 1], t_s[starts[1:]]), t_s[-1:]])
    return [(float(t_s[s]), float(e), str(modes[s])) for s, e in zip(starts, ends, strict=True)]


def refusals(navigator: NavigatorResult) -> list[tuple[str, str, np.ndarray]]:
    """(aid, reason, stamps) of measurements not used, most frequent first."""
    aids = navigator.aids
    if not aids or len(aids["t_s"]) == 0:
        return []
    refused = aids["accepted"] == "no"
    keys = list(zip(aids["aid"][refused].tolist(), aids["reason"][refused].tolist(), strict=True))
    stamps = aids["t_s"][refused]
    counted = Counter(keys)
    rows = {key: np.array([k == key for k in keys]) for key in counted}
    return [(aid, reason, np.unique(stamps[rows[aid, reason]])) for (aid, reason), _ in counted.most_common(MAX_REFUSALS)]


def timeline(navigators: list[NavigatorResult], axis: TimeAxis) -> str:
    """Draw the lanes of all navigators; an empty string without solutions."""
    lanes: list[str] = []
    y = 8
    for navigator in navigators:
        spans = mode_spans(navigator.solutions.get("t_s", np.empty(0)), navigator.solutions.get("mode", np.empty(0, dtype=str)))
        if not spans:
            continue
        lanes.append(_mode_lane(navigator.name, spans, axis, y))
        y += LANE + 2
        for aid, reason, stamps in refusals(navigator):
            lanes.append(_refusal_lane(f"{aid}: {reason}", stamps, axis, y))
            y += LANE - 8
        y += 8
    if not lanes:
        return ""
    height = y + 22
    shading = "".join(
        svg.element("rect", x=f"{_x(a, axis):.1f}", y=2, width=f"{_x(b, axis) - _x(a, axis):.1f}", height=y - 2, class_="outage")
        for a, b in axis.outages
    )
    return axis.drawing("modes and refusals", LEFT, WIDTH - RIGHT, (WIDTH, height), "".join([shading, *lanes, _ticks(axis, y)]))


def _x(t_s: float, axis: TimeAxis) -> float:
    return float(axis.x(t_s, LEFT, WIDTH - RIGHT))


def _mode_lane(name: str, spans: list[tuple[float, float, str]], axis: TimeAxis, y: int) -> str:
    parts = [svg.text(LEFT - 8, y + 14, name, class_="lane", text_anchor="end")]
    known = known_modes()
    others = sorted({mode for _, _, mode in spans} - set(known))
    for start, end, mode in spans:
        x, width = _x(start, axis), max(1.0, _x(end, axis) - _x(start, axis))
        colour = known[mode][0] if mode in known else _OTHER[others.index(mode) % len(_OTHER)]
        title = svg.element("title", svg.escape(f"{name}: {mode}, {start:.1f} s to {end:.1f} s"))
        parts.append(svg.element("rect", title, x=f"{x:.1f}", y=y, width=f"{width:.1f}", height=LANE - 4, fill=colour, rx=2))
        if width > 7.0 * len(mode) + 8:
            parts.append(svg.text(x + 6, y + 13, mode, class_="mode"))
    return "".join(parts)


def _refusal_lane(label: str, stamps: np.ndarray, axis: TimeAxis, y: int) -> str:
    short = label if len(label) <= 42 else label[:41] + "\N{HORIZONTAL ELLIPSIS}"
    x = np.unique(np.round([_x(t, axis) for t in stamps], 1))
    ticks = "".join(f"M{v:g} {y + 2}v8" for v in x)
    title = svg.element("title", svg.escape(f"{label}, {len(stamps)} times"))
    name = svg.element("text", svg.escape(short) + title, x=LEFT - 8, y=y + 10, class_="refusal", text_anchor="end")
    return name + svg.element("path", d=ticks, class_="refused")


def _ticks(axis: TimeAxis, y: int) -> str:
    parts = [svg.element("line", x1=LEFT, x2=WIDTH - RIGHT, y1=y, y2=y, class_="zero")]
    parts += [svg.text(_x(t_s, axis), y + 14, label, class_="tick", text_anchor="middle") for t_s, label in axis.ticks(10)]
    return "".join(parts)
