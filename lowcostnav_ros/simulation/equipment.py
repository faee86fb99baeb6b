"""From settings to simulators, with the profile, station table or almanac that they name."""

from typing import Any

from lowcostnav_ros.catalogue.equipment import LOADERS
from lowcostnav_ros.sensors.registry import SIMULATORS


def build(sensor: str, settings: Any) -> Any:
    """Return the simulator of one sensor, with everything its settings name loaded.

    Parameters
    ----------
    sensor : str
        Name in :data:`~lowcostnav_ros.sensors.registry.SIMULATORS`.
    settings : settings dataclass
        The settings of that simulator.

    Returns
    -------
    object with ``simulate(truth: TruthBlock) -> list[Measurement]``

    Raises
    ------
    ValueError
        (SettingsError, StationError) when there is no such sensor, or no such file, or it cannot be used.
    """
    simulator, needs = SIMULATORS[sensor], SIMULATORS.label(sensor).needs
    return simulator(settings, LOADERS[needs](getattr(settings, needs))) if needs else simulator(settings)
