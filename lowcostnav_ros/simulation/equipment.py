"""From settings to simulators: finds the profile and the station table a sensor's settings name."""

from typing import TYPE_CHECKING, Any

from lowcostnav_ros.config_files import config_dir, find_config
from lowcostnav_ros.radionav.stations import StationTable, stations_from_text
from lowcostnav_ros.sensors.imu_profile import ImuProfile, imu_profile_from_text
from lowcostnav_ros.settings import SettingsError, nearest

if TYPE_CHECKING:
    from lowcostnav_ros.gnss.almanac_constellation import Almanac

SENSORS = ("imu", "magnetometer", "air_data", "gps", "dme", "gps_attitude", "gnss", "vor")
USUAL = SENSORS[:5]
"""Aboard unless a scenario says otherwise."""


def load_imu_profile(name: str) -> ImuProfile:
    """Return an IMU profile by name (``config/profiles/<name>.yaml``) or by the path of a YAML file.

    Raises
    ------
    SettingsError
        When there is no such profile or it is not usable.
    """
    path = find_config(name) if name.endswith((".yaml", ".yml")) else config_dir() / "profiles" / f"{name}.yaml"
    if not path.is_file():
        raise SettingsError(f"There is no IMU profile '{name}'{nearest(name, imu_profile_names())}; or give the path of a YAML file.")
    return imu_profile_from_text(path.read_text(encoding="utf-8"), str(path))


def imu_profile_names() -> list[str]:
    """Names of the shipped IMU profiles."""
    return sorted(path.stem for path in (config_dir() / "profiles").glob("*.yaml"))


def load_stations(name: str) -> StationTable:
    """Return a station table by its file name in the config directory or by its path.

    Raises
    ------
    SettingsError
        When there is no such file.
    StationError
        When it is not usable.
    """
    path = find_config(name)
    return stations_from_text(path.read_text(encoding="utf-8"), path.name)


def load_almanac(name: str) -> "Almanac":
    """Return a YUMA almanac by its file name in the config directory or by its path.

    Raises
    ------
    SettingsError
        When there is no such file, or it has no usable satellite.
    """
    from lowcostnav_ros.gnss import GnssError
    from lowcostnav_ros.gnss.almanac_constellation import almanac_from_yuma

    path = find_config(name)
    try:
        return almanac_from_yuma(path.read_text(encoding="ascii", errors="replace"), path.name)
    except GnssError as error:
        raise SettingsError(str(error)) from error


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
