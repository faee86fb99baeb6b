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

    INITIALISING = "initialising"
    ALIGNING = "aligning"
    NO_GO = "no_go"
    CALIBRATING = "calibrating"
    GPS = "gps"
    SPARSE = "sparse"
    SUSPECT = "suspect"
    COASTING = "coasting"
    DME_AIDED = "dme_aided"
    VOR_AIDED = "vor_aided"
    GYRO_ONLY = "gyro_only"
    RE_ACQUIRING = "re_acquiring"
    FAILED = "failed"
    SILENT = "no solution"
    """What a replay counts the time as in which a navigator publishes nothing; no navigator reports it."""

    @property
    def level(self) -> Level:
        """Health of the mode."""
        return _LEVELS[self]


_HEALTHY, _FAILED = (Mode.CALIBRATING, Mode.GPS), (Mode.NO_GO, Mode.FAILED, Mode.SILENT)
_LEVELS: dict[str, Level] = {m: Level.OK if m in _HEALTHY else Level.ERROR if m in _FAILED else Level.WARN for m in Mode}


def register_modes(modes: Mapping[str, Level]) -> None:
    """Enter further modes with their levels, as a navigator outside this package declares them.

    Raises
    ------
    RegistryError
        When a mode is known already with another level.
    """
    for name, level in modes.items():
        if _LEVELS.setdefault(name, level) != level:
            raise RegistryError(f"The mode '{name}' exists with the level {_LEVELS[name].name}; choose another name.")


def level_of(mode: str) -> Level:
    """Level of a mode by its name; WARN for one that is not registered."""
    return _LEVELS.get(mode, Level.WARN)
