"""The settings of a navigator: its own, and a group for every sensor of its list.

The list is itself a setting, ``aids``: a sensor that is named there has a group of settings of that name, a second one of its kind is
called ``gps2``, ``baro2`` and has a group of its own.  Groups of the navigator's usual sensors may stay in a file whose list omits them.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from typing import Any, ClassVar, Protocol

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.registry import RegistryError
from lowcostnav_ros.base.settings import SettingsError, setting, shown, to_mapping
from lowcostnav_ros.estimation.aiding import Sensor

RENAMED = {"airflow": "airdata"}
"""Sensors whose settings stand under an older name in recordings, and the name of today."""


class Listing(Protocol):
    """A navigator class, of which settings are derived."""

    __name__: ClassVar[str]
    __module__: str
    name: str
    OwnSettings: ClassVar[type]
    Settings: ClassVar[type]
    sensors: ClassVar[tuple[Sensor, ...]]


def kind_of(key: str) -> str:
    """Kind of sensor that an entry of the list is: its name without the number."""
    return key.rstrip("0123456789")


def sensor_of(key: str, own: Mapping[str, Sensor]) -> Sensor:
    """The sensor that an entry of the list names: as the navigator has it, else as it is defined; one that is added to the list is on.

    Raises
    ------
    SettingsError
        For a name that is no sensor's, with the nearest that is.
    """
    kind = kind_of(key)
    try:
        sensor = own[kind] if kind in own else AIDS[kind]
    except RegistryError as error:
        raise SettingsError(f"'aids': {error}") from error
    return sensor if key in own or not hasattr(sensor.settings, "enabled") else sensor.but(enabled=True)


@cache
def settings_class(navigator: type[Listing], keys: tuple[str, ...]) -> type:
    """Settings dataclass of a navigator with the sensors of a list.

    Parameters
    ----------
    navigator : type
        With ``OwnSettings``, the dataclass of what is no sensor's, and ``sensors``.
    keys : tuple of str
        Names of sensors, a second one of a kind with a number.
    """
    own = {sensor.name: sensor for sensor in navigator.sensors}
    if len(set(keys)) < len(keys):
        raise SettingsError(f"'aids' names a sensor twice; a second one of a kind is called by a number, such as {keys[0]}2.")
    aids = setting(list(keys), "Sensors it uses; a second one of a kind is called gps2, baro2 and has its own group of settings.")
    fields: list[tuple] = [("aids", list, aids)]
    for key in keys:
        sensor = sensor_of(key, own)
        fields.append((key, sensor.settings, dataclasses.field(default_factory=sensor.default)))
    groups = {field.name for field in dataclasses.fields(navigator.OwnSettings)}
    unused, upgrade = own.keys() - set(keys), getattr(navigator.OwnSettings, "upgraded", dict)
    return dataclasses.make_dataclass(
        f"{navigator.__name__}Settings",
        fields,
        bases=(navigator.OwnSettings,),
        frozen=True,
        namespace={
            "__doc__": f"All settings of {navigator.name}.",
            "__module__": navigator.__module__,
            "chosen_by": classmethod(lambda cls, values: settings_class(navigator, _names(values.get("aids", keys)))),
            "upgraded": staticmethod(
                lambda flat: {n: v for n, v in upgrade(_renamed(flat, groups)).items() if n.partition(".")[0] not in unused}
            ),
            "__reduce__": lambda self: (_restored, (navigator, to_mapping(self))),
        },
    )


def _names(aids: Any) -> tuple[str, ...]:
    if not isinstance(aids, list | tuple) or not all(isinstance(key, str) for key in aids):
        raise SettingsError(f"'aids' must list the names of sensors, got {shown(aids)}.")
    return tuple(RENAMED.get(str(key), str(key)) for key in aids)


def _renamed(flat: dict[str, Any], own: Collection[str]) -> dict[str, Any]:
    """Names and lists of recordings made when two sensors took air data; ``own`` groups of the navigator keep their names."""
    renamed = {old: new for old, new in RENAMED.items() if old not in own}
    new = {"".join((renamed.get(group, group), dot, rest)): v for n, v in flat.items() for group, dot, rest in [n.partition(".")]}
    if "airdata.sideslip_deg" in new:
        new["airdata.sideslip_sigma_deg"] = new.pop("airdata.sideslip_deg")
    return new | ({"aids": list(_names(new["aids"]))} if "aids" in new else {})


def _restored(navigator: type[Listing], values: dict[str, Any]) -> Any:
    from lowcostnav_ros.base.settings import from_mapping

    return from_mapping(navigator.Settings, values)


def listed(settings: Any) -> Sequence[tuple[str, Any]]:
    """Name and settings of every sensor of a settings object, in order."""
    return [(key, getattr(settings, key)) for key in settings.aids]
