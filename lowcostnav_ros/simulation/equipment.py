"""From settings to simulators: finds the profile and the station table a sensor's settings name."""

from typing import Any

from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.catalogue.equipment import load_almanac, load_imu_profile, load_stations

SENSORS = ("imu", "magnetometer", "air_data", "gps", "dme", "gps_attitude", "gnss", "vor")
USUAL = SENSORS[:5]
"""Aboard unless a scenario says otherwise."""


def build(sensor: str, settings: Any) -> Any:
    """Return the simulator of one sensor, with everything its settings name loaded.

    Parameters
    ----------
    sensor : str
        One of :data:`SENSORS`.
    settings : settings dataclass
        The settings of that simulator.

    Returns
    -------
    object with ``simulate(truth: TruthBlock) -> list[Measurement]``
    """
    if sensor == "imu":  # imports stay inside: a node loads only its own sensor
        from lowcostnav_ros.sensors.imu import ImuSimulator

        return ImuSimulator(settings, load_imu_profile(settings.profile))
    if sensor == "dme":
        from lowcostnav_ros.sensors.dme import DmeSimulator

        return DmeSimulator(settings, load_stations(settings.stations_file))
    if sensor == "vor":
        from lowcostnav_ros.sensors.vor import VorSimulator

        return VorSimulator(settings, load_stations(settings.stations_file))
    if sensor == "gps":
        from lowcostnav_ros.sensors.gps import GpsSimulator

        return GpsSimulator(settings)
    if sensor == "gnss":
        from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator

        return GnssRawSimulator(settings, almanac=load_almanac(settings.almanac_file) if settings.almanac_file else None)
    if sensor == "gps_attitude":
        from lowcostnav_ros.sensors.gps_attitude import GpsAttitudeSimulator

        return GpsAttitudeSimulator(settings)
    if sensor == "magnetometer":
        from lowcostnav_ros.sensors.magnetometer import MagnetometerSimulator

        return MagnetometerSimulator(settings)
    if sensor == "air_data":
        from lowcostnav_ros.sensors.airdata import AirDataSimulator

        return AirDataSimulator(settings)
    raise SettingsError(f"There is no sensor '{sensor}'{nearest(sensor, SENSORS)}.")
