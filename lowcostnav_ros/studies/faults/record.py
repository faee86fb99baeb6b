"""What is noted of one navigator on one flight: its errors against the truth, and what it said of itself when."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.estimation.aiding import Reason
from lowcostnav_ros.navigators.base import Navigator, NavigatorStatus
from lowcostnav_ros.replay.metrics import AXES, Errors

NO_SIGMA = 1e9
"""Stands for error over sigma where a position comes with a covariance that is none."""
_ATTITUDE = [AXES.index(axis) for axis in ("roll_deg", "pitch_deg", "heading_deg")]


@dataclass(slots=True)
class Poll:
    """What a navigator says at one moment: level, mode, sentence, contradictions, refusals so far by (where, phrase)."""

    t_s: float
    level: Level
    mode: str
    reason: str
    contradictions: tuple[Contradiction, ...]
    refused: Counter[tuple[str, str]]
    alarm: str
    excluded: tuple[str, ...]

    @classmethod
    def of(cls, t_s: float, status: NavigatorStatus, sources: Mapping[str, str]) -> "Poll":
        """Note a status; ``sources`` are those of the aids by name, under which parties and refusals stand."""
        refused: Counter[tuple[str, str]] = Counter()
        for record in status.inputs:
            for reason, count in record.rejected.items():
                refused[record.source, Reason.phrase_of(reason)] += count
        for aid in status.aids:
            for reason, count in aid.rejected.items():
                refused[sources.get(aid.name, aid.name), Reason.phrase_of(reason)] += count
        contradictions = tuple(
            replace(
                c,
                parties=(sources.get(c.parties[0], c.parties[0]), sources.get(c.parties[1], c.parties[1])),
                suspect=sources.get(c.suspect, c.suspect),
            )
            for c in status.contradictions
        )
        integrity = status.integrity
        found = ("", ()) if integrity is None else (integrity.alarm, tuple(integrity.excluded))
        return cls(t_s, status.level, status.mode, status.reason, contradictions, refused, *found)


@dataclass(slots=True)
class Track:
    """Errors of one navigator on one flight, by the stamps of its solutions.

    ``t_s`` (n,) seconds of the flight; ``horizontal_m`` (n,); ``ratio`` (n,) of the horizontal error and its sigma, the root of the error's
    square weighed by the inverse of its covariance; ``attitude_ratio`` (n,) the largest of roll, pitch and heading.  NaN: not estimated.
    """

    t_s: np.ndarray
    horizontal_m: np.ndarray
    ratio: np.ndarray
    attitude_ratio: np.ndarray


@dataclass
class Record:
    """One navigator on one flight."""

    start_ns: int
    polls: list[Poll] = field(default_factory=list)
    chunks: list[Errors] = field(default_factory=list)

    def add(self, errors: Errors) -> None:
        """Take some errors in."""
        self.chunks.append(errors)

    def poll(self, t_ns: int, navigator: Navigator) -> None:
        """Note what the navigator says now."""
        sources = {aid.status.name: aid.source for aid in navigator.aids}
        self.polls.append(Poll.of(1e-9 * (t_ns - self.start_ns), navigator.status(), sources))

    def track(self) -> Track:
        """All errors, in order of stamps."""
        if not self.chunks:
            return Track(*(np.empty(0) for _ in range(4)))
        stamps = np.concatenate([c.stamps_ns for c in self.chunks])
        values, sigmas = (np.concatenate([getattr(c, name) for c in self.chunks]) for name in ("values", "sigmas"))
        nees = np.concatenate([c.nees_horizontal for c in self.chunks])
        order = np.argsort(stamps, kind="stable")
        attitude = np.abs(values[:, _ATTITUDE]) / np.where(sigmas[:, _ATTITUDE] > 0.0, sigmas[:, _ATTITUDE], np.nan)
        horizontal_m = np.hypot(values[:, 0], values[:, 1])
        ratio = np.where(np.isfinite(horizontal_m) & ~(nees >= 0.0), NO_SIGMA, np.sqrt(np.maximum(nees, 0.0)))
        columns = 1e-9 * (stamps - self.start_ns), horizontal_m, ratio, attitude.max(axis=1, initial=0.0)
        return Track(*(column[order] for column in columns))
