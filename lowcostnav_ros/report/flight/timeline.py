"""The time line: modes of every navigator, and when which aid was refused and why."""

import dataclasses
from collections import Counter

import numpy as np

from lowcostnav_ros.navigators.registry import known_modes
from lowcostnav_ros.replay.runs import TIMEOUT_S
from lowcostnav_ros.report.chart import TimeAxis
from lowcostnav_ros.report.flight.result_folder import NavigatorResult
from lowcostnav_ros.report.lanes import Lane, Span, lanes

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
    rows = list[Lane]()
    for navigator in navigators:
        spans = mode_spans(navigator.solutions.get("t_s", np.empty(0)), navigator.solutions.get("mode", np.empty(0, dtype=str)))
        if not spans:
            continue
        rows.append(_mode_lane(navigator.name, spans, axis.start_s))
        for aid, reason, stamps in refusals(navigator):
            label = f"{aid}: {reason}"
            rows.append(Lane(label, moments=stamps, hint=f"{label}, {len(stamps)} times"))
        rows[-1] = dataclasses.replace(rows[-1], apart=True)
    return lanes("modes and refusals", axis, rows)


def _mode_lane(name: str, spans: list[tuple[float, float, str]], since: float) -> Lane:
    known = known_modes()
    others = sorted({mode for _, _, mode in spans} - set(known))
    fields = []
    for start, end, mode in spans:
        colour = known[mode][0] if mode in known else _OTHER[others.index(mode) % len(_OTHER)]
        fields.append(Span(start, end, colour, mode, f"{name}: {mode}, {start - since:.1f} s to {end - since:.1f} s after the start"))
    return Lane(name, fields)
