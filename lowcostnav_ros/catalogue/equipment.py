"""What settings name: IMU profiles, station tables and almanacs, by the name of a shipped file or by a path."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lowcostnav_ros.base.documents import foreign_text, read_text
from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.catalogue.config_files import config_dir, find_config
from lowcostnav_ros.radionav.stations import StationTable, stations_from_text
from lowcostnav_ros.sensors.imu_profile import ImuProfile, imu_profile_from_text

if TYPE_CHECKING:
    from lowcostnav_ros.gnss.almanac_constellation import Almanac


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
    return imu_profile_from_text(read_text(path), str(path))


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
    return stations_from_text(foreign_text(path.read_bytes()), path.name)


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


LOADERS: dict[str, Callable[[str], Any]] = {
    "profile": load_imu_profile,
    "stations_file": load_stations,
    "almanac_file": lambda name: load_almanac(name) if name else None,
}
"""How the file that a setting of a simulator names is loaded."""
