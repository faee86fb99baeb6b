"""A study of outages over a recording: windows by the clock, one pass for each share of them and each set of settings, on all cores."""

import copy
import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np

from lowcostnav_ros import __version__
from lowcostnav_ros.base.measurements import Attitude, GnssEpoch, GpsPosition, GpsVelocity, Measurement, NavSolution
from lowcostnav_ros.base.settings import settings_hash
from lowcostnav_ros.catalogue.config_files import SHIPPED, config_dir
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.decode import Decoder
from lowcostnav_ros.messages.rules import DecodeRules
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.replay.bag_replay import DEFAULT_TRUTH, Cast, ReplayOptions
from lowcostnav_ros.replay.evaluation import Truth
from lowcostnav_ros.replay.links import Chain
from lowcostnav_ros.replay.session import first_stamp
from lowcostnav_ros.replay.withhold import NS, Window, Withhold, check_sources
from lowcostnav_ros.studies.aside import room
from lowcostnav_ros.studies.campaign import CampaignError, Workers, count, run_campaign
from lowcostnav_ros.studies.outages.flight import Deferred, Loss, Losses
from lowcostnav_ros.studies.outages.judge import Reference, judge
from lowcostnav_ros.studies.outages.result import Flown, Outage, OutageStudy, statistics_of
from lowcostnav_ros.studies.outages.words import worst_sentence

TRUTH_STEP_NS = 95_000_000
"""Of the truth one state is taken in so long a time: between them it is as good as straight."""


class OutageError(ValueError):
    """A study that cannot be made; the message is one sentence that says what to do."""


@dataclasses.dataclass(frozen=True)
class Plan:
    """When GPS is lost and for how long.

    Attributes
    ----------
    lengths_s : tuple of float
    every_s, after_s : float
        Time between two losses, and from the start of the recording to the first, s.
    until_s : float or None
        No outage ends later than this after the start; None: the end of the recording.
    withhold : tuple of str or None
        Topics; None: all that carry position, velocity, attitude or raw observations of GPS.
    """

    lengths_s: tuple[float, ...] = (10.0, 60.0, 120.0)
    every_s: float = 15.0
    after_s: float = 60.0
    until_s: float | None = None
    withhold: tuple[str, ...] | None = None

    def windows(self, first_ns: int, end_ns: int, withheld: Sequence[str]) -> list[Window]:
        """Windows on the clock of a recording, in order, each of the greatest length that fits."""
        last_ns = end_ns if self.until_s is None else min(end_ns, first_ns + round(NS * self.until_s))
        last_s = (last_ns - first_ns) / NS - min(self.lengths_s)
        starts_ns = [first_ns + round(NS * s) for s in np.arange(self.after_s, last_s + 1e-6, self.every_s).tolist()]
        lengths_ns, sources = sorted((round(NS * length) for length in self.lengths_s), reverse=True), frozenset(withheld)
        fitting = [(start, next((n for n in lengths_ns if start + n <= last_ns), lengths_ns[-1])) for start in starts_ns]
        return [Window(sources, start, start + n, f"without GPS for {n / NS:g} s from {start / NS:.3f} s on") for start, n in fitting]


@dataclasses.dataclass(frozen=True)
class Case:
    """A pass: a recording, navigators with their settings, and the ``share``-th of ``of`` runs of windows (:func:`runs_of`)."""

    bag: Path
    plan: Plan
    navigators: tuple[str, ...] | None = None
    config: Path | None = None
    truth: str | None = None
    share: int = 0
    of: int = 1


@dataclasses.dataclass(frozen=True)
class Pass:
    """What one pass found: the study without its statistics."""

    study: OutageStudy
    skipped_s: tuple[float, ...]


def study_outages(case: Case, configs: Sequence[Path | None] = (None,), workers: Workers = None) -> OutageStudy:
    """Study a recording with one or several sets of settings.

    Parameters
    ----------
    case : Case
        Its ``config`` and share are not used.
    configs : sequence of Path or None
        Folders of ``<navigator>.yaml``; None takes those the recording carries, else the shipped ones.
    workers : int or str, optional
        Processes, or the address of a dask scheduler; all cores where None.  The numbers do not depend on it.

    Raises
    ------
    ValueError
        (OutageError, BagError, SelectionError, SettingsError, WithholdError) each with one sentence that says what to do.
    """
    shares = max(1, count(workers) // len(configs))
    cases = [dataclasses.replace(case, config=config, share=k, of=shares) for config in configs for k in range(shares)]
    try:
        passes = run_campaign(fly_case, cases, workers, label="outages")
    except CampaignError as error:
        raise error.__cause__ or error from None
    return _joined(passes)


def fly_case(case: Case) -> Pass:
    """Fly one pass."""
    options = ReplayOptions(case.navigators, case.config, truth=case.truth)
    with BagReader(case.bag) as reader:
        cast = Cast(reader, reader.with_decoder(Decoder(copy.deepcopy(reader.decoder.rules))), options)
        truth, stream = cast.true_states(TRUTH_STEP_NS), cast.stream()  # one after the other: they share the files
        head = next(stream)
        chain = Chain(cast.navigators, reader.decoder.rules, air_data=cast.air_data)
        flight = _Flight(case, cast, chain, first_stamp(head), truth)
        losses = flight.losses.fly(flight.reference.watch(m) for m in itertools.chain([head], stream))
        return flight.result([flight.judge(loss) for loss in losses])


class _Flight:
    """The windows of a case over a recording, and what is found in them."""

    def __init__(self, case: Case, cast: Cast, chain: Chain, first_ns: int, truth: Truth | None, kind: type[Loss] = Loss) -> None:
        self.case, self.cast, self.first_ns, self.reference = case, cast, first_ns, Reference(truth)
        self.withheld = _withheld(cast, case.plan.withhold)
        windows = case.plan.windows(first_ns, first_ns + cast.reader.end_ns - cast.reader.start_ns, self.withheld)
        if not windows:
            span = f"the recording lasts {cast.reader.duration_s:.0f} s and the first loss is to come after {case.plan.after_s:g} s"
            raise OutageError(f"No outage of {min(case.plan.lengths_s):g} s fits: {span}; shorten one of them.")
        self.settings = {name: settings_hash(navigator.settings) for name, navigator in cast.navigators.items()}
        self.losses = Losses(chain, runs_of(windows, first_ns, case.of)[case.share], not self.reference.is_whole, kind)

    def judge(self, loss: Loss) -> dict[str, Outage]:
        """Judge a window that is over: outages by navigator."""
        return judge(loss, self.reference, self.case.plan.lengths_s, self.first_ns)

    def result(self, judged: Sequence[dict[str, Outage]]) -> Pass:
        """Sum up all windows."""
        label, first_ns, plan = settings_label(self.case.config, self.cast.reader), self.first_ns, self.case.plan
        found = _by_navigator(self.losses, judged)
        study = OutageStudy(
            self.case.bag.name,
            __version__,
            first_ns / NS,
            first_ns / NS + self.cast.reader.duration_s,
            self.reference.words,
            tuple(sorted(self.withheld)),
            plan.lengths_s,
            plan.every_s,
            (),
            self.cast.selection.left_out,
            tuple(Flown(name, label, self.settings[name], outages) for name, outages in found.items()),
            self.reference.track_deg(),
        )
        return Pass(study, tuple((window.start_ns - first_ns) / NS for window in self.losses.skipped))


class StudyAlong:
    """A study in the very pass of a replay, whose ``watch`` option :meth:`begin` is; windows are flown aside where there are cores.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    seconds : float
        What the study has taken.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.seconds = plan, 0.0
        self._flight: _Flight | None = None
        self._refusal = OutageError("Nothing was replayed, so that no outage could be studied.")
        self._over = list[Deferred]()

    def begin(self, cast: Cast, chain: Chain, first_ns: int) -> "StudyAlong":
        """Lay the windows over a replay that begins."""
        try:
            self._flight = _Flight(Case(cast.reader.path, self.plan), cast, chain, first_ns, _truth_of(cast), Deferred)
        except OutageError as error:
            self._refusal = error
        return self

    def before(self, measurement: Measurement) -> None:
        """Lose GPS where a window begins, and fly the copies on."""
        if self._flight is not None and not self._flight.losses.is_done:
            began = perf_counter()
            self._flight.losses.before(self._flight.reference.watch(measurement))
            self.seconds += perf_counter() - began

    def take(self, name: str, solution: NavSolution) -> None:
        """Note a solution of the replay."""
        if self._flight is not None:
            self._flight.losses.take(name, solution)

    def after(self) -> None:
        """Fly the windows that are over."""
        if self._flight is not None and not self._flight.losses.is_done:
            began = perf_counter()
            self._fly(self._flight.losses.over())
            self.seconds += perf_counter() - began

    def _fly(self, losses: Iterable[Loss]) -> None:
        """The first one here, so that what the others need is loaded; then as many aside as there is room for."""
        for loss in losses:
            assert isinstance(loss, Deferred)
            running = sum(one.aside is not None and one.aside.is_running for one in self._over)
            loss.begin(is_aside=bool(self._over) and running < room())
            self._over.append(loss)

    def study(self) -> OutageStudy:
        """Return what was found, once the replay is over.

        Raises
        ------
        OutageError
            When there was no window, no GPS, or no position to lose it from.
        """
        if self._flight is None:
            raise self._refusal
        self._fly(self._flight.losses.rest())
        for loss in self._over:
            loss.collect()
        return _joined([self._flight.result([self._flight.judge(loss) for loss in self._over])])


def _truth_of(cast: Cast) -> Truth | None:
    """All true states of a recording that holds some, read on files of its own; an autopilot's own solution is none."""
    if cast.truth != DEFAULT_TRUTH:
        return None
    with BagReader(cast.reader.path) as own:
        other = copy.copy(cast)
        other.reference = own
        return other.true_states(TRUTH_STEP_NS)


def _by_navigator(losses: Losses, judged: Sequence[dict[str, Outage]]) -> dict[str, tuple[Outage, ...]]:
    """Outages by navigator, in the order of the chain."""
    found = {name: tuple(one[name] for one in judged if name in one) for name in losses.chain.links}
    return {name: outages for name, outages in found.items() if outages}


def stream_outages(
    measurements: Sequence[Measurement],
    navigators: Mapping[str, Navigator],
    plan: Plan,
    withheld: Sequence[str],
    truth: Truth | None = None,
) -> dict[str, tuple[Outage, ...]]:
    """Lose GPS in a stream of measurements: outages by navigator; errors are formed against the truth, else against the fixes."""
    first_ns = first_stamp(measurements[0])
    windows, reference = plan.windows(first_ns, max(m.stamp_ns for m in measurements), withheld), Reference(truth)
    losses = Losses(Chain(navigators), windows, not reference.is_whole)
    flown = losses.fly(reference.watch(m) for m in measurements)
    return _by_navigator(losses, [judge(loss, reference, plan.lengths_s, first_ns) for loss in flown])


def runs_of(windows: Sequence[Window], first_ns: int, count: int) -> list[Sequence[Window]]:
    """Windows, in order, as ``count`` runs of nearly the same work: each flies from ``first_ns`` to its last loss, and its windows."""
    least, most = 0, sum(w.end_ns - w.start_ns for w in windows) + windows[-1].start_ns - first_ns
    while least + NS < most:
        runs = _runs_within(windows, first_ns, (least + most) // 2)
        least, most = (least, (least + most) // 2) if len(runs) <= count else ((least + most) // 2, most)
    runs = _runs_within(windows, first_ns, most)
    return runs + [()] * (count - len(runs))


def _runs_within(windows: Sequence[Window], first_ns: int, most_ns: int) -> list[Sequence[Window]]:
    """Runs that each take no more than ``most_ns`` of flight, or are one window."""
    cuts, flown = [0], 0
    for k, window in enumerate(windows):
        flown += window.end_ns - window.start_ns
        if k > cuts[-1] and window.start_ns - first_ns + flown > most_ns:
            cuts.append(k)
            flown = window.end_ns - window.start_ns
    return [windows[a:b] for a, b in itertools.pairwise([*cuts, len(windows)])]


def settings_label(config: Path | None, reader: BagReader) -> str:
    """What the settings are called: ``shipped``, ``recorded`` (the recording carries them), or the name of their folder."""
    if config is None:
        return SHIPPED if reader.settings_folder is None else "recorded"
    return SHIPPED if config.resolve() == config_dir().resolve() else config.resolve().name


def _withheld(cast: Cast, wanted: Sequence[str] | None) -> list[str]:
    if wanted is not None:
        check_sources([Withhold(tuple(wanted))], cast.fed)
        return list(wanted)
    found = [source for source in cast.fed if is_of_gps(source, cast.reader.decoder.rules)]
    if not found:
        raise OutageError(f"The recording has no GPS that could be lost, only {', '.join(cast.fed)}; name topics with --withhold.")
    return found


def is_of_gps(source: str, rules: DecodeRules) -> bool:
    """Whether a topic carries a position, velocity, attitude or raw observations of GPS."""
    kind = rules.kind_of(source)
    if kind is None or kind.measurement is None:
        return False
    first = rules.kinds.get(source, source).partition("/")[0].rstrip("0123456789")
    return kind.measurement in (GpsPosition, GpsVelocity, GnssEpoch) or (kind.measurement is Attitude and first == "gps")


def _joined(passes: Sequence[Pass]) -> OutageStudy:
    """Put the shares together, and sum up."""
    lengths_s, merged = passes[0].study.lengths_s, dict[tuple[str, str], Flown]()
    for flown in (f for one in passes for f in one.study.flown):
        before = merged.get((flown.navigator, flown.settings))
        outages = flown.outages if before is None else before.outages + flown.outages
        merged[flown.navigator, flown.settings] = dataclasses.replace(flown, outages=tuple(sorted(outages, key=lambda o: o.start_s)))
    summed = []
    for flown in merged.values():
        statistics = tuple(s for length_s in lengths_s if (s := statistics_of(flown.outages, length_s)) is not None)
        worst = tuple(worst_sentence(flown, s.length_s) for s in statistics)
        summed.append(dataclasses.replace(flown, statistics=statistics, worst=worst))
    if not summed:
        raise OutageError("No navigator had a position when GPS was lost; look at the replay, or let the first loss come later (--after).")
    longest = max(passes, key=lambda one: len(one.study.track_deg)).study
    skipped = tuple(sorted({s for one in passes for s in one.skipped_s}))
    return dataclasses.replace(longest, flown=tuple(summed), without_gps=skipped)
