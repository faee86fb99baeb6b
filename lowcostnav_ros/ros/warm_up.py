"""Fly a navigator through half a minute in memory before its node is ready.

Loading a compiled kernel takes tens of milliseconds, compiling one seconds.  That time is spent here, on a navigator that is thrown away,
rather than in the air at the first GPS fix.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.messages.encode import imu_from_solution, odometry_from_solution
from lowcostnav_ros.messages.rules import RULES, DecodeRules
from lowcostnav_ros.messages.samples import FLIGHT_S, STEP_S, Instant
from lowcostnav_ros.messages.store import to_cdr

if TYPE_CHECKING:
    from lowcostnav_ros.navigators.base import Navigator

LOOK_NS = 1_000_000_000  # between two outputs: each carries the state over all that the horizon holds


_FLOWN: list[tuple[type, Any]] = []
"""What has been flown in this process, or in the one that it was forked from: kinds and settings."""


def warm_up(navigator: "Navigator", rules: DecodeRules = RULES) -> None:
    """Feed a straight and level flight to a navigator, once for its settings.

    Whatever it makes of the flight is not judged: the point is that every kernel on its way has run once.
    """
    own = type(navigator), navigator.settings
    if own in _FLOWN:
        return
    solutions, looked_ns = list[NavSolution](), 0
    for measurement in straight_flight(list(navigator.inputs), rules):
        solutions += navigator.feed(measurement)
        if measurement.stamp_ns - looked_ns >= LOOK_NS:
            looked_ns = measurement.stamp_ns
            navigator.output()
    if solutions:
        _encode(solutions[-1], navigator)
    _FLOWN.append(own)


def straight_flight(sources: list[str], rules: DecodeRules = RULES) -> Iterator[Measurement]:
    """Yield thirty seconds of noise-free level flight to the north, on the given sources."""
    samples = [(source, kind.sample) for source in sources if (kind := rules.kind_of(source)) is not None and kind.sample is not None]
    for step in range(round(FLIGHT_S / STEP_S)):
        for source, sample in samples:
            yield sample(Instant(step, source))


def _encode(solution: NavSolution, navigator: "Navigator") -> None:
    if navigator.origin is not None and solution.lat is not None:
        to_cdr(odometry_from_solution(solution, navigator.origin))
    elif solution.q_nb is not None:
        to_cdr(imu_from_solution(solution))
