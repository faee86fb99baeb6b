"""The mission language: one manoeuvre per line, a verb and named values (``turn by_deg=90 bank_deg=20``).

The closed-form flight and the flight-dynamics aircraft fly the same lines.  A line may also be a mapping, ``{turn: {by_deg: 90}}``.
Each verb is a settings dataclass, so units, ranges and refusals come from its declaration.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

from lowcostnav_ros.base.settings import SettingsError, declared, from_mapping, nearest, setting


def _bank() -> float:
    return setting(20.0, "Bank angle in the turn", unit="deg", minimum=3.0, maximum=60.0)


def _lat() -> float:
    return setting(37.69, "Geodetic latitude of the point", unit="deg", minimum=-85.0, maximum=85.0)


def _lon() -> float:
    return setting(-121.82, "Longitude of the point, east positive", unit="deg", minimum=-180.0, maximum=180.0)


def _side() -> str:
    return setting("right", "Which way to turn", choices=("right", "left"))


@dataclass(frozen=True)
class Straight:
    """Hold heading, height and airspeed."""

    duration_s: float = setting(60.0, "How long", unit="s", minimum=0.1, maximum=36000.0)


@dataclass(frozen=True)
class Turn:
    """Coordinated turn through an angle, right positive."""

    by_deg: float = setting(90.0, "Angle to turn through, right positive", unit="deg", minimum=-36000.0, maximum=36000.0)
    bank_deg: float = _bank()
    climb_mps: float = setting(0.0, "Climb rate during the turn (segments only)", unit="m/s", minimum=-10.0, maximum=10.0)


@dataclass(frozen=True)
class Heading:
    """Coordinated turn to a true heading, the shorter way."""

    to_deg: float = setting(0.0, "True heading to turn to", unit="deg", minimum=-360.0, maximum=360.0)
    bank_deg: float = _bank()


@dataclass(frozen=True)
class Climb:
    """Climb or descend to a height."""

    to_height_m: float = setting(900.0, "Height above the ellipsoid to reach", unit="m", minimum=-400.0, maximum=15000.0)
    rate_mps: float = setting(2.5, "Climb or descent rate, always positive", unit="m/s", minimum=0.2, maximum=15.0)


@dataclass(frozen=True)
class Speed:
    """Change true airspeed in level flight."""

    to_mps: float = setting(50.0, "True airspeed to reach", unit="m/s", minimum=20.0, maximum=300.0)
    accel_mps2: float = setting(0.5, "Largest acceleration on the way (segments only)", unit="m/s^2", minimum=0.05, maximum=5.0)


@dataclass(frozen=True)
class STurns:
    """Alternate turns right and left about the present heading."""

    count: int = setting(4, "Number of turns", minimum=2, maximum=1000)
    by_deg: float = setting(60.0, "Angle of each turn; the first and last are half", unit="deg", minimum=5.0, maximum=180.0)
    bank_deg: float = _bank()


@dataclass(frozen=True)
class Hold:
    """Holding pattern: racetracks with legs of fixed time, joined on the inbound course."""

    inbound_deg: float = setting(250.0, "True heading of the inbound leg", unit="deg", minimum=-360.0, maximum=360.0)
    leg_s: float = setting(60.0, "Length of each straight leg", unit="s", minimum=1.0, maximum=600.0)
    laps: int = setting(1, "Number of racetracks", minimum=1, maximum=100)
    bank_deg: float = _bank()
    side: str = _side()


@dataclass(frozen=True)
class Goto:
    """Fly to a point, wind allowed for."""

    lat_deg: float = _lat()
    lon_deg: float = _lon()
    bank_deg: float = _bank()
    within_m: float = setting(300.0, "Distance at which the point counts as reached", unit="m", minimum=50.0, maximum=20000.0)


@dataclass(frozen=True)
class Orbit:
    """Circle a point (the closed-form flight circles in the air mass and drifts with the wind)."""

    lat_deg: float = _lat()
    lon_deg: float = _lon()
    radius_m: float = setting(800.0, "Radius", unit="m", minimum=200.0, maximum=20000.0)
    laps: float = setting(1.0, "Number of circles", minimum=0.25, maximum=1000.0)
    side: str = _side()


@dataclass(frozen=True)
class Approach:
    """Straight in to a threshold, down a glide path once it is met, ending at a height."""

    lat_deg: float = _lat()
    lon_deg: float = _lon()
    height_m: float = setting(90.0, "Height of the threshold above the ellipsoid", unit="m", minimum=-400.0, maximum=5000.0)
    glide_deg: float = setting(3.0, "Glide path angle", unit="deg", minimum=1.0, maximum=7.0)
    end_above_m: float = setting(60.0, "Height above the threshold where the mission ends", unit="m", minimum=5.0, maximum=2000.0)
    bank_deg: float = _bank()


Manoeuvre = Straight | Turn | Heading | Climb | Speed | STurns | Hold | Goto | Orbit | Approach

VERBS: dict[str, type] = {re.sub(r"(?!^)(?=[A-Z])", "_", kind.__name__).lower(): kind for kind in get_args(Manoeuvre)} | {"descend": Climb}
"""Manoeuvres by their verb: the name of the class in lower case, ``s_turns``."""


def parse_mission(lines: Iterable[str | Mapping[str, Any]], where: str = "mission") -> list[Manoeuvre]:
    """Read a mission, one manoeuvre per line.

    Parameters
    ----------
    lines : iterable of str or mapping
        ``'turn by_deg=90'`` or ``{'turn': {'by_deg': 90}}``.
    where : str
        What to call the source in a refusal.

    Raises
    ------
    SettingsError
        One sentence naming the line, for an unknown verb or name, a wrong type or a value out of range.
    """
    return [parse_manoeuvre(line, f"{where} line {number}") for number, line in enumerate(lines, 1)]


def parse_manoeuvre(line: str | Mapping[str, Any], where: str = "mission") -> Manoeuvre:
    """Read one manoeuvre; see :func:`parse_mission`."""
    verb, values = _words(line, where) if isinstance(line, str) else _pair(line, where)
    if verb not in VERBS:
        raise SettingsError(f"{where}: unknown manoeuvre '{verb}'{nearest(verb, VERBS)}.")
    return from_mapping(VERBS[verb], values, f"{where}: {verb}")


def _words(line: str, where: str) -> tuple[str, dict[str, Any]]:
    verb, *words = line.split() or [""]
    kinds = {entry.name: type(entry.default) for entry in declared(VERBS[verb])} if verb in VERBS else {}
    values: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals or not name or not text:
            raise SettingsError(f"{where}: '{word}' is not understood; write name=value, e.g. 'turn by_deg=90'.")
        if name in values:
            raise SettingsError(f"{where}: '{name}' is given twice; keep one.")
        values[name] = text if kinds.get(name) is str else _number(text, word, where)
    return verb, values


def _number(text: str, word: str, where: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise SettingsError(f"{where}: '{word}' needs a number after the equals sign.") from None


def _pair(line: Mapping[str, Any], where: str) -> tuple[str, Mapping[str, Any]]:
    if not isinstance(line, Mapping) or len(line) != 1:
        raise SettingsError(f"{where}: expected one manoeuvre such as 'turn by_deg=90', got {line!r}.")
    verb, values = next(iter(line.items()))
    return str(verb), values or {}
