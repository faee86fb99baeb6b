"""Aids: one small module per sensor, all of one form.

An aid has three verbs.  ``innovation`` computes measured minus predicted with its Jacobian and noise and changes nothing;
``control`` decides: fuse, reject, limit, or recover after a long run of rejections; ``fuse`` applies.  One status record serves all,
so that a person reads in flight, for every aid alike, what it saw, whether it was used and, if not, why.

A :class:`Sensor` is what a navigator's list names: the settings of a sensor and the aids that use it.
"""

import copy
import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, ClassVar, Protocol

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.small_matrices import at_least
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Block, Layout
from lowcostnav_ros.estimation.time_offsets import TimeOffsets


class Reason(str):
    """Why a measurement is not used: a fixed ``phrase`` to count by; the text may add what is this measurement's own."""

    phrase: str

    def __new__(cls, phrase: str, detail: str = "", joint: str = ": ") -> "Reason":
        """Make the reason ``phrase``, or ``phrase: detail``; ``joint`` stands between the two where another reads better."""
        text = f"{phrase}{joint}{detail}" if detail else phrase
        made = super().__new__(cls, text)
        made.phrase = phrase
        return made

    @classmethod
    def of(cls, text: str) -> "Reason":
        """The reason of a text ``phrase: detail``; empty for none."""
        phrase, _, detail = text.partition(": ")
        return cls(phrase, detail)

    @staticmethod
    def phrase_of(reason: str) -> str:
        """What a reason is counted by: its phrase, or a plain text itself."""
        return getattr(reason, "phrase", reason)


class Decision(Enum):
    """What ``control`` made of an innovation."""

    FUSE = "fuse"
    LIMIT = "limit"
    REJECT = "reject"
    RECOVER = "recover"


BEYOND_GATE = "innovation beyond gate"
LIMITED = "innovation limited"
RECOVERED = "recovered after rejections"
NOT_FINITE = "innovation not finite"
NO_CORRECTION = "correction not finite"


class CorrectionNotFinite(ArithmeticError):
    """Raised by a host that is asked to move its state by what is no number; the state is as before."""


@dataclass(frozen=True)
class GateSettings:
    """How an aid's innovations are tested."""

    probability: float = setting(0.9995, "Share of true innovations the gate lets pass.", minimum=0.5, maximum=0.9999999)
    recovery_s: float = setting(10.0, "Rejecting this long makes the aid recover (widen or re-initialise).", unit="s", minimum=0.0)


@dataclass(frozen=True)
class SensorSettings:
    """Where a sensor's messages come from; the base of every sensor's settings."""

    topics: list = setting([], "Topics in place of its own, in their order; empty: its own.")
    frames: list = setting([], "Frame ids accepted beside the usual ones; 'any' accepts all.")
    late_s: float = setting(0.0, "Its stamps are so much later than what they stamp; corrected.", unit="s", minimum=-1.0, maximum=1.0)


@dataclass(slots=True)
class Innovation:
    """Measured minus predicted, with what is needed to fuse it.

    ``y`` (m,), ``H`` (m, n), ``R`` (m, m); ``observation`` (m,) is what was measured, in the units of ``Aid.labels``; ``free`` (n,) holds
    0 for states that are considered, not moved; None moves all.  ``turns`` (m,) is 1 for
    components that change as the velocity of the core does, where that is no state; ``late`` (m, m) the covariance that an uncertain offset
    of its stamp adds, where that matters.
    """

    y: np.ndarray
    H: np.ndarray
    R: np.ndarray
    observation: np.ndarray
    free: np.ndarray | None = None
    turns: np.ndarray | None = None
    late: np.ndarray | None = None


@dataclass(slots=True)
class AidStatus:
    """The record every aid keeps; the same names live, in replay files and in reports.

    ``test_ratio`` is the normalised innovation squared over its gate: above 1 is rejected.  Arrays have one entry per label.
    """

    name: str
    labels: tuple[str, ...]
    stamp_ns: int = 0
    observation: np.ndarray | None = None
    innovation: np.ndarray | None = None
    innovation_variance: np.ndarray | None = None
    innovation_covariance: np.ndarray | None = None
    nis: float = 0.0
    test_ratio: float = 0.0
    accepted: bool = False
    reason: str = "nothing received yet"
    accepted_ns: int | None = None
    fused: int = 0
    rejected: Counter = field(default_factory=Tally)

    def age_s(self, now_ns: int) -> float | None:
        """Seconds since the last accepted measurement, None before the first."""
        return None if self.accepted_ns is None else 1e-9 * (now_ns - self.accepted_ns)


class Trust(Protocol):
    """What an aid asks of the beliefs of its host.

    ``agrees_again(aid)`` tells that an excluded source is sound again; ``is_frozen(aid)``: why a source that contradicts the prediction is
    no measurement; ``noise_factor(aid)``: what its stated variance is to be multiplied by.
    """

    def agrees_again(self, aid: "Aid") -> None: ...
    def is_frozen(self, aid: "Aid") -> str: ...
    def noise_factor(self, aid: "Aid") -> float: ...


class Host(Protocol):
    """What an aid asks of the navigator it serves.

    ``layout`` names the states; ``P`` (n, n) is their covariance; ``core`` holds the mean and offers the views of
    :mod:`lowcostnav_ros.cores.views`; ``correct(dx)`` injects a correction (n,), or raises
    :class:`CorrectionNotFinite`; ``gps_good(stamp_ns)``: GPS holds the solution.
    ``inertial_is_suspect``: the IMU is known to be worse than set.  ``offsets``: of the stamps, where they can be seen.
    ``excluded(aid)``: why its source contradicts others and is not to be used; ``recovery_s(aid, stamp_ns)``: how long it must be
    rejected before the solution recovers to it; ``movable`` (n,): 0 for states that no measurement may move at present, None: all may.
    """

    name: str
    layout: Layout
    core: Any
    inertial_is_suspect: bool
    offsets: TimeOffsets | None
    movable: np.ndarray | None

    @property
    def trust(self) -> Trust: ...
    @property
    def P(self) -> np.ndarray: ...
    def correct(self, dx: np.ndarray) -> None: ...
    def gps_good(self, stamp_ns: int) -> bool: ...
    def excluded(self, aid: "Aid") -> str: ...
    def aids_of(self, kind: type) -> list: ...
    def recovery_s(self, aid: "Aid", stamp_ns: int) -> float: ...


AGREE_NS = 5_000_000_000
"""An excluded source that has strayed and agrees with the prediction again for so long is believed again."""
BACK = 0.3
"""Share of the largest innovation, while it strayed, within which it agrees: a covariance that grew is no agreement."""
SHARED = ("wind", "updraught")
"""Blocks of the air mass: one for all sensors."""
NAMED_S = 120.0
"""Uplinked data is named in a reason this long after it was used."""
SLACK_NS = 1e6
"""Jitter of stamps that does not make a measurement miss its period."""


class Aid(ABC):
    """Base of all aids: one innovation and its record.

    A subclass declares the class attributes below, gives ``innovation`` and may override ``blocks``, ``control``, ``fuse`` or ``recover``.

    Attributes
    ----------
    name, labels
        Of the status record; a label carries its unit.
    measurement, topic
        Type it takes and the topic it comes on; an aid without a topic is applied at the navigator's outputs.
    views : tuple of Protocol
        What it asks of the core of its host (:mod:`lowcostnav_ros.cores.views`).
    teaches : tuple of str
        Blocks that alone may move while GPS is good; empty: all may.
    is_fix : bool
        Whether an accepted measurement holds the position as GPS does.
    measures_velocity : bool
        Whether it is a GPS receiver's velocity over ground.
    last_resort : bool
        Limit an innovation beyond the gate instead of rejecting it while nothing else holds the solution (see :meth:`is_last`).
    keeps_slots : bool
        Whether it assigns states to stations or channels: it waits while a navigator tries several headings.
    thins_itself : bool
        Whether :meth:`due` keeps the period (of each station, say) rather than the sensor's channel.
    needs_rate : bool
        Whether the rate of turn of the newest inertial sample is to be had from the core.
    updates_alone : bool
        Whether it updates the covariance itself; offsets of stamps are not estimated beside such an aid.
    period_s : float
        At most one measurement in this time, unless it thins itself.
    source : str
        Topic it subscribes to: its own, unless its sensor's settings name another.
    applied : Innovation or None
        What was fused last.
    decision : Decision or None
        What was made of the last measurement; None when there was no innovation.
    unresolved : (int, ndarray (m,)) or None
        Stamp and innovation of the last rejection while rejecting lasts.
    size : float
        Innovation in sigmas of the measurement's own noise, root mean square over its components.
    latches : list of Latch
        Contradictions that it finds itself.
    seeds : tuple of slice
        States that a navigator may begin with from what it measures.
    """

    name: ClassVar[str]
    labels: ClassVar[tuple[str, ...]]
    measurement: ClassVar[type[Measurement]] = Measurement
    topic: ClassVar[str] = ""
    views: ClassVar[tuple[type, ...]] = ()
    teaches: ClassVar[tuple[str, ...]] = ()
    is_fix: ClassVar[bool] = False
    measures_velocity: ClassVar[bool] = False
    last_resort: ClassVar[bool] = False
    keeps_slots: ClassVar[bool] = False
    thins_itself: ClassVar[bool] = False
    needs_rate: ClassVar[bool] = False
    updates_alone: ClassVar[bool] = False
    seeds: tuple[slice, ...] = ()

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        self.settings, self.key, self.stations = settings, key, stations
        self.gate: GateSettings = settings.gate
        self.threshold = chi_square.threshold(self.gate.probability, len(self.labels))
        self.status = AidStatus(self.own(self.name), self.labels)
        self.source, self.period_s = self.topic, getattr(settings, "period_s", 0.0)
        self.applied: Innovation | None = None
        self.decision: Decision | None = None
        self.unresolved: tuple[int, np.ndarray] | None = None
        self.latches: list[Latch] = []
        self.size = 0.0
        self._teaching: np.ndarray | None = None
        self.rejecting_since_ns: int | None = None
        self._agreeing_since_ns: int | None = None
        self._strayed = 0.0

    # what it is made of ------------------------------------------------------------------------------------------------------

    @property
    def remark(self) -> str:
        """What is odd about its settings beside the data, in words; empty for nothing."""
        return ""

    def own(self, name: str) -> str:
        """A name of this aid, of its blocks or their labels; a second sensor's carry its key (``baro2_height``)."""
        sensor = self.key.rstrip("0123456789")
        if sensor == self.key or name in SHARED:
            return name
        return self.key + name[len(sensor) :] if name.startswith(sensor) else f"{self.key}_{name}"

    def blocks(self) -> list[Block]:
        """State blocks it needs; one that another aid has brought already (the wind) is shared."""
        return []

    def attach(self, host: Host) -> None:
        """Find its states in the layout of its host, once that is known.

        Raises
        ------
        SettingsError
            When the core of the host lacks a view.
        """
        for view in self.views:
            if not isinstance(host.core, view):
                what = (view.__doc__ or view.__name__).splitlines()[0].rstrip(".").lower()
                raise SettingsError(f"{host.name} cannot take the aid '{self.key}': it does not estimate {what}.")
        self._teaching = host.layout.mask(*map(self.own, self.teaches)) if self.teaches else None
        self._all = np.ones(host.layout.size)
        self.restart()

    def restart(self) -> None:
        """Forget what was received; the counters stay."""
        self.status.accepted_ns = self.rejecting_since_ns = self._agreeing_since_ns = self.unresolved = None
        self._strayed = 0.0
        for latch in self.latches:
            latch.clear()

    def is_fresh(self, now_ns: int) -> bool:
        """Whether it used a measurement within the time-out of its sensor."""
        age_s = self.status.age_s(now_ns)
        return age_s is not None and age_s <= self.settings.timeout_s

    def since_s(self, measurement: Measurement) -> float:
        """Seconds since it last used a measurement, ``inf`` before the first."""
        age_s = self.status.age_s(measurement.stamp_ns)
        return math.inf if age_s is None else age_s

    # the verbs ---------------------------------------------------------------------------------------------------------------

    def due(self, measurement: Any) -> bool:
        """Whether a measurement is wanted at all now, beyond the period of its sensor."""
        return True

    @abstractmethod
    def innovation(self, measurement: Any, host: Host) -> Innovation | str:
        """Measured minus predicted, or the reason why there is none (one short phrase).  Changes nothing."""

    def after(self, measurement: Any, host: Host) -> None:  # noqa: B027 - most aids have nothing to do then
        """Called once all aids of its channel have had a measurement."""

    def words(self, now_ns: int) -> str:
        """What it contributes now, for people; empty for nothing."""
        return ""

    def ago(self, what: str, now_ns: int) -> str:
        """``what`` and how long ago it was used, for people; empty when that was long ago or never."""
        age_s = self.status.age_s(now_ns)
        return f"{what} {age_s:.0f} s ago" if age_s is not None and age_s <= NAMED_S else ""

    def free(self, stamp_ns: int, host: Host) -> np.ndarray | None:
        """States it may move, (n,): those it teaches while GPS is good, else all (None)."""
        return self._teaching if self._teaching is not None and host.gps_good(stamp_ns) else None

    def is_last(self, stamp_ns: int, test_ratio: float, host: Host) -> bool:
        """Whether a :attr:`last_resort` is the last there is."""
        return not host.gps_good(stamp_ns)

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """Decide what to do with an innovation of this test ratio, and why when it is not fused."""
        excluded = host.excluded(self)
        if excluded:
            self._watch_excluded(stamp_ns, test_ratio, host)
            return Decision.REJECT, excluded
        if test_ratio <= 1.0:
            self.rejecting_since_ns, self._strayed = None, 0.0
            return Decision.FUSE, ""
        if self.last_resort and self.is_last(stamp_ns, test_ratio, host):
            return Decision.LIMIT, LIMITED
        if self.rejecting_since_ns is None:
            self.rejecting_since_ns = stamp_ns
        frozen = host.trust.is_frozen(self)
        if frozen:
            return Decision.REJECT, frozen
        if stamp_ns - self.rejecting_since_ns < 1e9 * host.recovery_s(self, stamp_ns):
            return Decision.REJECT, BEYOND_GATE
        doubt = self.doubt(stamp_ns, host)
        if doubt:
            return Decision.REJECT, doubt
        self.rejecting_since_ns = None
        return Decision.RECOVER, RECOVERED

    def _watch_excluded(self, stamp_ns: int, test_ratio: float, host: Host) -> None:
        """Tell the host when an excluded source has strayed from the prediction and come back to it for good."""
        size = self.size
        if self.rejecting_since_ns is None:
            self.rejecting_since_ns = stamp_ns
        if test_ratio > 1.0:
            self._strayed = max(self._strayed, size)
        if test_ratio > 1.0 or size >= BACK * self._strayed:
            self._agreeing_since_ns = None
        elif self._agreeing_since_ns is None:
            self._agreeing_since_ns = stamp_ns
        elif stamp_ns - self._agreeing_since_ns >= AGREE_NS:
            self._strayed, self._agreeing_since_ns = 0.0, None
            host.trust.agrees_again(self)

    def doubt(self, stamp_ns: int, host: Host) -> str:
        """Why its host is not to recover to it, though it has been rejected for long; empty: it may."""
        return ""

    def seen_by(self, host: Host, measurement: Any) -> Innovation | str:
        """The innovation of a measurement that was used just now, for a host with another core."""
        return self.innovation(measurement, host)

    def prepare(self, measurement: Any, innovation: Innovation, host: Host) -> Innovation:
        """Called once a measurement is to be used: may assign a state to its station; returns the innovation to fuse."""
        return innovation

    def fuse(self, innovation: Innovation, host: Host) -> None:
        """Apply: update the covariance, inject the correction."""
        host.correct(self.updated(innovation, host))

    def updated(self, innovation: Innovation, host: Host) -> np.ndarray:
        """Update the covariance; return the correction (n,)."""
        free = innovation.free
        if free is None:
            free = self._all if host.movable is None else host.movable
        if host.offsets is None:
            return kalman.update(host.P, innovation.y, innovation.H, innovation.R, free)
        return host.offsets.update(self, innovation, free, host, learn=self.decision is Decision.FUSE)

    def recover(self, measurement: Any, innovation: Innovation, host: Host) -> None:
        """After a long run of rejections: widen the noise until the innovation passes the gate, and fuse."""
        innovation.R = innovation.R + np.outer(innovation.y, innovation.y)
        self.fuse(innovation, host)

    def process(self, measurement: Any, host: Host) -> bool:
        """Run the three verbs on one measurement; return whether it was used."""
        status, self.applied, self.decision = self.status, None, None
        status.stamp_ns = measurement.stamp_ns
        innovation = self.innovation(measurement, host)
        if isinstance(innovation, str):
            return self.refuse(innovation)
        if host.offsets is not None:
            host.offsets.take_back(self, innovation, host)
        is_finite, S, nis, self.size = kalman.tested(host.P, innovation.y, innovation.H, innovation.R)
        if not is_finite:
            return self.refuse(NOT_FINITE)
        if nis > self.threshold and host.offsets is not None:
            S, nis = self._considered(innovation, S, nis, host.offsets, host)
        status.observation, status.innovation = innovation.observation, innovation.y.copy()
        status.innovation_variance = S.diagonal().copy()
        status.innovation_covariance = S
        status.nis, status.test_ratio = nis, nis / self.threshold
        decision, reason = self.control(measurement.stamp_ns, status.test_ratio, host)
        self.decision = decision
        if decision is Decision.REJECT:
            if self.rejecting_since_ns is not None:
                self.unresolved = measurement.stamp_ns, innovation.y
            return self.refuse(reason)
        self.unresolved = None
        innovation = self.applied = self.prepare(measurement, innovation, host)
        if decision is Decision.RECOVER:
            status.rejected[reason] += 1
            self.recover(measurement, innovation, host)
            if host.offsets is not None:
                host.offsets.recovered(self, host)
        else:
            if decision is Decision.LIMIT:
                status.rejected[reason] += 1
                innovation.R = innovation.R + (math.sqrt(status.test_ratio) - 1.0) * S  # Huber: what is pulled less is worth less
            self.fuse(innovation, host)
        status.accepted, status.reason, status.accepted_ns = True, reason, measurement.stamp_ns
        status.fused += 1
        return True

    def _considered(
        self, innovation: Innovation, S: np.ndarray, nis: float, offsets: TimeOffsets, host: Host
    ) -> tuple[np.ndarray, float]:
        """Covariance and normalised square of an innovation that passes the gate once the offset of its stamp is as uncertain as it is."""
        late = offsets.uncertainty(self, innovation, host)
        widened = kalman.normalised_innovation_squared(innovation.y, S + late)
        if widened > self.threshold or not offsets.explains(self, innovation, host):
            return S, nis
        innovation.late = late
        return S + late, widened

    def refuse(self, reason: str) -> bool:
        """Note that the measurement is not used, and count it under the phrase of its reason; return False."""
        self.status.accepted, self.status.reason = False, reason
        self.status.rejected[Reason.phrase_of(reason)] += 1
        return False


def reset_to(host: Host, rows: slice, y: np.ndarray, covariance: np.ndarray) -> None:
    """Reset some states to a measured value: correction ``y`` (m,), covariance (m, m), no correlation with other states."""
    kalman.reset_block(host.P, rows, covariance, host.core.history)
    dx = np.zeros(host.layout.size)
    dx[rows] = y
    host.correct(dx)


def floored(cov: np.ndarray, scale: float, floor: float) -> np.ndarray:
    """Covariance (m, m) scaled by the sigma factor ``scale``, no variance below ``floor`` squared, in oblique directions neither.

    Correlations of one are no measurement's: where there are any the diagonal alone counts.
    """
    out = np.empty(cov.shape)
    is_done = _floored(np.ascontiguousarray(cov, dtype=float), scale * scale, floor * floor, out)
    if is_done:
        return out
    spread = np.sqrt(cov.diagonal())
    if (np.abs(np.triu(cov, 1)) > SINGULAR * np.outer(spread, spread)).any():
        out = np.diag(out.diagonal())
    return at_least(out, floor)


@kernel
def _floored(cov, factor, least, out):
    """Fill ``out`` (m, m) with ``factor`` times a covariance, no variance below ``least``; return whether it has no oblique directions."""
    is_diagonal = True
    for i in range(cov.shape[0]):
        for j in range(cov.shape[0]):
            out[i, j] = cov[i, j] * factor
            is_diagonal = is_diagonal and (i == j or out[i, j] == 0.0)
        if out[i, i] < least:
            out[i, i] = least
        is_diagonal = is_diagonal and out[i, i] == out[i, i]  # a number
    return is_diagonal


SINGULAR = 0.9999
"""Correlation of two axes that no measurement has: an ellipse more than a hundred times as long as wide."""
Maker = Callable[[Any, str, Any], list[Aid]]


@dataclass(frozen=True)
class Sensor:
    """A sensor as a navigator's list names it.

    Attributes
    ----------
    name : str
        Name of its group of settings; a second one of its kind is called ``name2``.
    settings : type
        Settings dataclass; ``enabled``, ``period_s``, ``timeout_s``, ``latency_s`` and ``stations_file`` mean the same in all; a sensor
        with ``topic`` is off until that names its one topic.
    make : callable
        Makes its aids from the settings, the key and the station table.
    defaults : mapping
        Values in place of the settings' own defaults.
    quiet : bool
        Subscribed to only when enabled; the topics of others are subscribed to even when disabled, and their measurements compared with
        the other sources.
    """

    name: str
    settings: type
    make: Maker
    defaults: Mapping[str, Any] = field(default_factory=dict)
    quiet: bool = False

    def but(self, **defaults: Any) -> "Sensor":
        """The same sensor with other defaults."""
        return replace(self, defaults={**self.defaults, **defaults})

    def build(self, settings: Any, key: str, stations: Any) -> list[Aid]:
        """Make its aids; those of a second sensor take topics with its number in the first word (``gps2/fix``).

        Raises
        ------
        SettingsError
            When ``topics`` does not name as many topics as the sensor has.
        """
        topic = getattr(settings, "topic", None)
        if topic == "":
            return []
        aids = self.make(settings, key, stations)
        own = list(dict.fromkeys(aid.topic for aid in aids if aid.topic))
        number = key[len(self.name) :]
        topics = [f"{t.partition('/')[0]}{number}/{t.partition('/')[2]}" for t in own] if number else own
        if settings.topics and len(settings.topics) != len(own):
            raise SettingsError(f"'{key}.topics' must name {len(own)}, in place of {', '.join(own)}; got {len(settings.topics)}.")
        named = dict(zip(own, settings.topics or ([topic] if topic else topics), strict=True))
        for aid in aids:
            aid.source = named.get(aid.topic, "").lstrip("/")
        return aids

    def default(self) -> Any:
        """Settings as they are where nothing is set."""
        return self.settings(**copy.deepcopy(dict(self.defaults)))


def each(*aids: type[Aid]) -> Maker:
    """Make one of each of these aids."""
    return lambda settings, key, stations: [aid(settings, key, stations) for aid in aids]


def unique(blocks: Iterable[Block]) -> list[Block]:
    """Blocks in order, of several of one name the first: the wind is one, whatever depends on it."""
    found: dict[str, Block] = {}
    for block in blocks:
        found.setdefault(block.name, block)
    return list(found.values())
