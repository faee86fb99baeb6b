"""What is observable along a recording, as a page: ranks over time, and how much of each state each instant shows."""

from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.report.chart import Curve, TimeAxis, time_chart
from lowcostnav_ros.report.flight.figures import name_of
from lowcostnav_ros.report.lanes import Lane, Span, lanes
from lowcostnav_ros.studies.observability import Observability
from lowcostnav_ros.studies.range_observability import RangeWindow

COLOURS = ("#8c2d04", "#d95f02", "#fdae6b", "#a1d99b", "#238b45")
STEPS = (0.2, 0.4, 0.6, 0.8)
"""Shares of a state between which the colours change."""


def drawings(labels: Sequence[str], found: Sequence[Observability], windows: Sequence[RangeWindow] = ()) -> list[str]:
    """The charts, over a common axis of time."""
    t_s = np.array([o.stamp_ns for o in found]) * 1e-9
    axis = TimeAxis(float(t_s[0]), float(max(t_s[-1], t_s[0] + 1.0)))
    rank = Curve(t_s, np.array([float(o.rank) for o in found]), "#1f77b4", "rank")
    rows = Curve(t_s, np.array([float(o.rows) for o in found]), "#d95f02", "rows fused", 1.0)
    whole = Curve(np.array([axis.start_s, axis.end_s]), np.full(2, float(len(labels))), "#c0392b", "states", 1.1, "5 4")
    ranks = time_chart("Rank at single instants", axis, [whole, rank, rows], height=170, limits=(0.0, 1.06 * len(labels)))
    least = [Curve(t_s, np.array([o.singular_values[o.rank - 1] if o.rank else np.nan for o in found]), "#d95f02", "smallest counted")]
    most = [Curve(t_s, np.array([o.singular_values[0] if o.rank else np.nan for o in found]), "#1f77b4", "largest")]
    values = time_chart("Singular values", axis, [*most, *least], height=150, is_log=True)
    shares = lanes("Share of each state in what the instant shows: green wholly, brown not at all", axis, _shares(labels, found, t_s))
    return [ranks, values, shares, _windows(windows, axis)]


def _shares(labels: Sequence[str], found: Sequence[Observability], t_s: np.ndarray) -> list[Lane]:
    share = np.array([o.share for o in found])
    ends = np.append(t_s[1:], t_s[-1] + (t_s[-1] - t_s[-2] if len(t_s) > 1 else 1.0))
    rows = []
    for k, label in enumerate(labels):
        name = name_of(label)
        classes = np.searchsorted(STEPS, share[:, k], side="right")
        starts = np.flatnonzero(np.append(True, classes[1:] != classes[:-1]))
        spans = []
        for a, b in zip(starts, [*starts[1:], len(classes)], strict=True):
            hint = f"{name}: {np.mean(share[a:b, k]):.2f} from {t_s[a] - t_s[0]:.0f} s to {ends[b - 1] - t_s[0]:.0f} s"
            spans.append(Span(float(t_s[a]), float(min(ends[b - 1], t_s[-1])), COLOURS[classes[a]], "", hint))
        rows.append(Lane(name, spans))
    return rows


def _windows(windows: Sequence[RangeWindow], axis: TimeAxis) -> str:
    """Ranks that ranges taken one at a time reach."""
    if not windows:
        return ""
    t_s = np.array([w.start_ns for w in windows]) * 1e-9
    names = (("position, of 2", "#1f77b4"), ("wind too, of 4", "#2a9d5c"), ("heading and airspeed too, of 6", "#d95f02"))
    curves = [Curve(t_s, np.array([float(w.ranks[k]) for w in windows]), colour, name) for k, (name, colour) in enumerate(names)]
    return time_chart("Rank of ranges taken one at a time", axis, curves, limits=(0.0, 6.4))
