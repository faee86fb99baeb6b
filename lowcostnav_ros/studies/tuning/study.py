"""A tuned vehicle: fitted on one half of the recordings, judged on the other, then fitted on all and written."""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.tables import Column, Table, number
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.studies.campaign import Workers
from lowcostnav_ros.studies.outages.result import End, OutageStudy
from lowcostnav_ros.studies.outages.study import Case, OutageError, Plan, study_outages
from lowcostnav_ros.studies.tuning.fit import OBSERVED, Advance, Fit, Trials, Tunable, fit
from lowcostnav_ros.studies.tuning.likelihood import Source

STEPS, FURTHER_STEPS = 9, 4
LENGTHS_S = (60.0,)
TOO_SURE = 1.5
"""Error over sigma beyond which sigmas are not to be believed."""


@dataclass(frozen=True)
class Lost:
    """What outages cost with a set of numbers: how many, at how many ends there was no solution; RMS error, m, and of error over sigma."""

    windows: int
    silent: int
    rms_m: float
    error_over_sigma: float


@dataclass(frozen=True)
class Tuned:
    """Result of tuning.

    Attributes
    ----------
    source : Source
        The first recording.
    parameters : list of Tunable
    half, whole : Fit
        Fitted on the first halves, and on all.
    judged : float
        Gain of log-likelihood over the second halves by the numbers of the first, of ``count`` innovations.
    outages : list of OutageStudy
        Of the second halves with the numbers to begin with and those of the first halves, by recording; empty where none fits.
    """

    source: Source
    parameters: list[Tunable]
    half: Fit
    whole: Fit
    judged: float
    count: int
    outages: list[OutageStudy]

    def lost(self) -> tuple[Lost, Lost] | None:
        """The outages with the numbers to begin with and with those of the first halves; None where none could be judged with both."""
        pairs, silent = [], [0, 0]
        for study in self.outages:
            own = [{o.after_s: o for o in f.outages} for f in study.flown if f.navigator == self.source.navigator]
            for start in own[0] if len(own) == 2 else ():
                both = [outages[start] for outages in own if start in outages]
                if len(both) < 2:
                    continue
                silent = [count + len(outage.silent_s) for count, outage in zip(silent, both, strict=True)]
                ends = [end for outage in both for end in outage.ends]
                pairs += [ends] if len(ends) == 2 else []
        return None if not pairs else (_lost([p[0] for p in pairs], silent[0]), _lost([p[1] for p in pairs], silent[1]))

    @property
    def is_better(self) -> bool:
        """Whether the numbers serve the user: they are more likely on what they were not fitted on, and an outage there costs no more."""
        lost = self.lost()
        if self.judged <= 0.0 or not any(self.learned()) or lost is None:
            return self.judged > 0.0 and any(self.learned())
        before, after = lost
        is_true = after.error_over_sigma <= max(TOO_SURE, before.error_over_sigma)
        return after.rms_m <= before.rms_m and after.silent <= before.silent and is_true

    def verdict(self) -> str:
        """Likelihood and outages on the halves that the numbers were not fitted on, in a sentence that begins with the answer."""
        lost, each = self.lost(), self.judged / max(self.count, 1)
        words = f"log-likelihood {self.judged:+.1f} over {self.count} innovations ({each:+.3f} each)"
        if lost is None:
            words += "; no outage could be judged"
        else:
            before, after = lost
            words += f"; {before.windows} outages of {LENGTHS_S[0]:.0f} s: {before.rms_m:.1f} m RMS before, {after.rms_m:.1f} m tuned"
            words += f", error over sigma {before.error_over_sigma:.2f} before, {after.error_over_sigma:.2f} tuned"
            words += f", without a solution {before.silent} and {after.silent}" if before.silent or after.silent else ""
        return f"{'Better' if self.is_better else 'Not better'} on what the numbers were not fitted on: {words}."

    def learned(self) -> list[bool]:
        """Which numbers the recordings tell."""
        return learned(self.parameters, self.whole)

    def values(self, of: Fit) -> dict[str, Any]:
        """The numbers of a fit that the recordings tell."""
        rows = zip(self.parameters, of.x.tolist(), self.learned(), strict=True)
        return {p.name: _rounded(p.at(x)) for p, x, learned in rows if learned}


def learned(parameters: Sequence[Tunable], of: Fit) -> list[bool]:
    """Which numbers a fit knows better than their priors do."""
    return [s < OBSERVED * math.log(p.within) for p, s in zip(parameters, of.sigma(), strict=True)]


def _lost(ends: Sequence[End], silent: int) -> Lost:
    rms = [math.sqrt(np.mean(np.square(some))) for some in ([e.horizontal_m for e in ends], [e.error_over_sigma for e in ends])]
    return Lost(len(ends), silent, *rms)


def tune(sources: Sequence[Source], every_s: float = 15.0, workers: Workers = None, advance: Advance | None = None) -> Tuned:
    """Tune a navigator over recordings.

    Parameters
    ----------
    sources : sequence of Source
        All of one navigator.
    every_s : float
        Seconds between the outages that judge, s.
    workers : int or str, optional
        Processes, or the address of a dask scheduler; all cores where None.
    advance : callable, optional
        Called with the share of the trials flown.

    Raises
    ------
    ValueError
        With a sentence, for recordings or settings that cannot be flown.
    """
    with Trials(sources, workers, advance) as trials:
        trials.gradients = STEPS + FURTHER_STEPS + 3  # and the curvature: at the start, and at the end of both fits
        first, second = trials.half(0), trials.half(1)
        nothing = np.zeros(len(trials.parameters))
        half = fit(trials, first, nothing, STEPS)
        whole = fit(trials, np.ones_like(first), half.x, FURTHER_STEPS)
        known = trials.blocks([nothing, np.where(learned(trials.parameters, whole), half.x, 0.0)])  # as it is written
        judged, count = float((known[1] - known[0]) @ second), int(trials.count() @ second)
        tuned = Tuned(sources[0], trials.parameters, half, whole, judged, count, [])
    for source in sources:
        tuned.outages.extend(_outages(source, tuned, every_s))
    return tuned


def _outages(source: Source, tuned: Tuned, every_s: float) -> list[OutageStudy]:
    """Lose GPS in the second half of a recording; nothing where that cannot be done."""
    with BagReader(source.bag) as reader:
        after_s = 0.5 * reader.duration_s
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / "tuned on the first half"
        write_vehicle(trial, tuned, tuned.half)
        case = Case(source.bag, Plan(LENGTHS_S, every_s, after_s), source.chain)
        try:
            return [study_outages(case, [source.config or config_dir(), trial])]
        except OutageError:
            return []


def write_vehicle(folder: Path, tuned: Tuned, of: Fit | None = None) -> Path:
    """Write the settings of a vehicle, ``<navigator>.yaml`` with each number's uncertainty; return the file."""
    of = of or tuned.whole
    values, sigmas = tuned.values(of), dict(zip((p.name for p in tuned.parameters), of.sigma().tolist(), strict=True))
    before = {p.name: p.value for p in tuned.parameters}
    name = tuned.source.navigator
    lines = [
        f"# Numbers of {name} tuned on recordings by the likelihood of its innovations ('lowcostnav tune').",
        "# Behind each: the number before, and the factor by which it is uncertain (one sigma).",
        f"{name}:",
        "  ros__parameters:",
    ]
    lines += [f"    {key}: {value} # {before[key]}; within {math.exp(sigmas[key]):.2f}" for key, value in values.items()]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.yaml"
    path.write_text("\n".join(lines) + ("\n" if values else " {}\n"), encoding="utf-8")
    return path


def tuning_table(tuned: Tuned) -> Table:
    """Numbers before and after, with their uncertainty."""
    rows = list(zip(tuned.parameters, tuned.whole.x.tolist(), tuned.whole.sigma().tolist(), tuned.learned(), strict=True))
    columns = (
        Column("setting", lambda r: r[0].name, left=True),
        Column("before", lambda r: _text(r[0].value)),
        Column("tuned", lambda r: _text(r[0].at(r[1])) if r[3] else "not observable"),
        Column("within a factor of", lambda r: number(math.exp(min(r[2], math.log(r[0].within)))), short="within\nfactor"),
        Column("unit", lambda r: r[0].unit, left=True),
    )
    return Table.of(f"{tuned.source.navigator}: numbers by the likelihood of the innovations", columns, rows, notes=(tuned.verdict(),))


def _text(value: Any) -> str:
    return ", ".join(number(v) for v in (value if isinstance(value, list) else [value]))


def _rounded(value: Any) -> Any:
    return [_rounded(v) for v in value] if isinstance(value, list) else float(f"{value:.4g}")
