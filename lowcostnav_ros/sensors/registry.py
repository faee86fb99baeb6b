"""The sensor simulators by name; each describes itself in the decorator of its class, and its module is imported when it is asked for."""

from collections.abc import Callable
from dataclasses import dataclass

from lowcostnav_ros.base.registry import ClassRegistry


@dataclass(frozen=True)
class SimulatorLabel:
    """What a simulator says of itself: see :func:`simulator`."""

    name: str
    truth: tuple[str, ...]
    topics: tuple[str, ...]
    needs: str = ""
    usual: int = 0


SIMULATORS = ClassRegistry("sensor", "lowcostnav_ros.sensors", "simulator", SimulatorLabel)


def simulator(
    name: str, *, settings: type, truth: tuple[str, ...], topics: tuple[str, ...], needs: str = "", usual: int = 0
) -> Callable[[type], type]:
    """Enter a class with ``simulate(truth: TruthBlock) -> list[Measurement]`` as a sensor simulator.

    It gets a section of this name in every scenario, a node ``<name>_simulator`` and its parameter file.

    Parameters
    ----------
    name : str
        Name in a scenario.
    settings : type
        Settings dataclass; its defaults must make a simulator.
    truth : tuple of str
        Topics of the truth that its node subscribes to: ``("truth/imu",)``, ``("truth/odometry",)`` or that and ``truth/wind``.
    topics : tuple of str
        Topics of its measurements.
    needs : str
        The setting that names a file to be loaded and handed over after the settings: ``profile``, ``stations_file``, ``almanac_file``.
    usual : int
        Place in the list of those that are aboard unless a scenario says otherwise; 0: not in it.
    """
    described = {"name": name, "truth": truth, "topics": topics, "needs": needs, "usual": usual}
    return lambda cls: SIMULATORS.enter(cls, Settings=settings, **described)
