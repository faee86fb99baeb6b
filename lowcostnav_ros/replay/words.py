"""One sentence per navigator: what it had, how far off it was, whether its errors fit its sigmas (which are then called honest)."""

import math
from collections.abc import Mapping

from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.navigators.registry import known_modes
from lowcostnav_ros.replay.result import ErrorSummary, NavigatorResult, Recording

HONEST = (0.5, 1.5)
"""Error over sigma, RMS: between these the sigmas are called honest."""


def distance(metres: float) -> str:
    """A distance as a pilot reads it: metres, from 2000 m on kilometres and nautical miles."""
    if metres >= 2000.0:
        return f"{metres / 1000.0:.1f} km ({metres / NAUTICAL_MILE:.1f} NM)"
    return f"{metres:.0f} m" if metres >= 10.0 else f"{metres:.1f} m"


def times(count: int) -> str:
    """How often."""
    return "once" if count == 1 else f"{count} times"


def counted_outages(count: int) -> str:
    """So many outages."""
    return "one outage" if count == 1 else f"{count} outages"


def compared_with(recording: Recording | None) -> str:
    """What errors are formed against where it is no truth but another filter's solution, such as ``autopilot``; else empty."""
    topic = recording.truth if recording else None
    return "" if topic is None or topic.startswith("truth/") else topic.rpartition("/")[0] or topic


def sentence(name: str, navigator: NavigatorResult, without_gps_s: float, other: str = "") -> str:
    """Sum up one navigator.

    Parameters
    ----------
    name : str
    navigator : NavigatorResult
    without_gps_s : float
        How long there was no GPS, s.
    other : str
        The filter it is compared with, as :func:`compared_with` says: then nothing is said of its sigmas.
    """
    if navigator.solutions == 0:
        return f"{name}: no solution at all; it ended {navigator.mode_at_end} ({navigator.reason_at_end})."
    errors = navigator.errors
    part = errors.without_gps or errors.whole
    if part is None:
        return f"{name}: nothing to compare with; it ended {navigator.mode_at_end}{_refused(navigator)}."
    if errors.without_gps:
        when = f"{without_gps_s:.0f} s without GPS"
    elif without_gps_s > 0.0 and errors.against_truth:
        when = f"no solution through {without_gps_s:.0f} s without GPS"
    else:
        when = _availability(navigator) if errors.against_truth else "against withheld fixes"
    found = f"{_refused(navigator)}{_contradicted(navigator)}{_stamped(navigator)}"
    if other:
        return f"{name}: {when}, beside {other} {_sizes(part)}{found}."
    return f"{name}: {when}, {_sizes(part)}, {_honesty(part.error_over_sigma)}{found}."


def _availability(navigator: NavigatorResult) -> str:
    seconds = navigator.mode_seconds
    parts = [f"{seconds[mode]:.0f} s {text}" for mode, (_, text) in known_modes().items() if text and seconds.get(mode, 0.0) >= 1.0]
    return " and ".join(parts) or "GPS all flight"


def _sizes(part: ErrorSummary) -> str:
    if part.horizontal_m:
        level, upright = part.horizontal_m, part.vertical_m
        worse = f", vertically {distance(upright.max)}" if upright and upright.max > level.max else ""
        return f"worst {distance(level.max)}{worse}, 95 % within {distance(level.p95)}"
    found = ((axis, part.size(f"{axis}_deg")) for axis in ("heading", "pitch", "roll"))
    angles = [f"{axis} {size.p95:.1f}\N{DEGREE SIGN}" for axis, size in found if size]
    return f"95 % within {', '.join(angles)}" if angles else "nothing comparable"


def error_over_sigma(ratios: Mapping[str, float]) -> float | None:
    """RMS over the axes that matter most: north and east, else the attitude; None without sigmas."""
    for axes in (("north_m", "east_m"), ("roll_deg", "pitch_deg", "heading_deg")):
        known = [ratios[a] for a in axes if a in ratios]
        if known:
            return math.sqrt(sum(r * r for r in known) / len(known))
    return None


def _honesty(ratios: Mapping[str, float]) -> str:
    ratio = error_over_sigma(ratios)
    if ratio is None:
        return "no sigma given"
    low, high = HONEST
    word = "honest" if low <= ratio <= high else ("too small" if ratio > high else "cautious")
    return f"sigma {word} (error/sigma {ratio:.1f})"


def _contradicted(navigator: NavigatorResult) -> str:
    """The contradiction that held longest."""
    worst = max(navigator.contradictions, key=lambda found: found.seconds, default=None)
    if worst is None:
        return ""
    suspect = f", suspect {worst.suspect}" if worst.suspect else ""
    return f"; {worst.name} for {worst.seconds:.0f} s{suspect}"


def _stamped(navigator: NavigatorResult) -> str:
    """Devices whose stamps were corrected."""
    corrected = ((device, found.corrected_s) for device, found in navigator.stamps.items() if found.corrected_s)
    return "".join(f"; stamps of {name} {abs(s):.2f} s {'late' if s > 0.0 else 'early'}: corrected" for name, s in corrected)


def _refused(navigator: NavigatorResult) -> str:
    worst = max(
        ((count, aid, reason) for aid, entry in navigator.aids.items() for reason, count in entry.not_used_or_limited.items()),
        default=None,
    )
    return f"; most refused: {worst[1]}, {times(worst[0])} '{worst[2]}'" if worst else ""
