"""A whole simulated flight: truth and measurements, second by second, from the very sensor classes the live nodes run."""

from collections.abc import Iterator

from lowcostnav_ros import trajectory
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.simulation.equipment import build
from lowcostnav_ros.simulation.scenario import Scenario


class Simulation:
    """One simulated flight of a scenario.

    The flight is a function of the scenario alone; the length of the blocks only decides how it is handed over.  ``notes`` are sentences
    about the equipment, complete once the flight has begun.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.trajectory = trajectory.build(scenario.truth, scenario.seed)
        self.notes: list[str] = []

    def blocks(self, block_s: float = 1.0) -> Iterator[tuple[TruthBlock, list[Measurement]]]:
        """Fly from the start, yielding each block of truth with what the sensors delivered during it.

        Measurements are in order of stamp, then source; one delayed by latency comes with the block in which it is available.
        """
        sensors = [build(name, getattr(self.scenario, name)) for name in self.scenario.sensors]
        for truth in self.trajectory.blocks(block_s):
            measurements = [m for sensor in sensors for m in sensor.simulate(truth)]
            self.notes = [note for sensor in sensors for note in getattr(sensor, "notes", ())]
            yield truth, sorted(measurements, key=lambda m: (m.stamp_ns, m.source))

    def whole(self) -> tuple[TruthBlock, list[Measurement]]:
        """Fly to the end: all of the truth, and all measurements in order of availability."""
        seconds = list(self.blocks())
        return TruthBlock.joined(truth for truth, _ in seconds), [m for _, measured in seconds for m in measured]
