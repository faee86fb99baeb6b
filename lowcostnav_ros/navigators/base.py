"""The form all navigators share: measurements in by one verb, fused solutions out, status for people."""

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, ClassVar, TypeVar

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import Health, ImuBlock, Integrity, MagneticField, Measurement, NavSolution, States
from lowcostnav_ros.base.modes import Level, Mode, level_of, register_modes
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.calibration.imu_look import look_at
from lowcostnav_ros.cores.imu_errors import AUTO, as_seen, times_the_profile
from lowcostnav_ros.estimation.aiding import NO_CORRECTION, RECOVERED, Aid, AidStatus, CorrectionNotFinite, Reason, Sensor, unique
from lowcostnav_ros.estimation.clocks import HELD
from lowcostnav_ros.estimation.error_state import Block, Layout
from lowcostnav_ros.estimation.horizon import HOLE_NS, TIME_JUMPED, FusionHorizon, unbroken
from lowcostnav_ros.estimation.inertial_spikes import InertialSpikes, Jolt
from lowcostnav_ros.estimation.smoothing import History
from lowcostnav_ros.estimation.time_offsets import TimeOffsets
from lowcostnav_ros.navigators.channel import Channel
from lowcostnav_ros.navigators.settings import sensor_of, settings_class
from lowcostnav_ros.navigators.solutions import Solutions, is_sound
from lowcostnav_ros.navigators.trust import Trust
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.mounting import mounted, mounting_dcm

SILENT_NS = 2_000_000_000
"""A navigator that puts out nothing for longer than this is not healthy, whatever its mode."""
ALL_REFUSED = 100
"""Nor is one that has refused so many messages in a row."""
TOGETHER = 64
"""Measurements that are taken in before what the horizon has passed is fused, where many are given at once."""

AidType = TypeVar("AidType", bound=Aid)
HEALTH_NS = 1_000_000_000
"""A navigator says how it is at least once in this time of stamps."""
LOOK_NS, ENOUGH_NS = 4_000_000_000, 2_000_000_000
"""An IMU is looked at for so long from its first sample on, or until the alignment; the second is the least for a profile seen."""
TOO_MUCH = {True: 10.0, False: 30.0}
"""White noise this many times the settings' is said, at rest and in motion, where vibration adds to it."""


@dataclass(frozen=True)
class HorizonSettings:
    """The fusion horizon and the outputs."""

    lag_s: float = setting(0.05, "Fusion stays this far behind the time base to outlast transport.", unit="s", minimum=0.0, maximum=10.0)
    output_period_s: float = setting(0.1, "Spacing of the fused solutions.", unit="s", minimum=0.005, maximum=10.0)
    jump_s: float = setting(
        10.0, "Stamps this far off are implausible; a time base that moves so far is a fresh start.", unit="s", minimum=1.0, maximum=3600.0
    )
    stamps: str = setting(
        "correct", "Offsets of stamps: correct them once they are sure, estimate them alone, or trust all stamps.",
        choices=("correct", "estimate", "trust"),
    )  # fmt: skip


@dataclass(slots=True)
class InputStatus:
    """What became of one input: counts, last stamp, rejections by reason."""

    source: str
    required: bool
    received: int = 0
    stamp_ns: int | None = None
    reason: str = ""
    rejected: Counter = field(default_factory=Tally)

    def reject(self, reason: str) -> None:
        """Count one rejection under the phrase of its reason."""
        self.rejected[Reason.phrase_of(reason)] += 1
        self.reason = reason


@dataclass(slots=True)
class NavigatorStatus:
    """How a navigator is: mode, why, how bad, one record per input and per aid, further values by name, what disagrees."""

    name: str
    mode: str
    reason: str
    level: Level
    stamp_ns: int | None
    sigmas: dict[str, float]
    inputs: list[InputStatus]
    aids: list[AidStatus]
    integrity: Integrity | None = None
    details: Mapping[str, str] = field(default_factory=dict)
    contradictions: tuple[Contradiction, ...] = ()


class Navigator(ABC):
    """Base of all navigators.

    A navigator is a list of sensors on a core.  A subclass declares the class attributes below and gives ``_fuse(measurement)``,
    ``_predict()``, ``_restart()`` and ``_sigmas()``; settings, state blocks, inputs and the way of a measurement to its aids follow.
    One with a filter gives its aids a layout and a core by ``_attach``.

    Parameters
    ----------
    settings : settings dataclass
        Of the class ``Settings``.  A ``magnetometer`` calibration in it is applied to every field that comes in.
    stations : StationTable or None
        Where ground stations stand; without it every range and radial is refused by name.
    latency_s : float
        How much later inputs may come than the settings of its sensors state.

    Attributes
    ----------
    name, room, colour
        Its name, the first part of its topics, and its colour in a report.
    OwnSettings : type
        Settings that are no sensor's; must hold ``horizon`` (:class:`HorizonSettings`).
    sensors : tuple of Sensor
        Its list where nothing else is configured.
    needs : tuple of str
        Sensors without which it cannot start.
    required : tuple of str
        Sources without which it does not run.
    inertial : str or None
        The IMU source that carries its state.
    inertial_is_suspect : bool
        Whether the IMU has shown errors beyond its settings.
    movable : ndarray (n,) or None
        0 for states that no measurement may move at present; None: all may.
    smooths : bool
        Whether it can keep a history for the smoother: its core reports to one, and so does what gives out its solutions.
    on_grid : bool
        Whether it puts out only at the first sample beyond a multiple of its output period: inertial samples may wait for that.
    not_observable : str
        Why there is no ``core.dynamics()`` to study its observability with; empty where there is.
    settings, inputs, aids, layout, core
        As given; source to whether it is required (a class may declare some); all aids in order; error states and what its aids see, where
        it has a filter.
    map_origins : mapping
        Of the navigators whose odometry it takes: name to the origin of its map frame.
    frames, kinds : mapping
        Of the sources of its sensors: further frame ids that are accepted, and the topic of the package whose message each carries.
    """

    name: str = ""
    room: ClassVar[str] = ""
    colour: ClassVar[str] = ""
    OwnSettings: ClassVar[type]
    Settings: ClassVar[type]
    sensors: ClassVar[tuple[Sensor, ...]] = ()
    needs: tuple[str, ...] = ()
    required: ClassVar[tuple[str, ...]] = ()
    not_observable: ClassVar[str] = ""
    smooths: ClassVar[bool] = False
    on_grid: ClassVar[bool] = False
    inertial_is_suspect: bool = False
    movable: np.ndarray | None = None
    inertial: str | None = None
    layout: Layout
    core: Any = None
    history: History | None = None
    offsets: TimeOffsets | None = None
    inputs: Mapping[str, bool] = {}
    frames: Mapping[str, tuple[str, ...]] = {}
    kinds: Mapping[str, str] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        register_modes(dict.fromkeys(cls.__dict__.get("healthy_modes", ()), Level.OK))
        if "OwnSettings" in cls.__dict__:
            cls.Settings = settings_class(cls, tuple(sensor.name for sensor in cls.sensors))

    def __init__(self, settings: Any, stations: Any = None, latency_s: float = 0.0) -> None:
        self.settings, self.stations = settings, stations
        self._equip()
        listed = [getattr(settings, key) for key in getattr(settings, "aids", ())]
        latency_s += max((getattr(own, "latency_s", 0.0) for own in listed), default=0.0)
        lag_ns, jump_ns = round(1e9 * (settings.horizon.lag_s + latency_s)), round(1e9 * settings.horizon.jump_s)
        self.output_period_ns = round(1e9 * settings.horizon.output_period_s)
        output_ns = self.output_period_ns if self.on_grid else 1
        self.horizon = FusionHorizon(lag_ns, self.inertial, jump_ns, next(iter(self.inputs), None), output_ns)
        self.spikes = InertialSpikes()
        self.origin: LocalFrame | None = None
        self.map_origins: Mapping[str, LocalFrame] = {}
        self.input_status = {source: InputStatus(source, required) for source, required in self.inputs.items()}
        self.mode: str = Mode.INITIALISING
        self.reason = "waiting for measurements"
        self.restarts: Counter[str] = Tally()
        self.on_aid: Callable[[AidStatus], None] | None = None
        self._out = Solutions()
        self._out_ns: int | None = None
        self._is_lost = False
        self._refused_in_row = 0
        self._said: tuple[int, str, Level, str] | None = None
        calibration = getattr(settings, "magnetometer", None)
        self._magnetometer = None if calibration is None or calibration == type(calibration)() else calibration
        self._first: list[ImuBlock] = []
        self.imu_words = ""
        self._turn = mounting_dcm(getattr(getattr(settings, "imu", None), "mounting_deg", ()))
        self.trust = Trust(self)

    # its list ----------------------------------------------------------------------------------------------------------------

    def _equip(self) -> None:
        """Make the aids of the list, and the channels that lead to them."""
        self.aids: list[Aid] = []
        self.channels: dict[str, list[Channel]] = {}
        self.clocked: list[Channel] = []
        self.frames: dict[str, tuple[str, ...]] = {}
        self.kinds: dict[str, str] = {}
        sources = {**self.inputs, **{source: False for source in self.own_inputs() if source not in self.inputs}}
        usual = {s.name: s for s in self.sensors}
        for key in getattr(self.settings, "aids", ()):
            own = getattr(self.settings, key)
            sensor = sensor_of(key, usual)
            aids = sensor.build(own, key, self.stations) if self.wants(key) else []
            if key not in usual and getattr(own, "topic", None) == "":
                raise SettingsError(f"'aids' adds '{key}', but '{key}.topic' is empty; name the topic it subscribes to.")
            kinds = {aid.source: aid.topic for aid in aids}  # an adapter's source carries messages of its own kind
            for aid in aids:
                aid.source = self.source_of(aid)
            enabled = getattr(own, "enabled", True)
            for source in dict.fromkeys(aid.source for aid in aids if aid.source):
                if enabled or not sensor.quiet:
                    sources.setdefault(source, False)
                    self.frames[source] = tuple(own.frames)
                    self.kinds |= {source: kinds[source]} if source in kinds else {}
            if enabled:
                self._connect(aids)
        missing = [need for need in self.needs if need not in getattr(self.settings, "aids", ())]
        if missing:
            raise SettingsError(f"{self.name} cannot start without '{missing[0]}'; name it in 'aids'.")
        required = self.required_sources()
        self.inputs = {source: needed or source in required for source, needed in sources.items()}

    def _connect(self, aids: list[Aid]) -> None:
        self.aids += aids
        for source, topic in dict.fromkeys((aid.source, aid.topic) for aid in aids):
            channel = Channel([aid for aid in aids if (aid.source, aid.topic) == (source, topic)])
            if source:
                self.channels.setdefault(source, []).append(channel)
            else:
                self.clocked.append(channel)

    def own_inputs(self) -> Iterable[str]:
        """Sources it subscribes to beside those of its sensors, in order before them."""
        return () if self.inertial is None else (self.inertial,)

    def wants(self, key: str) -> bool:
        """Whether a sensor of the list is made at all (a coupling may not use one)."""
        return True

    def required_sources(self) -> Collection[str]:
        """Sources without which it does not run."""
        return self.required

    def source_of(self, aid: Aid) -> str:
        """Source an aid is fed from; an adapter may feed it from another than its own."""
        return aid.source

    def aid_blocks(self) -> list[Block]:
        """State blocks of all aids, in the order of the list."""
        return unique(block for aid in self.aids for block in aid.blocks())

    def aid(self, name: str) -> Aid | None:
        """One of its aids, by the name of its record; None where it is not in use."""
        return next((aid for aid in self.aids if aid.status.name == name), None)

    def aids_of(self, kind: type[AidType]) -> list[AidType]:
        """Its aids of one class, in order."""
        return [aid for aid in self.aids if isinstance(aid, kind)]

    def _attach(self, layout: Layout, core: Any) -> None:
        """Take error states and core, and let the aids find theirs in them."""
        self.layout, self.core = layout, core
        shared = all(not aid.updates_alone for aid in self.aids)
        if shared and self.settings.horizon.stamps != "trust" and hasattr(core, "state_rate"):
            self.offsets = self._declared_offsets()
        self._take(core)
        for aid in self.aids:
            aid.attach(self)

    def _take(self, core: Any) -> None:
        """Fly a core, which may be new: it reports to what follows it."""
        self.core = core
        core.history = self.history if self.offsets is None else self.offsets
        if self.offsets is not None:
            self.offsets.history = self.history
            self.offsets.restart()

    def _declared_offsets(self) -> TimeOffsets:
        """Offsets of stamps, of which nothing is known but what the settings declare."""
        offsets = TimeOffsets(self.layout.size, self.core.velocity_rows)
        for aid in (aid for aid in self.aids if aid.source and aid.settings.late_s):
            offsets.declare(aid.source, aid.settings.late_s)
        return offsets

    @property
    def P(self) -> np.ndarray:
        """Covariance of the whole error state."""
        return self.core.P

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (an aid calls this).

        Raises
        ------
        CorrectionNotFinite
            When it is none; the one place at which all navigators look.
        """
        if not math.isfinite(sum(dx.tolist())):
            raise CorrectionNotFinite
        self.core.correct(dx)

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether GPS holds the solution."""
        return False

    def excluded(self, aid: Aid) -> str:
        """Why what an aid measures contradicts other sources and is not to be used; empty for nothing."""
        return self.trust.excluded(aid)

    def recovery_s(self, aid: Aid, stamp_ns: int) -> float:
        """How long an aid must have been rejected before the solution recovers to it."""
        return aid.gate.recovery_s

    # what its trust asks -----------------------------------------------------------------------------------------------------

    def recoveries(self) -> int:
        """How often the solution has recovered to GPS or begun anew."""
        return self.restarts.total() + sum(aid.status.rejected[RECOVERED] for aid in self.trust.receivers)

    def gps_alarm(self) -> bool:
        """Whether GPS is under suspicion beyond what cross-checks and innovations show."""
        return False

    def explains(self) -> bool:
        """Whether a fault of what carries the state is known, so that it was right to follow GPS."""
        return False

    def return_to(self, core: Any) -> None:
        """Go back to a state from which GPS has led away."""
        self.restarts["GPS is back where it was expected"] += 1
        if self.history is not None:
            self.history.cut()
        self.core.become(core)

    def doubt(self, stamp_ns: int) -> np.ndarray:
        """What contradictions add to the covariance (9, 9) of position, velocity and attitude NED: m, m/s, rad."""
        return self.trust.doubt(stamp_ns)

    def contradictions(self) -> tuple[Contradiction, ...]:
        """What contradicts what, for longer than a moment."""
        return self.trust.contradictions()

    def all_channels(self) -> list[Channel]:
        """The channels of all sources, those applied at the outputs first."""
        return [*self.clocked, *chain.from_iterable(self.channels.values())]

    def channel_of(self, aid: Aid) -> Channel:
        """The channel that leads to one of its aids."""
        return next(channel for channel in self.all_channels() if aid in channel.aids)

    def restart_channels(self) -> None:
        """Take the next measurement of every channel, whenever it comes."""
        for channel in self.all_channels():
            channel.begin()

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """Whether an aid is to be used now; a measurement that no aid uses does not begin a period."""
        return True

    def moves(self, measurement: Measurement) -> bool:
        """Whether anything may come of a measurement; where not, no inertial run is cut for it (see :meth:`.FusionHorizon.take`)."""
        return True

    def is_wanted(self, measurement: Measurement) -> bool:
        """Whether a channel of its source is due; of a GPS receiver every measurement counts."""
        source, stamp_ns = measurement.source, measurement.stamp_ns
        return source in self.trust.of_receivers or any(channel.is_due(stamp_ns) for channel in self.channels.get(source, ()))

    def use_channel(self, channel: Channel, measurement: Measurement) -> list[Aid]:
        """Give a measurement to the aids of a channel, if it is due; return those that used it."""
        if not channel.is_due(measurement.stamp_ns):
            return []
        wanted = [aid for aid in channel.aids if self.applies(aid, measurement)]
        if not wanted:
            return []
        channel.begin(measurement.stamp_ns)
        used = [aid for aid in wanted if aid.due(measurement) and self.use_aid(aid, measurement)]
        for aid in channel.aids:
            aid.after(measurement, self)
        return used

    def use(self, measurement: Measurement) -> list[Aid]:
        """Give a measurement to all aids of its source; return those that used it."""
        channels = (c for c in self.channels.get(measurement.source, ()) if isinstance(measurement, c.aids[0].measurement))
        used = [aid for channel in channels for aid in self.use_channel(channel, measurement)]
        if self.offsets is not None:
            for offset in self.offsets.judge(measurement.stamp_ns, self, corrects=self.settings.horizon.stamps == "correct"):
                self._forget_rejections(offset.device)
        return used

    def _forget_rejections(self, device: str) -> None:
        """That a device contradicted the state while its stamps were wrong means nothing once they are corrected."""
        for aid in self.aids:
            if aid.source.partition("/")[0] == device:
                aid.rejecting_since_ns = aid.unresolved = None

    def outage_words(self, now_ns: int) -> str:
        """What the aids contribute without GPS, for people (``; DME OAK, SJC; VOR OAK``)."""
        return "".join(f"; {words}" for words in (aid.words(now_ns) for aid in self.aids) if words)

    # the verb ----------------------------------------------------------------------------------------------------------------

    def feed(self, measurement: Measurement) -> Solutions:
        """Take one measurement (or block of inertial samples) in; return the fused solutions that became final, oldest first."""
        self._receive(measurement)
        return self._fused()

    def feed_all(self, measurements: Iterable[Measurement]) -> Solutions:
        """Take many in; return all fused solutions, the same as of one by one."""
        out = Solutions()
        for count, measurement in enumerate(measurements, 1):
            self._receive(measurement)
            if count % TOGETHER == 0 or not self.horizon.clocks.is_quiet:
                out.extend(self._fused())
        out.extend(self._fused())
        return out

    def _receive(self, measurement: Measurement) -> None:
        """Take a measurement in, to be fused in its order."""
        record = self.input_status.get(measurement.source)
        if record is None:
            return
        if isinstance(measurement, ImuBlock):
            record.received += len(measurement.stamps_ns)
            measurement = self._in_body_axes(measurement)
        else:
            record.received += 1
            if self._magnetometer is not None and isinstance(measurement, MagneticField):
                measurement = replace(measurement, field_b=self._magnetometer.apply(measurement.field_b))
        for piece in self.horizon.clocks.pieces(measurement):
            self._push(piece, record)
        self.horizon.move_on()

    def _fused(self) -> Solutions:
        """Fuse what the horizon has passed; return the solutions that became final."""
        for item in self.horizon.take(self.moves):
            refusal = self.refusal(item) or self.trust.take(item)
            if refusal:
                self.input_status[item.source].reject(refusal)
            elif isinstance(item, ImuBlock):
                self._screened(item)
            elif not self.horizon.is_idle:
                self._fuse(item)
            if self._is_lost:
                self._is_lost = False
                self.realign("solution not finite")
        out, self._out = self._out, Solutions()
        return out

    def _in_body_axes(self, block: ImuBlock) -> ImuBlock:
        """Inertial samples turned from the axes of the sensor into those of the body."""
        if self._turn is None:
            return block
        force_b, rate_b = (mounted(self._turn, values) for values in (block.specific_force_b, block.angular_rate_b))
        return replace(block, specific_force_b=force_b, angular_rate_b=rate_b)

    def _push(self, measurement: Measurement, record: InputStatus) -> None:
        """Give a measurement to the horizon; count what is refused."""
        refusal = self.horizon.push(measurement)
        if refusal == TIME_JUMPED:
            before = self._fused()
            self.reset("time base jumped")
            self._out, refusal = before, self.horizon.push(measurement)
        if self.horizon.clocks.refused:
            for source, reason in self.horizon.clocks.refused:
                self.input_status[source].reject(reason)
            self.horizon.clocks.refused.clear()
        if refusal and refusal != HELD:
            record.reject(refusal)
            self._refused_in_row += 1
        elif not refusal:
            self._refused_in_row = 0
            record.stamp_ns = measurement.stamp_ns if record.stamp_ns is None else max(record.stamp_ns, measurement.stamp_ns)

    def _screened(self, block: ImuBlock) -> None:
        """Take inertial samples in, spikes replaced; what the state gains instead comes at its own time."""
        if not self._first or block.stamps_ns[0] - self._first[0].stamps_ns[0] < LOOK_NS:
            self._first.append(block)
        for jolt, samples, phrase in self.spikes.screen(block):
            if phrase:
                self.input_status[block.source].reject(phrase)
            if jolt is not None:
                self._disturb(jolt)
            self._fuse(samples)

    def _still_looks(self) -> bool:
        """Whether an IMU that is to be flown as it shows itself has shown too little yet."""
        imu = getattr(self.settings, "imu", None)
        return imu is not None and imu.profile == AUTO and self._first[-1].stamp_ns - self._first[0].stamp_ns < ENOUGH_NS

    def _seen(self) -> Any:
        """IMU settings to begin with, by what its first seconds show, where they are to be found so; else None.  Says what is odd."""
        imu = getattr(self.settings, "imu", None)
        if imu is None or not self._first:
            return None
        joined = ImuBlock.joined(self._first)
        look = look_at(joined[: int(np.searchsorted(joined.stamps_ns, joined.stamps_ns[0] + LOOK_NS))])
        if look is None:
            return None
        most = TOO_MUCH[look.is_at_rest]
        odd = [f"{name} noise {n:.0f} times the settings'" for name, n in times_the_profile(imu, look).items() if n > most]
        self.imu_words = "; ".join([f"{look.words()}, set by it"] if imu.profile == AUTO else odd)
        return as_seen(imu, look) if imu.profile == AUTO else None

    def _disturb(self, jolt: Jolt) -> None:  # noqa: B027 - one without inertial sensors feels nothing
        """Take in what inertial samples that were held back amount to."""

    def ahead(self) -> ImuBlock | None:
        """Inertial samples beyond the horizon that follow the state without a hole, spikes replaced."""
        block, _ = self.horizon.ahead()
        if block is None or block.stamps_ns[0] - self.core.t_ns > HOLE_NS:
            return None
        return self.spikes.preview(unbroken(block)[0])

    def refusal(self, item: Measurement) -> str:
        """Why the next measurement in order of time is none; empty for nothing."""
        return ""

    @property
    def newest_ns(self) -> int | None:
        """The newest stamp, to which :meth:`output` carries the solution; None before the first."""
        return self.horizon.newest_ns

    def output(self) -> NavSolution | None:
        """The solution carried to the newest stamp by mean propagation alone (low latency), None before alignment."""
        solution = self._predict()
        return solution if solution is None or is_sound(solution) else None

    def status(self) -> NavigatorStatus:
        """Mode, reason, level and all records, for diagnostics and reports."""
        aids = [aid.status for aid in self.aids]
        inputs = list(self.input_status.values())
        mode, level, contradictions = self.mode, self._level(), self.contradictions()
        reason = "; ".join(filter(None, [self.reason, self._waits_for(), *self.horizon.clocks.sentences()]))
        silent = self._silence()
        if silent and level == Level.OK:
            mode, level, reason = Mode.FAILED, Level.ERROR, f"{silent}; {reason}"
        further = self._sigmas(), inputs, aids, self._integrity(), self._details(), contradictions
        return NavigatorStatus(self.name, mode, reason, level, self.horizon.passed_ns, *further)

    def deprived(self) -> Iterator[str]:
        """Aids of inputs on which nothing has come, each with its input (``airspeed: no air/velocity``)."""
        for source, channels in self.channels.items():
            if not self.input_status[source].received:
                yield from dict.fromkeys(f"{aid.own(aid.name)}: no {source}" for channel in channels for aid in channel.aids)

    def _waits_for(self) -> str:
        """Which required inputs have given nothing, while nothing is known yet."""
        missing = [record.source for record in self.input_status.values() if record.required and not record.received]
        return f"nothing on {', '.join(missing)}" if missing and self.mode == Mode.INITIALISING else ""

    def _silence(self) -> str:
        """Why a navigator that reports itself healthy is not: nothing comes out, or nothing that comes in can be used; empty when it is."""
        if self._refused_in_row >= ALL_REFUSED:
            return f"the last {self._refused_in_row} messages were all refused"
        newest_ns, last_ns = self.horizon.newest_ns, self._out_ns
        if newest_ns is None or last_ns is None:
            return ""
        silent_ns = newest_ns - last_ns - self.horizon.lag_ns
        return f"no solution for {1e-9 * silent_ns:.1f} s" if silent_ns > max(SILENT_NS, 3 * self.output_period_ns) else ""

    def reset(self, reason: str) -> None:
        """Restart: forget the state and what is held, keep the settings, the origin and the counters."""
        self.horizon.clear()
        self._out_ns = None
        self.spikes.clear()
        self.trust.clear()
        if self.offsets is not None:
            self.offsets = self._declared_offsets()
        self.realign(reason)

    def realign(self, reason: str) -> None:
        """Forget the state alone; what the horizon holds is used to align anew (so that this, too, repeats to the bit)."""
        self.restarts[reason] += 1
        self.mode, self.reason = Mode.INITIALISING, reason
        self.trust.forget_state()
        self._restart()
        if self.history is not None:
            self.history.cut()
        if self.core is not None:
            self._take(self.core)

    def keep_history(self) -> None:
        """Keep, from now on, what the smoother needs; the solutions stay the same to the bit."""
        self.history = History()
        if self.core is not None:
            self._take(self.core)

    def publish(self, solution: NavSolution) -> None:
        """Give out the fused solution of the present state, with what there is to say of it; begin anew soon where it is none."""
        if not is_sound(solution):
            self._is_lost = True
            return
        self._out_ns = solution.stamp_ns
        health = self._news(solution.stamp_ns)
        self._out.append(solution if health is None else replace(solution, health=health))
        if self.offsets is not None:
            self.offsets.note(self.core)
        if self.history is not None:
            self.history.output(solution, self.P, self.core.output_rows())

    def news_due_ns(self) -> int:
        """From what stamp on there is something to say with a solution, as long as nothing changes, and nothing contradicts."""
        said = self._said
        if said is None or said[1:3] != (self.mode, level_of(self.mode)):
            return 0
        return (said[0] + 1) * HEALTH_NS if said[3] == self.reason or _phrase(said[3]) == _phrase(self.reason) else 0

    def _news(self, stamp_ns: int) -> Health | None:
        """What there is to say of itself with the solution of a stamp; None: nothing new."""
        news, said = (stamp_ns // HEALTH_NS, self.mode, self._level(), self.reason), self._said
        if news == said or (said is not None and news[:3] == said[:3] and _phrase(news[3]) == _phrase(said[3])):
            return None
        self._said = news
        counts = self.restarts.total() + sum(aid.status.rejected[RECOVERED] for aid in self.aids if aid.is_fix), len(self.contradictions())
        return Health(stamp_ns, self.name, str(self.mode), int(self._level()), self.reason, *counts)

    def use_aid(self, aid: Aid, measurement: Measurement) -> bool:
        """Run one aid on one measurement and notify the observer, if there is one."""
        try:
            used = aid.process(measurement, self)
        except CorrectionNotFinite:
            used = aid.refuse(NO_CORRECTION)
        if self.on_aid is not None:
            self.on_aid(aid.status)
        return used

    def _details(self) -> Mapping[str, str]:
        """Further values for diagnostics, by name."""
        known = {} if self.offsets is None else self.offsets.known
        stamps = {f"stamps of {device}": offset.words() for device, offset in known.items()}
        seen = {"imu": self.imu_words} if self.imu_words else {}
        return seen | {aid.own(aid.name): aid.remark for aid in self.aids if aid.remark} | stamps

    def _states(self, P: np.ndarray, first: int, end: int | None = None) -> States:
        """Estimates of the states ``first`` to before ``end`` (None: the last) with their sigmas, by label."""
        part = slice(first, end)
        return States(self.layout.labels[part], self.core.estimate[part].copy(), P.diagonal()[part].copy())

    @abstractmethod
    def _fuse(self, item: Measurement) -> None:
        """Take the next measurement in order of time."""

    @abstractmethod
    def _predict(self) -> NavSolution | None:
        """The solution carried to the newest stamp."""

    @abstractmethod
    def _restart(self) -> None:
        """Forget the state."""

    @abstractmethod
    def _sigmas(self) -> dict[str, float]:
        """Sigmas for people, unit in the names."""

    def set_origin(self, lat: float, lon: float, height: float) -> None:
        """Fix the geodetic origin (rad, rad, m) of the local map frame, once."""
        if self.origin is None:
            self.origin = LocalFrame(lat, lon, height)

    def _integrity(self) -> Integrity | None:
        """Result of the integrity tests, where there are any."""
        return None

    def _level(self) -> Level:
        """Health, by the mode; a contradiction is a warning at least."""
        return max(level_of(self.mode), Level.WARN) if self.contradictions() else level_of(self.mode)


def _phrase(reason: str) -> str:
    """What of a reason is news at once; the numbers in it are not."""
    return Reason.phrase_of(reason).partition(" for ")[0]
