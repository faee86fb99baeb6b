"""The likelihood of a navigator's innovations over recordings, in blocks of time.

With the right numbers innovations are independent and of the covariance S that the filter states, so their log-likelihood is
-1/2 (log det S + y' S^-1 y) (Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE TAC 15, 1970).  Student's
distribution takes the place of Gauss's, so that outliers, rejected or not, do not tune a filter.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity, Attitude, Measurement
from lowcostnav_ros.base.settings import from_mapping, to_mapping
from lowcostnav_ros.catalogue.building import make_navigator
from lowcostnav_ros.estimation.aiding import AidStatus
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.navigators.solutions import Solutions
from lowcostnav_ros.replay.bag_replay import Cast, ReplayOptions
from lowcostnav_ros.replay.links import Chain

FREEDOM = 6.0
"""Degrees of freedom of Student's distribution."""
BLOCK_S = 10.0
"""Blocks of innovations taken as independent of each other."""
SETTLED_S = 20.0
"""The start of a recording says more of the first alignment than of the noise."""
WHITE_S = 1.0
"""Errors of a receiver, of airspeed and of heading are taken as white at this spacing: a trial flies on one fix in this time."""
THIN_NS = 100_000_000
"""Least spacing of attitude and air data in a trial."""
OUTPUT_S = 0.5
"""Least spacing of the solutions of a trial: they are not looked at."""
LOST = 20.0
"""Loss of log-likelihood for each innovation that a trial no longer has."""


@dataclass(frozen=True)
class Source:
    """What is flown: a recording, the navigator tuned and those that feed it, and the folder of settings to begin with."""

    bag: Path
    navigator: str
    chain: tuple[str, ...]
    config: Path | None


@dataclass
class Flight:
    """What a navigator is fed over a recording.

    Attributes
    ----------
    navigator_class, settings
    measurements : list of Measurement
    first_ns, blocks
        Stamp of the first measurement and number of blocks.
    """

    navigator_class: type
    settings: Any
    measurements: list[Measurement]
    first_ns: int
    blocks: int


class _Tap:
    """In the place of a navigator: keeps what it is fed."""

    def __init__(self, fed: list[Measurement]) -> None:
        self._fed = fed

    def __call__(self, measurement: Measurement) -> Solutions:
        """Keep one."""
        self._fed.append(measurement)
        return Solutions()


def load(source: Source) -> Flight:
    """Read a recording; navigators before the one that is tuned are flown through it once.

    Raises
    ------
    ValueError
        (BagError, SelectionError, SettingsError) when it cannot be flown.
    """
    with BagReader(source.bag) as reader, BagReader(source.bag) as true_reader:
        cast = Cast(reader, true_reader, ReplayOptions(source.chain, source.config))
        stream, navigator = list(cast.stream()), cast.navigators[source.navigator]
        fed: list[Measurement] = []
        if len(source.chain) == 1:
            fed = stream
        else:
            chain = Chain(cast.navigators, reader.decoder.rules)
            navigator.feed = _Tap(fed)  # type: ignore[method-assign]
            for m in stream:
                for _ in chain.feed(m):
                    pass
    fed = list(thinned(fed))
    first_ns, last_ns = min(m.stamp_ns for m in fed), max(m.stamp_ns for m in fed)
    return Flight(type(navigator), navigator.settings, fed, first_ns, 1 + int(1e-9 * (last_ns - first_ns) / BLOCK_S))


def thinned(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
    """Attitude and air data at 10 Hz at most: between, attitude is turned on with its rate, and a trial is over the sooner."""
    last: dict[str, int] = {}
    for m in measurements:
        if isinstance(m, Attitude | AirVelocity):
            if m.stamp_ns - last.get(m.source, m.stamp_ns - THIN_NS) < THIN_NS:
                continue
            last[m.source] = m.stamp_ns
        yield m


def trial_settings(flight: Flight, changes: Mapping[str, Any]) -> Any:
    """Settings of a trial: ``changes``, receivers thinned to errors that are white, nothing learned in flight."""
    values = to_mapping(flight.settings)
    fixed: dict[str, Any] = {name: 0.0 for name in values if name == "learn_s" or name.endswith(".correlation_s")}
    for name in [n for n in values if n.endswith(".period_s") and n.replace(".period_s", ".correlation_s") in values]:
        fixed[name] = max(values[name], WHITE_S)
    fixed["horizon.output_period_s"] = max(values["horizon.output_period_s"], OUTPUT_S)
    return from_mapping(type(flight.settings), {**values, **fixed, **changes})


@dataclass
class Innovations:
    """Log-likelihood and number of innovations by block (b,), and the aids that had any, by their group of settings."""

    log_likelihood: np.ndarray
    count: np.ndarray
    groups: frozenset[str]

    def against(self, reference: "Innovations") -> np.ndarray:
        """Log-likelihood by block as if there were as many innovations as in a reference: a trial gains nothing by having fewer."""
        share = np.minimum(reference.count / np.maximum(self.count, 1), 2.0)
        missing = np.maximum(reference.count - 2.0 * self.count, 0.0)
        return self.log_likelihood * share - LOST * missing


def innovations(flight: Flight, changes: Mapping[str, Any]) -> Innovations:
    """Fly a trial."""
    navigator = make_navigator(trial_settings(flight, changes), flight.navigator_class)
    sums, count = np.zeros(flight.blocks), np.zeros(flight.blocks)
    seen: dict[str, np.ndarray] = {}
    groups: set[str] = set()
    keys = {aid.status.name: aid.key for aid in navigator.aids}

    def on_aid(status: AidStatus) -> None:
        S, y = status.innovation_covariance, status.innovation
        if S is None or y is None or seen.get(status.name) is y:
            return
        seen[status.name] = y
        block = int(1e-9 * (status.stamp_ns - flight.first_ns) / BLOCK_S)
        sign, log_det = np.linalg.slogdet(S)
        if sign <= 0.0 or not 0 <= block < flight.blocks or block < SETTLED_S / BLOCK_S:
            return
        sums[block] -= 0.5 * (log_det + (FREEDOM + len(y)) * math.log1p(status.nis / FREEDOM))
        count[block] += 1.0
        groups.add(keys.get(status.name, status.name))

    navigator.on_aid = on_aid
    navigator.feed_all(flight.measurements)
    return Innovations(sums, count, frozenset(groups))
