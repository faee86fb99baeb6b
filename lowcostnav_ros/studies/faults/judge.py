"""The verdict on one navigator and one fault: its flight against the flight without the fault."""

from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from typing import Any

import numpy as np

from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.simulation.fault import IN_OUTAGE, NOTHING, Fault
from lowcostnav_ros.studies.faults.flight import Pass, suppliers
from lowcostnav_ros.studies.faults.record import Poll, Record, Track

LIMIT = 4.0
"""An error beyond this many sigmas is not covered."""
ALLOWED_SHARE = 0.01
"""Share of the time from the fault to the end of the flight that an error may not be covered."""
SILENT_S = 5.0
"""Without a solution for longer than this, and than the flight without the fault, a navigator is silent."""
EXCESS = 3
"""A source counts as refused by name once this many more of its measurements are refused than without the fault."""


class Verdict(StrEnum):
    """What a navigator made of a fault, the best first; wrong: beyond 4 sigma for more than 1 % of the time.

    A false alarm is a contradiction on a flight without a fault.
    """

    HARMLESS = "harmless"
    SOUND = "sound"
    UNNAMED = "covered, not named"
    FALSE_ALARM = "false alarm"
    SILENT = "silent"
    WRONG = "wrong"
    CRASHED = "crashed"


@dataclass(frozen=True, slots=True)
class Row:
    """One fault and one navigator; times in seconds, None where it did not happen or there is no such error.

    Attributes
    ----------
    fault, navigator, seed
    verdict : Verdict
    detected_s, named_s : float or None
        From the start of the fault until anything was said that is not said without it, and until the faulty source was named.
    sentence : str
        What was said first that names the source; else what was said first.
    named_by : str
        Navigator that said it: this one, or one whose solution it takes.
    blamed : str
        A source that the navigator suspected though it is sound.
    worst_m, healthy_worst_m : float or None
        Largest horizontal error from the start of the fault on; without the fault.
    worst_sigmas, most_sigmas, healthy_sigmas : float or None
        Horizontal error over sigma: largest, not exceeded 99 % of the time, largest without the fault.
    attitude_sigmas, healthy_attitude_sigmas : float or None
        Attitude error over sigma, not exceeded 99 % of the time.
    beyond : float
        Share of the time beyond 4 sigma, of the position or of the attitude, whichever is larger.
    recovered_s : float or None
        From the end of the fault until the error is covered for good; None: not before the flight ends.
    silent_s : float
        Longest time without a solution from the start of the fault on.
    """

    fault: str
    navigator: str
    seed: int
    verdict: Verdict
    detected_s: float | None = None
    named_s: float | None = None
    sentence: str = ""
    named_by: str = ""
    blamed: str = ""
    worst_m: float | None = None
    healthy_worst_m: float | None = None
    worst_sigmas: float | None = None
    most_sigmas: float | None = None
    healthy_sigmas: float | None = None
    attitude_sigmas: float | None = None
    healthy_attitude_sigmas: float | None = None
    beyond: float = 0.0
    recovered_s: float | None = None
    silent_s: float = 0.0


def judge(name: str, fault: Fault, seed: int, sound: Pass, made: Pass) -> Row:
    """Judge one navigator on a flight with a fault against the flight without."""
    record = made.records[name]
    track, usual = (_from(r.track(), fault.start_s) for r in (record, sound.records[name]))
    end_s = record.polls[-1].t_s
    row = Row(fault.name, name, seed, Verdict.HARMLESS, **_numbers(track, usual, fault, end_s))
    if fault.name.removesuffix(IN_OUTAGE) == NOTHING:
        return _judge_nothing(row, record)
    detected_s, sentence = _detected(record, sound.records[name], fault)
    named = [_named(made, sound, other, fault) for other in suppliers(name)]
    named_s, naming, by = min(named, key=lambda n: np.inf if n[0] is None else n[0])
    suspects = (c.suspect for poll in record.polls for c in poll.contradictions if _is_source(c.suspect))
    blamed = next((suspect for suspect in suspects if not _means(suspect, fault)), "")
    usually = max(_share(usual.ratio), _share(usual.attitude_ratio))
    if row.beyond > ALLOWED_SHARE and row.beyond > 1.5 * usually:
        verdict = Verdict.WRONG
    elif row.silent_s > SILENT_S + _silence(usual, fault.start_s, end_s):
        verdict = Verdict.SILENT
    elif all(_harmless(track, usual, ratio) for ratio in ("ratio", "attitude_ratio")):
        verdict = Verdict.HARMLESS
    else:
        verdict = Verdict.UNNAMED if named_s is None else Verdict.SOUND
    said: dict[str, Any] = {"detected_s": detected_s, "named_s": named_s, "sentence": naming or sentence, "named_by": by, "blamed": blamed}
    return replace(row, verdict=verdict, **said)


def _judge_nothing(row: Row, record: Record) -> Row:
    """The flight without a fault: covered, and nothing may be contradicted."""
    poll = next((poll for poll in record.polls if poll.contradictions), None)
    if row.beyond > ALLOWED_SHARE:
        row = replace(row, verdict=Verdict.WRONG)
    if poll is None:
        return row
    first = poll.contradictions[0]
    alarm: dict[str, Any] = {
        "detected_s": poll.t_s,
        "sentence": first.words(record.start_ns + round(1e9 * poll.t_s)),
        "blamed": first.suspect,
    }
    return replace(row, verdict=max(row.verdict, Verdict.FALSE_ALARM, key=list(Verdict).index), **alarm)


def _numbers(track: Track, usual: Track, fault: Fault, end_s: float) -> dict[str, Any]:
    """The numbers of a row."""
    return {
        "worst_m": _largest(track.horizontal_m),
        "healthy_worst_m": _largest(usual.horizontal_m),
        "worst_sigmas": _largest(track.ratio),
        "most_sigmas": _quantile(track.ratio),
        "healthy_sigmas": _largest(usual.ratio),
        "attitude_sigmas": _quantile(track.attitude_ratio),
        "healthy_attitude_sigmas": _quantile(usual.attitude_ratio),
        "beyond": max(_share(track.ratio), _share(track.attitude_ratio)),
        "recovered_s": _recovered(track.t_s, np.fmax(track.ratio, track.attitude_ratio), fault.end_s, end_s),
        "silent_s": _silence(track, fault.start_s, end_s),
    }


def _from(track: Track, start_s: float) -> Track:
    later = track.t_s >= start_s
    return Track(*(getattr(track, name)[later] for name in Track.__dataclass_fields__))


def _largest(values: np.ndarray) -> float | None:
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def _quantile(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, 0.99)) if len(known) else None


def _share(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known > LIMIT)) if len(known) else 0.0


def _silence(track: Track, start_s: float, end_s: float) -> float:
    """Longest time without a finite solution: a position, or an attitude where there never is a position."""
    t_s = track.t_s[np.isfinite(track.ratio if np.isfinite(track.ratio).any() else track.attitude_ratio)]
    return max((b - a for a, b in pairwise([start_s, *t_s.tolist(), end_s])), default=0.0)


def _harmless(track: Track, usual: Track, judged_by: str) -> bool:
    """Whether errors and sigmas stay about as they are without the fault."""
    worst, before = _largest(track.horizontal_m), _largest(usual.horizontal_m)
    if worst is not None and before is not None and worst > 1.5 * before + 1.0:
        return False
    ratio, reference = _quantile(getattr(track, judged_by)), _quantile(getattr(usual, judged_by))
    return reference is None or (ratio is not None and ratio < max(LIMIT, 1.3 * reference))


def _recovered(t_s: np.ndarray, ratio: np.ndarray, end_of_fault_s: float, end_s: float) -> float | None:
    """Seconds from the end of the fault until the error is covered for good."""
    wrong = t_s[(t_s >= end_of_fault_s) & ~(ratio <= LIMIT)]
    if not len(t_s) or t_s[-1] < end_s - SILENT_S or (len(wrong) and wrong[-1] > t_s[-1] - 1.0):
        return None
    return float(wrong[-1] - end_of_fault_s) if len(wrong) else 0.0


def _pairs(record: Record, reference: Record, start_s: float) -> list[tuple[Poll, Poll]]:
    """Polls from the start of the fault on, each with that of the flight without it."""
    return [(now, usual) for now, usual in zip(record.polls, reference.polls, strict=False) if now.t_s >= start_s]


def _detected(record: Record, reference: Record, fault: Fault) -> tuple[float | None, str]:
    """When a navigator first said anything that it does not say without the fault, and what."""
    usual_names = {(c.name, c.parties) for poll in reference.polls for c in poll.contradictions}
    for now, usual in _pairs(record, reference, fault.start_s):
        news = [c for c in now.contradictions if (c.name, c.parties) not in usual_names]
        more = [key for key, count in now.refused.items() if count > usual.refused[key] + EXCESS]
        after_s = now.t_s - fault.start_s
        if news:
            return after_s, news[0].words(record.start_ns + round(1e9 * now.t_s))
        if now.level > usual.level or (now.mode == Mode.SUSPECT and usual.mode != Mode.SUSPECT):
            return after_s, f"{now.mode}: {now.reason}"
        if more:
            return after_s, ": ".join(more[0])
        if now.alarm and now.alarm != usual.alarm:
            return after_s, now.alarm
        if set(now.excluded) - set(usual.excluded):
            return after_s, f"satellites excluded: {', '.join(now.excluded)}"
    return None, ""


def _named(made: Pass, sound: Pass, name: str, fault: Fault) -> tuple[float | None, str, str]:
    """When a navigator first named the faulty source, and how."""
    at_wire = [(s - fault.start_s, text) for text, s in made.refused_s.items() if text.split(":")[0] in fault.sources]
    best = (*min(at_wire), "decoder") if at_wire else (None, "", "")
    record, reference = made.records[name], sound.records[name]
    for now, usual in _pairs(record, reference, fault.start_s):
        after_s = now.t_s - fault.start_s
        if best[0] is not None and best[0] <= after_s:
            return best
        said = _names_source(now, usual, fault, record.start_ns + round(1e9 * now.t_s))
        if said:
            return after_s, said, name
    return best


def _names_source(now: Poll, usual: Poll, fault: Fault, t_ns: int) -> str:
    """The sentence that names the faulty source, if there is one."""
    usually = {(c.name, c.parties) for c in usual.contradictions}
    for c in now.contradictions:
        parties = (c.suspect,) if _is_source(c.suspect) else (c.suspect, *c.parties)
        if (c.name, c.parties) not in usually and any(_means(party, fault) for party in parties):
            return c.words(t_ns)
    for (source, phrase), count in now.refused.items():
        if source in fault.sources and count > usual.refused[source, phrase] + EXCESS:
            return f"{source}: {phrase}"
    if fault.sources == ("gnss/raw",):
        if now.alarm and now.alarm != usual.alarm:
            return now.alarm
        if set(now.excluded) - set(usual.excluded):
            return f"satellites excluded: {', '.join(now.excluded)}"
    reported = now.reason if now.reason != usual.reason and now.level > usual.level else ""
    return reported if any(source in reported for source in fault.sources) else ""


def _is_source(party: str) -> bool:
    """Whether a party of a contradiction is a topic, not a physical law or a setting."""
    return "/" in party


def _means(party: str, fault: Fault) -> bool:
    """Whether a party of a contradiction is a faulty source."""
    return any(source in party for source in fault.sources)
