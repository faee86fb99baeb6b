"""Modes of navigators, each with its health; the levels are those of diagnostic_msgs."""

from collections.abc import Mapping
from enum import IntEnum, StrEnum

from lowcostnav_ros.base.registry import RegistryError


class Level(IntEnum):
    """Health: OK (healthy), WARN (degraded), ERROR (failed), numbered as diagnostic_msgs does."""

    OK = 0
    WARN = 1
    ERROR = 2


class Mode(StrEnum):
    """Modes of the navigators of this package; a mode equals its name as text (``Mode.GPS == "gps"``)."""

    INITIALISING = "initialising", Level.WARN
    ALIGNING = "aligning", Level.WARN
    NO_GO = "no_go", Level.ERROR
    CALIBRATING = "calibrating", Level.OK
    GPS = "gps", Level.OK
    SPARSE = "sparse", Level.WARN
    SUSPECT = "suspect", Level.WARN
    COASTING = "coasting", Level.WARN
    DME_AIDED = "dme_aided", Level.WARN
    VOR_AIDED = "vor_aided", Level.WARN
    RE_ACQUIRING = "re_acquiring", Level.WARN
    FAILED = "failed", Level.ERROR
    SILENT = "no solution", Level.ERROR
    """What a replay counts the time as in which a navigator publishes nothing; no navigator reports it."""

    level: Level

    def __new__(cls, name: str, level: Level) -> "Mode":
        """Make a mode of its name and level."""
        mode = str.__new__(cls, name)
        mode._value_, mode.level = name, level
        return mode


_FURTHER: dict[str, Level] = {}


def register_modes(modes: Mapping[str, Level]) -> None:
    """Enter further modes with their levels, as a navigator outside this package declares them.

    Raises
    ------
    RegistryError
        When a mode is known already with another level.
    """
    for name, level in modes.items():
        known = level_of(name, level)
        if known != level:
            raise RegistryError(f"The mode '{name}' exists with the level {known.name}; choose another name.")
        _FURTHER[name] = level


def level_of(mode: str, unknown: Level = Level.WARN) -> Level:
    """Level of a mode by its name; ``unknown`` for one that nobody registered."""
    try:
        return Mode(mode).level
    except ValueError:
        return _FURTHER.get(mode, unknown)
