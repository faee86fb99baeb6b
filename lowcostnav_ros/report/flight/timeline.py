"""The time line: modes of every navigator, and when which aid was refused and why."""

from collections import Counter

import numpy as np

from lowcostnav_ros.navigators.registry import known_modes
from lowcostnav_ros.replay.runs import TIMEOUT_S
from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import BOTTOM, TOP, Frame, TimeAxis, time_grid
from lowcostnav_ros.report.flight.result_folder import NavigatorResult

WIDTH, LEFT, LANE = 960, 236, 22
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
    inside, beside = list[str](), list[str]()
    y = 0
    frame = Frame(axis, WIDTH, 0, left=LEFT)
    for navigator in navigators:
        spans = mode_spans(navigator.solutions.get("t_s", np.empty(0)), navigator.solutions.get("mode", np.empty(0, dtype=str)))
        if not spans:
            continue
        fields, words = _mode_lane(navigator.name, spans, frame, y)
        inside.append(fields)
        beside.append(words)
        y += LANE + 2
        for aid, reason, stamps in refusals(navigator):
            ticks, name = _refusal_lane(f"{aid}: {reason}", stamps, frame, y)
            inside.append(ticks)
            beside.append(name)
            y += LANE - 8
        y += 8
    if not inside:
        return ""
    whole = Frame(axis, WIDTH, y + TOP + BOTTOM, left=LEFT)
    under = svg.element("g", time_grid(whole), class_="axes")
    return whole.drawing("modes and refusals", under, "".join(inside), "".join(beside))


def _mode_lane(name: str, spans: list[tuple[float, float, str]], frame: Frame, y: int) -> tuple[str, str]:
    """The fields of the modes in units, and the name of the lane and of the modes in pixels."""
    fields, words = [], [svg.text(LEFT - 8, TOP + y + 14, name, class_="lane", text_anchor="end")]
    known = known_modes()
    others = sorted({mode for _, _, mode in spans} - set(known))
    for start, end, mode in spans:
        x, width = float(frame.x(start)), max(8.0, float(frame.x(end) - frame.x(start)))
        colour = known[mode][0] if mode in known else _OTHER[others.index(mode) % len(_OTHER)]
        since = frame.axis.start_s
        title = svg.element("title", svg.escape(f"{name}: {mode}, {start - since:.1f} s to {end - since:.1f} s after the start"))
        fields.append(svg.element("rect", title, x=f"{x:.0f}", y=y, width=f"{width:.0f}", height=LANE - 4, fill=colour))
        room = float(frame.pixel_x(end) - frame.pixel_x(start))
        ends = {"data_from": f"{start:.2f}", "data_to": f"{end:.2f}", "visibility": None if room > 7.0 * len(mode) + 8 else "hidden"}
        words.append(svg.text(float(frame.pixel_x(start)) + 6, TOP + y + 13, mode, class_="mode", **ends))
    return "".join(fields), "".join(words)


def _refusal_lane(label: str, stamps: np.ndarray, frame: Frame, y: int) -> tuple[str, str]:
    short = label if len(label) <= 42 else label[:41] + "\N{HORIZONTAL ELLIPSIS}"
    x = np.unique(np.round(frame.x(stamps)))
    ticks = "".join(f"M{v:g} {y + 2}v8" for v in x)
    title = svg.element("title", svg.escape(f"{label}, {len(stamps)} times"))
    name = svg.element("text", svg.escape(short) + title, x=LEFT - 8, y=TOP + y + 10, class_="refusal", text_anchor="end")
    return svg.element("path", d=ticks, class_="refused"), name
