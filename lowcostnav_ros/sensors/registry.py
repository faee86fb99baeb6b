"""The sensor simulators by name; each describes itself in the decorator of its class, and its module is imported when it is asked for."""

from dataclasses import dataclass

from lowcostnav_ros.base.registry import ClassRegistry
from lowcostnav_ros.base.settings import setting


@dataclass(frozen=True)
class SimulatorLabel:
    """What a simulator declares in ``@simulator("vor", Settings=VorSimulatorSettings, truth=("truth/odometry",), ...)``.

    The class has the verb ``simulate(truth: TruthBlock) -> list[Measurement]``; its ``Settings`` have defaults that make a simulator.  From
    this follow a section in every scenario, a node ``<name>_simulator`` and its parameter file.

    ``truth`` names the topics of the truth that the node subscribes to: ``truth/imu``, ``truth/odometry``, or that and ``truth/wind``;
    ``topics`` those of its measurements; ``needs`` the setting that names a file to be loaded and handed over after the settings
    (``profile``, ``stations_file`` or ``almanac_file``); ``usual`` its place among those aboard unless a scenario lists others, 0: not
    aboard.
    """

    name: str
    truth: tuple[str, ...]
    topics: tuple[str, ...]
    needs: str = ""
    usual: int = 0


SIMULATORS = ClassRegistry("sensor", "lowcostnav_ros.sensors", "simulator", SimulatorLabel)
simulator = SIMULATORS.entry


@dataclass(frozen=True)
class SimulatorSettings:
    """What the settings of every simulator begin with."""

    seed: int = setting(1, "Seed of all random numbers of this sensor.", minimum=0)
