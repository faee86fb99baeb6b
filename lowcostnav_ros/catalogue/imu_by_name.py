"""The filter's IMU numbers by the name of a data sheet: ``imu.profile`` of a navigator's settings, looked up and filled in.

Estimators read no file, so this happens where settings become a navigator, live and in replay alike.
"""

import dataclasses
from typing import Any

from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping


def with_imu_profile(settings: Any) -> Any:
    """Return navigator settings with the numbers of the IMU profile they name in place; unchanged where they name none.

    A number beside the name that is not the default stays.  (A settings file of the package lists every default, so a
    default beside a name cannot be distinguished from a value that was not chosen.)  Doing it twice changes nothing.

    Parameters
    ----------
    settings : settings dataclass
        With or without a group ``imu``.

    Raises
    ------
    SettingsError
        When there is no such profile, or a filter cannot fly on its numbers.
    """
    name = getattr(getattr(settings, "imu", None), "profile", "")
    if name in ("", "auto"):  # what a unit shows is seen in flight
        return settings
    from lowcostnav_ros.cores.imu_errors import ImuSettings  # the compiler behind it is heavy; few nodes come here

    if not isinstance(settings.imu, ImuSettings):
        return settings
    usual, given = to_mapping(ImuSettings()), to_mapping(settings.imu)
    own = {key: value for key, value in given.items() if value != usual[key]}
    return dataclasses.replace(settings, imu=dataclasses.replace(profile_settings(name), **own))


def profile_settings(name: str, turn_on_bias: bool = True) -> Any:
    """Return the filter settings (``ImuSettings``) of an IMU profile.

    Parameters
    ----------
    name : str
        Name of a shipped profile or path of a profile file, e.g. one that ``lowcostnav allan`` wrote.
    turn_on_bias : bool
        False for a unit whose turn-on biases were calibrated away before the flight.

    Raises
    ------
    SettingsError
        When there is no such profile, or a filter cannot fly on its numbers.
    """
    from lowcostnav_ros.catalogue.equipment import load_imu_profile
    from lowcostnav_ros.cores.imu_errors import ImuSettings, imu_settings

    profile = load_imu_profile(name)
    if not profile.has_noise:
        raise SettingsError(f"IMU profile '{name}' states no white noise for some sensor, and a filter needs it; fill it in.")
    noise = profile.filter_noise()
    if not turn_on_bias:
        none = noise.gyro_turn_on_sigma * 0.0
        noise = dataclasses.replace(noise, gyro_turn_on_sigma=none, accel_turn_on_sigma=none)
    return from_mapping(ImuSettings, to_mapping(imu_settings(noise)), f"IMU profile '{name}'")
