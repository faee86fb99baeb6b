"""Any navigator as a node: its inputs in, its solutions out, its status on /diagnostics."""

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.base.modes import Level, level_of
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.catalogue.building import complete_settings, make_navigator
from lowcostnav_ros.catalogue.navigator_topics import topics_of
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.registry import NAVIGATORS, label_of
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.ros.diagnostics import navigator_rows
from lowcostnav_ros.ros.input_monitor import InputMonitor, Status
from lowcostnav_ros.ros.node_base import NodeBase, ResetRefusedError
from lowcostnav_ros.ros.output_grid import OutputGrid
from lowcostnav_ros.ros.static_frames import StaticFrames
from lowcostnav_ros.ros.warm_up import warm_up

SILENT_S = 2.0  # without a solution, once there were some
RESET_PAUSE_S, CONFIRM_S = 10.0, 5.0  # between two resets; within which one that costs the solution must be asked for again
AIRBORNE_MPS = 15.0
NAV = "nav"
JOINED_NS = 1_000_000_000  # a map frame announced so long before this node heard anything is older than this process
SETTLING_NS = 10_000_000_000  # it may take so long until that is heard of
FARTHEST_M = 100_000.0  # from the origin of a map frame that is taken over


@dataclass(frozen=True)
class OutputSettings:
    """What is published, how often."""

    rate_hz: float = setting(
        20.0,
        "Rate of the low-latency outputs; the IMU's rate or more gives every sample.",
        unit="Hz",
        minimum=0.1,
        maximum=1000.0,
        live=True,
    )
    folder: str = setting(".", "Where files made in flight go (a magnetometer calibration).")


@dataclass(frozen=True)
class NavigatorNodeSettings:
    """Settings of a navigator that concern the node, not the estimator."""

    output: OutputSettings = group(OutputSettings)


class NavigatorNode(NodeBase):
    """Run one navigator live.

    Publishes ``<name>/odometry``, ``<name>/fix`` and ``<name>/wind`` at ``output.rate_hz`` of stamps with low latency,
    ``<name>/odometry_fused`` and ``<name>/wind_fused`` for every fused solution, ``<name>/health`` when that changes and each second, and
    ``<name>/origin`` once, latched.  The AHRS, which has no position, publishes ``imu/data`` and ``imu/data_fused``; the supervisor's
    topics are under ``nav/``.

    Parameters
    ----------
    name : str
        Name in the registry of navigators and default node name.
    settings : settings object
        Defaults of the estimator's parameters.
    make : callable
        Turns the final settings into the navigator.
    """

    build_settings = staticmethod(complete_settings)

    def __init__(self, name: str, settings: Any, make: Any, **kwargs: Any) -> None:
        super().__init__(name, [settings, NavigatorNodeSettings()], **kwargs)
        self._make, self._settings = make, self.parameters.settings[0]
        self.navigator = make(self._settings)
        self.decoder.rules.accept(self.navigator)
        self._frames = StaticFrames(self, self.navigator.inputs)
        # inertial samples need a quick answer; fused solutions are tenths of a second old anyway
        self.poll_period_s = 0.01 if self.navigator.inertial is None else 0.0025
        warm_up(make(self._settings), self.decoder.rules)
        self._grid = OutputGrid(round(1e9 / self.parameters.settings[1].output.rate_hz))
        self._topics, self._aiding = topics_of(name, self.get_name()), label_of(name).aiding
        self._is_attitude_only = topics.spec(self._topics[0]).msgtype == topics.IMU
        self._magnetometer = None
        if self._is_attitude_only:
            from lowcostnav_ros.ros.magnetometer_service import MagnetometerService

            self._magnetometer = MagnetometerService(self, self.navigator, Path(self.parameters.settings[1].output.folder))
        self._room = self._topics[0].rpartition("/")[0]
        self._published_at = 0.0
        self._origin = None
        self._first_ns: int | None = None
        self._is_map_settled = self._has_said = False
        self._reset_at, self._asked_at = -math.inf, -math.inf
        self.navigator.map_origins = self.decoder.rules.origins
        if self._room != NAV and not self._is_attitude_only:
            self.gate_of(NAV)
        for topic in self._topics:
            self.output(topic)
        self._frames.wait()
        for source, required in self.navigator.inputs.items():
            self.listen(source, self._feed, required=required)

    def listen_raw(self, source: str, handler: Callable[[InputMonitor, bytes], None], *, required: bool = False) -> InputMonitor:
        """Subscribe as any node; the frame of a first message may say how the sensor stands."""

        def take(monitor: InputMonitor, raw: bytes) -> None:
            self._stand_by(source, raw)
            handler(monitor, raw)

        return super().listen_raw(source, take, required=required)

    def _stand_by(self, source: str, raw: bytes) -> None:
        """Fly on settings that know how a sensor stands, from the first measurement on."""
        settings = self._frames.settings_by(source, raw, self._settings)
        if settings is self._settings:
            return
        self._settings, self.navigator = settings, self._make(settings)
        self.navigator.map_origins = self.decoder.rules.origins
        if self._magnetometer is not None:
            self._magnetometer.navigator = self.navigator
        for measurement in self._frames.early or ():
            self.navigator.feed(measurement)

    def rows(self) -> Iterable[Status]:
        """Add mode, sigmas and aids to the rows of every node."""
        status = self.navigator.status() if hasattr(self, "navigator") else None
        if hasattr(self, "_frames"):
            self._frames.look()
        for record in status.inputs if status is not None else ():
            if record.source in self.inputs:
                self.inputs[record.source].refused(record.received, sum(record.rejected.values()), record.reason)
        yield from super().rows()
        if status is not None:
            first, *others = navigator_rows(self.get_name(), status)
            yield self._unless_silent(first)
            yield from others
        magnetometer = getattr(self, "_magnetometer", None)
        if magnetometer is not None:
            yield from magnetometer.rows()

    def _unless_silent(self, row: Status) -> Status:
        """The navigator's row; a navigator that has published and now puts out nothing is not well, whatever its mode."""
        silent_s = time.monotonic() - self._published_at
        if not self._published_at or silent_s < max(SILENT_S, 3e-9 * self._grid.period_ns):
            return row
        words = f"no solution for {silent_s:.1f} s"
        return row._replace(level=Level.ERROR, message=f"{words}; {row.message}", values=row.values | {"silent_s": f"{silent_s:.1f}"})

    def reset(self, reason: str) -> str:
        """Reset the estimator, not too often; one that coasts in flight only when asked twice: nothing but GPS may bring it back."""
        now, navigator = time.monotonic(), self.navigator
        if now - self._reset_at < RESET_PAUSE_S:
            raise ResetRefusedError(f"{self.get_name()} was reset {now - self._reset_at:.1f} s ago; wait {RESET_PAUSE_S:.0f} s.")
        if self._would_be_lost() and now - self._asked_at > CONFIRM_S:
            self._asked_at = now
            words = f"{self.get_name()} flies without GPS ({navigator.mode}: {navigator.reason}) and a reset would lose its solution"
            raise ResetRefusedError(f"{words}; ask again within {CONFIRM_S:.0f} s to do it all the same.")
        self._reset_at, self._asked_at = now, -math.inf
        self.navigator.reset(reason)
        self._grid.clear()
        return f"{self.get_name()} was reset: {self.navigator.mode}, {self.navigator.reason}."

    def _would_be_lost(self) -> bool:
        """Whether there is a solution in flight that GPS does not hold."""
        solution = self.navigator.output()
        if solution is None or level_of(self.navigator.mode) == Level.OK:
            return False
        return solution.vel_n is None or math.hypot(*solution.vel_n) > AIRBORNE_MPS

    def on_settings(self, settings: list) -> None:
        """Take over a new output rate."""
        self._grid.period_ns = round(1e9 / settings[1].output.rate_hz)

    def _feed(self, measurement: Measurement) -> None:
        if self._magnetometer is not None:
            self._magnetometer.take(measurement)
        if self._first_ns is None:
            self._first_ns = measurement.stamp_ns
        elif measurement.stamp_ns - self._first_ns > SETTLING_NS:
            self._is_map_settled = True
            self._say_what_is_missing()
        self._frames.fed(measurement)
        fused = self.navigator.feed(measurement)
        self._keep_the_map()
        self._publish_origin(measurement.stamp_ns)
        for solution in fused:
            self._publish(solution, "_fused")
        self._publish_output(measurement)

    def _say_what_is_missing(self) -> None:
        """Name, once, the aids that have got nothing since the start."""
        if not self._has_said:
            self._has_said, deprived = True, ", ".join(self.navigator.deprived())
            if deprived:
                self.get_logger().warning(f"flying without {deprived}")

    def _publish_output(self, measurement: Measurement) -> None:
        """Publish the low-latency solution when it is time: by the inertial stamps, or by its own where nothing inertial drives it."""
        inertial, base_ns = self.navigator.inertial, self.navigator.newest_ns
        if base_ns is None or inertial not in (None, measurement.source):
            return
        if not self._grid.is_due(base_ns if inertial is None else measurement.stamp_ns, base_ns):
            return
        solution = self.navigator.output()
        if solution is not None:
            self._publish(solution, "")

    def _keep_the_map(self) -> None:
        """Take over the map frame of the solution that is flown where that is older than this process: it has been started again."""
        announced, origin = self.decoder.rules.map_frames.get(NAV), self.navigator.origin
        if self._room == NAV or announced is None or origin is None or self._is_map_settled:
            return
        self._is_map_settled, shared = True, announced.origin
        apart = difference_n(origin.lat, origin.lon, origin.height, shared.lat, shared.lon, shared.height)
        if float(apart @ apart) < FARTHEST_M**2 and (self._first_ns or 0) - announced.stamp_ns > JOINED_NS:
            self.navigator.origin = shared

    def _publish_origin(self, stamp_ns: int) -> None:
        origin = self.navigator.origin
        if origin is not None and origin is not self._origin and not self._is_attitude_only:
            self._origin = origin
            self.output(f"{self._room}/origin").send(to_cdr(encode.origin_fix(stamp_ns, origin)))

    def _publish(self, solution: NavSolution, suffix: str) -> None:
        self._published_at = time.monotonic()
        if suffix and solution.health is not None:
            self.output(self._topics[-1]).send(to_cdr(encode.health_from(solution.health)))
        if self._is_attitude_only:
            if solution.q_nb is not None:
                self.output(f"imu/data{suffix}").send(to_cdr(encode.imu_from_solution(solution)))
            return
        if self._origin is None:
            return
        self.output(f"{self._room}/odometry{suffix}").send(to_cdr(encode.odometry_from_solution(solution, self._origin)))
        wind = encode.wind_from_solution(solution)
        if wind is not None:
            self.output(f"{self._room}/wind{suffix}").send(to_cdr(wind))
        if not suffix and self._aiding and solution.vel_n is not None:
            self.output(self._aiding).send(to_cdr(encode.encode(replace(solution, source=self._aiding))))
        if not suffix:
            self.output(f"{self._room}/fix").send(to_cdr(encode.fix_from_solution(solution)))


def navigator_node(name: str, **kwargs: Any) -> NavigatorNode:
    """Make the node of a registered navigator, which is made as a replay makes it, with the station table its settings name."""
    kind = NAVIGATORS[name]
    return NavigatorNode(name, kind.Settings(), partial(make_navigator, navigator_class=kind), **kwargs)
