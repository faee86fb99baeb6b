"""What happened on a flight, in order: GPS lost and back, modes, contradictions, alarms, aids that began to be refused."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.report.flight.result_folder import NavigatorResult, Result
from lowcostnav_ros.report.flight.timeline import mode_spans, refusals

MOST_OF_ONE = 40
"""Changes of mode of one navigator that are listed."""
QUIET_S = 10.0
"""A refusal after so long without one begins a new event."""


@dataclass(frozen=True, slots=True, order=True)
class Event:
    """One event: stamp, s, whose it is, what happened."""

    at_s: float
    who: str
    what: str


def events(result: Result) -> list[Event]:
    """All events in order."""
    found = [Event(a, "GPS", "lost") for a, _ in result.summary.without_gps.intervals_s]
    found += [Event(b, "GPS", "back") for _, b in result.summary.without_gps.intervals_s if b < result.summary.last_stamp_s]
    for name, one in result.navigators.items():
        found += _modes(one) + _refused(one)
        summed = result.summary.navigators[name]
        for seen in summed.contradictions:
            suspect = f", suspect {seen.suspect}" if seen.suspect else ""
            found.append(Event(seen.first_s, name, f"{seen.name}{suspect}; for {seen.seconds:.0f} s. {seen.advice}"))
        if summed.integrity is not None and summed.integrity.alarm is not None:
            found.append(Event(summed.integrity.alarm.stamp_s, name, f"alarm: {summed.integrity.alarm.text}"))
    return sorted(found)


def _modes(navigator: NavigatorResult) -> list[Event]:
    columns = navigator.solutions
    spans = mode_spans(columns.get("t_s", np.empty(0)), columns.get("mode", np.empty(0, dtype=str)))[:MOST_OF_ONE]
    return [Event(start, navigator.name, f"mode {mode}") for start, _, mode in spans]


def _refused(navigator: NavigatorResult) -> list[Event]:
    found = []
    for aid, reason, stamps in refusals(navigator):
        starts = np.flatnonzero(np.diff(stamps, prepend=-np.inf) > QUIET_S)
        for begin, end in list(zip(starts, [*starts[1:], len(stamps)], strict=True))[:MOST_OF_ONE]:
            count = end - begin
            found.append(Event(float(stamps[begin]), navigator.name, f"{aid} refused{f' {count} times' if count > 1 else ''}: {reason}"))
    return found
