"""The form all navigators share: measurements in by one verb, fused solutions out, status for people."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from lowcostnav_ros.base.measurements import ImuBlock, Integrity, MagneticField, Measurement, NavSolution
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.estimation.aiding import Aid, AidStatus
from lowcostnav_ros.estimation.horizon import TIME_JUMPED, FusionHorizon
from lowcostnav_ros.physics.earth import LocalFrame

OK, WARN, ERROR = 0, 1, 2
"""Levels of a status, as diagnostic_msgs numbers them."""


@dataclass(frozen=True)
class HorizonSettings:
    """The fusion horizon and the outputs."""

    lag_s: float = setting(0.05, "Fusion stays this far behind the newest stamp to outlast transport.", unit="s", minimum=0.0, maximum=10.0)
    output_period_s: float = setting(0.1, "Spacing of the fused solutions.", unit="s", minimum=0.005, maximum=10.0)
    jump_s: float = setting(
        10.0, "Stamps this far from the newest are suspect; must exceed a sole source's interval.", unit="s", minimum=1.0, maximum=3600.0
    )


@dataclass(slots=True)
class InputStatus:
    """What became of one input: counts, last stamp, rejections by reason."""

    source: str
    required: bool
    received: int = 0
    stamp_ns: int | None = None
    reason: str = ""
    rejected: Counter = field(default_factory=Counter)

    def reject(self, reason: str) -> None:
        """Count one rejection under its reason."""
        self.rejected[reason] += 1
        self.reason = reason


@dataclass(slots=True)
class NavigatorStatus:
    """How a navigator is: mode, why, how bad, and one record per input and per aid."""

    name: str
    mode: str
    reason: str
    level: int
    stamp_ns: int | None
    sigmas: dict[str, float]
    inputs: list[InputStatus]
    aids: list[AidStatus]
    integrity: Integrity | None = None


class Navigator:
    """Base of all navigators.

    A subclass declares ``name``, ``inputs`` (source to required?) and ``inertial`` (the IMU source that carries its state, or None), keeps
    ``mode`` and ``reason``, and gives ``_fuse(measurement)``, ``_predict()``, ``_restart()``, ``_sigmas()`` and ``_level()``.

    Parameters
    ----------
    settings : settings dataclass
        Must hold ``horizon`` (:class:`HorizonSettings`); a ``magnetometer`` calibration in it is applied to every field that comes in.
    """

    name: ClassVar[str] = ""
    inputs: dict[str, bool] = {}
    inertial: str | None = None

    def __init__(self, settings: Any, latency_s: float = 0.0) -> None:
        self.settings = settings
        lag_ns, jump_ns = round(1e9 * (settings.horizon.lag_s + latency_s)), round(1e9 * settings.horizon.jump_s)
        self.horizon = FusionHorizon(lag_ns, self.inertial, jump_ns)
        self.output_period_ns = round(1e9 * settings.horizon.output_period_s)
        self.origin: LocalFrame | None = None
        self.input_status = {source: InputStatus(source, required) for source, required in self.inputs.items()}
        self.aids: list[Aid] = []
        self.mode = "initialising"
        self.reason = "waiting for measurements"
        self.restarts = Counter()
        self.on_aid: Callable[[AidStatus], None] | None = None
        self._out: list[NavSolution] = []
        calibration = getattr(settings, "magnetometer", None)
        self._magnetometer = None if calibration is None or calibration == type(calibration)() else calibration

    def feed(self, measurement: Measurement) -> list[NavSolution]:
        """Take one measurement (or block of inertial samples) in; return the fused solutions that became final, oldest first."""
        record = self.input_status.get(measurement.source)
        if record is None:
            return []
        record.received += len(measurement) if isinstance(measurement, ImuBlock) else 1
        if self._magnetometer is not None and isinstance(measurement, MagneticField):
            measurement = replace(measurement, field_b=self._magnetometer.apply(measurement.field_b))
        refusal = self.horizon.push(measurement)
        if refusal == TIME_JUMPED:
            self.reset("time base jumped")
            refusal = self.horizon.push(measurement)
        if refusal:
            record.reject(refusal)
            return []
        record.stamp_ns = measurement.stamp_ns if record.stamp_ns is None else max(record.stamp_ns, measurement.stamp_ns)
        for item in self.horizon.take():
            self._fuse(item)
        out, self._out = self._out, []
        return out

    def feed_all(self, measurements: Iterable[Measurement]) -> list[NavSolution]:
        """Feed many; return all fused solutions."""
        return [solution for m in measurements for solution in self.feed(m)]

    def output(self) -> NavSolution | None:
        """The solution carried to the newest stamp by mean propagation alone (low latency), None before alignment."""
        return self._predict()

    def status(self) -> NavigatorStatus:
        """Mode, reason, level and all records, for diagnostics and reports."""
        aids = [aid.status for aid in self.aids]
        inputs = list(self.input_status.values())
        now_ns, integrity = self.horizon.passed_ns, self._integrity()
        return NavigatorStatus(self.name, self.mode, self.reason, self._level(), now_ns, self._sigmas(), inputs, aids, integrity)

    def reset(self, reason: str) -> None:
        """Start over: forget the state and what is held, keep the settings, the origin and the counters."""
        self.horizon.clear()
        self.realign(reason)

    def realign(self, reason: str) -> None:
        """Forget the state alone; what the horizon holds is used to align anew (so that this, too, repeats to the bit)."""
        self.restarts[reason] += 1
        self.mode, self.reason = "initialising", reason
        self._restart()

    def use_aid(self, aid: Aid, measurement: Measurement) -> bool:
        """Run one aid on one measurement and tell the observer, if there is one."""
        used = aid.process(measurement, self)
        if self.on_aid is not None:
            self.on_aid(aid.status)
        return used

    def set_origin(self, lat: float, lon: float, height: float) -> None:
        """Fix the geodetic origin (rad, rad, m) of the local map frame, once."""
        if self.origin is None:
            self.origin = LocalFrame(lat, lon, height)

    def _integrity(self) -> Integrity | None:
        """What the integrity tests say, where there are any."""
        return None

    def _level(self) -> int:
        if self.mode == "failed":
            return ERROR
        return OK if self.mode in ("gps", "calibrating") else WARN
