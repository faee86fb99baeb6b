"""The study itself: every fault flown, every navigator judged against its own flight without the fault."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache

from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.simulation.fault import FAULTS, NOTHING
from lowcostnav_ros.studies.campaign import Workers, run_campaign
from lowcostnav_ros.studies.faults.flight import CHAIN, Pass, concerned, crew, flown
from lowcostnav_ros.studies.faults.judge import Row, Verdict, judge

QUICK = (
    NOTHING,
    "gps_stuck",
    "gps_spoofed_2_mps",
    "mag_turned_90",
    "imu_gyro_spike_large",
    "imu_clock_plus_1_s",
    "pitot_emptied",
    "dme_wrong_station_in_outage",
)


@dataclass(frozen=True, slots=True)
class Case:
    """A fault (empty: none) on the flight of a seed, flown by navigators; ``flying`` are all that the study needs on the sound flight."""

    fault: str
    seed: int
    navigators: tuple[str, ...]
    flying: tuple[str, ...]


def chosen(patterns: Collection[str] = (), quick: bool = False) -> list[str]:
    """Names of the faults that fit any of the patterns (``gps_*``); all without one, a handful with ``quick``.

    Raises
    ------
    SettingsError
        When nothing fits a pattern.
    """
    if not patterns:
        return list(QUICK if quick else FAULTS)
    names = [name for name in FAULTS if any(fnmatchcase(name, pattern) for pattern in patterns)]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise SettingsError(f"There is no fault '{pattern}'{nearest(pattern, list(FAULTS))}; see --list.")
    return names


def study(faults: Sequence[str], navigators: Collection[str] = (), seeds: Sequence[int] = (1,), workers: Workers = None) -> list[Row]:
    """Fly every fault on every seed; return a row for each navigator that it reaches, in order.

    Parameters
    ----------
    faults : sequence of str
        Names in :data:`FAULTS`.
    navigators : collection of str
        Of the chain; empty for all.
    seeds : sequence of int
    workers : int or str, optional
        Processes, or the address of a dask scheduler; None takes every core.
    """
    for name in navigators:
        if name not in CHAIN:
            raise SettingsError(f"There is no navigator '{name}' in the chain{nearest(name, list(CHAIN))}.")
    wanted = {name: [n for n in concerned(FAULTS[name].sources) if not navigators or n in navigators] for name in faults}
    flying = tuple(crew({name for names in wanted.values() for name in names}))
    cases = [Case(name, seed, tuple(wanted[name]), flying) for seed in seeds for name in faults if wanted[name]]
    return [row for rows in run_campaign(judged, cases, workers, label="faults") for row in rows]


def judged(case: Case) -> list[Row]:
    """Fly one case, and judge its navigators."""
    fault = FAULTS[case.fault]
    sound = healthy(case.seed, fault.outage, case.flying)
    try:
        made = flown(case.seed, fault, fault.outage, crew(case.navigators))
    except Exception as error:  # what a navigator raises is a finding, not the end of the study
        sentence = f"{type(error).__name__}: {error}"
        return [Row(case.fault, name, case.seed, Verdict.CRASHED, sentence=sentence) for name in case.navigators]
    return [judge(name, fault, case.seed, sound, made) for name in case.navigators]


@cache
def healthy(seed: int, outage: bool, names: tuple[str, ...]) -> Pass:
    """The flight of a seed without a fault, once a process."""
    return flown(seed, None, outage, names)
