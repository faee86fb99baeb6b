"""A sensor simulator as a node: receives its part of the truth, publishes what the sensor would measure."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.messages.encode import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.ros.node_base import NodeBase
from lowcostnav_ros.ros.scenario import sensor_bases
from lowcostnav_ros.sensors.registry import SIMULATORS
from lowcostnav_ros.simulation.equipment import build

NOWHERE, NO_WIND = (0.0, 0.0, 0.0), np.zeros(2)


class SimulatorNode(NodeBase):
    """Run one sensor simulator on live truth.

    Parameters
    ----------
    sensor : str
        Name in :data:`SIMULATORS`; the default name of the node is ``<sensor>_simulator``.
    """

    def __init__(self, sensor: str, **kwargs: Any) -> None:
        super().__init__(f"{sensor}_simulator", partial(sensor_bases, sensor), **kwargs)
        self._make = partial(build, sensor)
        self._simulator = self._make(self.parameters.settings[0])
        for note in getattr(self._simulator, "notes", ()):
            self.get_logger().info(note)
        label = SIMULATORS.label(sensor)
        for topic in label.topics:  # at once, so that listeners find them before the first sample
            self.output(topic)
        self._wind: dict[int, np.ndarray] = {}
        self._waiting: dict[int, NavSolution] = {}
        handlers: dict[str, Callable[[Any], None]] = {"truth/imu": self._on_imu, "truth/odometry": self._on_odometry}
        handlers["truth/wind"] = self._on_wind
        self.poll_period_s = 0.005 if "truth/imu" in label.truth else 0.01  # the state comes at 20 Hz only
        self._needs_wind = "truth/wind" in label.truth
        for topic in label.truth:
            self.listen(topic, handlers[topic], required=True)

    def reset(self, reason: str) -> str:
        """Power the sensor off and on: the same errors from the beginning."""
        self._simulator = self._make(self.parameters.settings[0])
        self._wind.clear()
        self._waiting.clear()
        return f"{self.get_name()} was reset to the first errors of its seed ({reason})."

    def _on_imu(self, sample: Attitude) -> None:
        self._simulate(_row(sample.stamp_ns, NOWHERE, None, sample.q_nb, sample.specific_force_b, sample.angular_rate_b, None))

    def _on_odometry(self, state: NavSolution) -> None:
        if not self._needs_wind:
            self._simulate(_row_of_state(state, None))
            return
        self._waiting[state.stamp_ns] = state
        self._pair()

    def _on_wind(self, state: NavSolution) -> None:
        down = state.states["wind_down_mps"][0] if state.states else 0.0
        self._wind[state.stamp_ns] = np.append(NO_WIND if state.wind_n is None else state.wind_n, down)
        self._pair()

    def _pair(self) -> None:
        """Simulate the states whose wind is there, in order; drop those whose partner was lost."""
        for stamp in sorted(self._waiting.keys() & self._wind.keys()):
            self._simulate(_row_of_state(self._waiting.pop(stamp), self._wind.pop(stamp)))
            for table in (self._waiting, self._wind):
                for older in [s for s in table if s < stamp]:
                    del table[older]

    def _simulate(self, truth: TruthBlock) -> None:
        for measurement in self._simulator.simulate(truth):
            self.output(measurement.source).send(to_cdr(encode(measurement)))  # one row of truth, so at most one sample


def _row(stamp_ns: int, place: tuple, *vectors: Any) -> TruthBlock:
    """One row of truth: place, then velocity, attitude, specific force, rate and wind, none of them where it is None."""
    lat, lon, height = (np.array([value]) for value in place)
    columns = (np.zeros((1, 3)) if value is None else np.ascontiguousarray(np.atleast_2d(value), dtype=float) for value in vectors)
    return TruthBlock(np.array([stamp_ns]), lat, lon, height, *columns)


def _row_of_state(state: NavSolution, wind_n: np.ndarray | None) -> TruthBlock:
    place = state.lat, state.lon, state.height
    return _row(state.stamp_ns, place, state.vel_n, state.q_nb, None, state.angular_rate_b, wind_n)
