"""The three sentences that stand first: the position with GPS and without, whether the sigmas held, what contradicted or was refused."""

from collections.abc import Sequence

from lowcostnav_ros.replay.result import NavigatorResult, ReplayResult
from lowcostnav_ros.replay.words import HONEST, compared_with, distance, error_over_sigma

SHOWN = 3
"""Items named in one sentence; the rest is counted."""
OFTEN = 0.05
"""Share of refused measurements of an aid from which it is worth a word."""
TELLING = 20
"""So many of them at least."""


def clock(since_s: float) -> str:
    """Time since the start, as the charts' cursor shows it."""
    return f"{int(since_s // 60)}:{int(since_s % 60):02d}"


def has_gps(summary: ReplayResult) -> bool:
    """Whether a recording holds positions or raw observations of GPS; of a stream it is taken that it does."""
    topics = summary.recording.bag.topics if summary.recording else {"gps/fix": 1}
    return any(count and (name.startswith("gps") or name == "gnss/raw") for name, count in topics.items())


def findings(summary: ReplayResult, outages: str = "") -> list[str]:
    """The sentences; ``outages`` is what a study of outages adds."""
    if not any(one.solutions for one in summary.navigators.values()):
        return ["No navigator could run on this recording; what was recorded is drawn, and the end of the page lists what is missing."]
    return [text for text in (_position(summary), outages, _sigmas(summary), _trouble(summary)) if text]


def _located(summary: ReplayResult) -> dict[str, NavigatorResult]:
    return {name: one for name, one in summary.navigators.items() if one.errors.whole and one.errors.whole.horizontal_m}


def _position(summary: ReplayResult) -> str:
    lost, start = summary.without_gps, summary.first_stamp_s
    located = _located(summary)
    other = compared_with(summary.recording)
    reference = other or next((one.errors.reference for one in located.values() if one.errors.reference), None)
    spans = [f"{clock(a - start)} to {clock(b - start)}" for a, b in lost.intervals_s]
    gps = f"GPS lost {_listed(spans)}" if spans else "GPS all flight" if has_gps(summary) else "No GPS was recorded"
    during = {n: one.errors.without_gps for n, one in located.items() if one.errors.without_gps and one.errors.without_gps.horizontal_m}
    if spans and during:
        ranked = sorted((part.horizontal_m.max, part.horizontal_m.p95, name) for name, part in during.items() if part.horizontal_m)
        text = [f"{name} stayed within {distance(worst)} (95 % within {distance(p95)})" for worst, p95, name in ranked[:2]]
        silent = [name for name in located if name not in during]
        return f"{gps}; {', '.join(text)}{f'; without a position then: {_listed(silent)}' if silent else ''}."
    whole = {name: one.errors.whole.horizontal_m for name, one in located.items() if one.errors.whole and one.errors.whole.horizontal_m}
    if not whole:
        return f"{gps}; there is no truth in the recording to judge the position by."
    best = sorted(whole.items(), key=lambda pair: pair[1].p95)[:2]
    within = ", ".join(f"{name} within {distance(size.p95)} for 95 % of the time" for name, size in best)
    return f"{gps}; against {reference or 'the reference'}: {within}."


def _sigmas(summary: ReplayResult) -> str:
    if other := compared_with(summary.recording):
        return f"{other.capitalize()} is another filter on the same sensors, no truth: what differs may be either's error."
    found: dict[str, list[str]] = {"too small": [], "honest": [], "cautious": []}
    for name, one in summary.navigators.items():
        part = one.errors.without_gps or one.errors.whole
        ratio = error_over_sigma(part.error_over_sigma) if part else None
        if ratio is not None:
            word = "too small" if ratio > HONEST[1] else "cautious" if ratio < HONEST[0] else "honest"
            found[word].append(f"{name} ({ratio:.1f})" if word == "too small" else name)
    text = [f"{word} for {_listed(names)}" for word, names in found.items() if names]
    if not text:
        return ""
    wrong = " Do not rely on sigmas that are too small." if found["too small"] else ""
    return f"Sigmas {', '.join(text)}.{wrong}"


def _trouble(summary: ReplayResult) -> str:
    items: list[tuple[float, str]] = []
    for name, one in summary.navigators.items():
        for seen in one.contradictions:
            suspect = f" (suspect {seen.suspect})" if seen.suspect else ""
            items.append((seen.seconds, f"{name}: {seen.name} for {seen.seconds:.0f} s{suspect}"))
        for aid, use in one.aids.items():
            refused = sum(use.not_used_or_limited.values())
            if refused >= TELLING and refused >= OFTEN * (refused + use.used):
                why = max(use.not_used_or_limited.items(), key=lambda pair: pair[1])[0]
                items.append((0.1 * refused, f"{name}: {aid} refused {refused} of {refused + use.used} times, mostly '{why}'"))
        if one.solutions == 0:
            items.append((1e9, f"{name} gave no solution ({one.reason_at_end})"))
    items.sort(key=lambda pair: -pair[0])
    if not items:
        return "Nothing contradicted itself, and no aid was refused often."
    return f"To look at: {_listed([text for _, text in items], '; ')}."


def _listed(texts: Sequence[str], between: str = ", ") -> str:
    more = f"{between}and {len(texts) - SHOWN} more" if len(texts) > SHOWN else ""
    return between.join(texts[:SHOWN]) + more
