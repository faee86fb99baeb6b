"""Fields that a table may have in place of those of a topic: height above sea level, speed with track, indicated airspeed; usual sigmas."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.air import true_airspeed
from lowcostnav_ros.messages.kind import Kind, Quantity
from lowcostnav_ros.physics import atmosphere

Columns = dict[str, np.ndarray]
_SPEED, _ANGLE = Quantity(1, "speed"), Quantity(1, "angle")


@dataclass(frozen=True)
class Alternative:
    """What stands for the field ``target``: the fields ``needs``, perhaps ``may``, and how it is made of them, in SI and NED/FRD."""

    target: str
    needs: Mapping[str, Quantity]
    may: Mapping[str, Quantity]
    make: Callable[[Columns], np.ndarray]
    text: str


def _velocity(columns: Columns) -> np.ndarray:
    climb = columns.get("climb", np.zeros(len(columns["speed"])))
    return np.stack([columns["speed"] * np.cos(columns["track"]), columns["speed"] * np.sin(columns["track"]), -climb], axis=1)


def _true_airspeed(columns: Columns) -> np.ndarray:
    static = columns["pressure"] if "pressure" in columns else np.array(atmosphere.pressure(columns["altitude"]))
    return np.array(true_airspeed(np.maximum(columns["ias"], 0.0), static, columns.get("temperature")))


ALTERNATIVES: dict[str, tuple[Alternative, ...]] = {
    "gps/fix": (
        Alternative(
            "height",
            {"height_msl": Quantity(1, "length")},
            {},
            lambda columns: columns["height_msl"] + undulation(columns["lat"], columns["lon"]),
            "height above mean sea level, raised by the shipped geoid (0.5 m RMS)",
        ),
    ),
    "gps/vel": (
        Alternative("velocity", {"speed": _SPEED, "track": _ANGLE}, {"climb": _SPEED}, _velocity, "ground speed, true track, climb rate"),
    ),
    "air/velocity": (
        Alternative(
            "tas",
            {"ias": _SPEED, "pressure": Quantity(1, "pressure")},
            {"temperature": Quantity(1, "temperature")},
            _true_airspeed,
            "indicated airspeed, made true by static pressure and temperature (standard where there is none)",
        ),
        Alternative(
            "tas",
            {"ias": _SPEED, "altitude": Quantity(1, "length")},
            {"temperature": Quantity(1, "temperature")},
            _true_airspeed,
            "indicated airspeed, made true by the pressure altitude",
        ),
    ),
}


def possible(topic: str, kind: Kind) -> dict[str, Quantity]:
    """Fields that a table may give for a topic."""
    fields = dict(kind.fields)
    for one in ALTERNATIVES.get(topic, ()):
        fields |= {**one.needs, **one.may}
    return fields


def missing(topic: str, kind: Kind, given: set[str]) -> str:
    """Return the first field that is missing and that nothing given stands for; empty where there is none."""
    made = {one.target for one in ALTERNATIVES.get(topic, ()) if one.needs.keys() <= given}
    lacking = [name for name, quantity in kind.fields.items() if quantity.required and name not in given | made]
    return next((name for name in lacking if name != "sigma" or not kind.variances), "")


def complete(topic: str, kind: Kind, columns: Columns, rows: int) -> Columns:
    """Return the fields of the kind: those given, those made of others, and the usual sigmas where none are given."""
    done = dict(columns)
    for one in ALTERNATIVES.get(topic, ()):
        if one.target not in done and one.needs.keys() <= done.keys():
            done[one.target] = one.make(done)
    if "sigma" in kind.fields and "sigma" not in done:
        sigma = np.sqrt(kind.variances[: kind.fields["sigma"].size])
        if topic == "gps/vel" and "velocity" not in columns and "climb" not in columns:
            sigma = np.array([*sigma[:2], np.sqrt(UNKNOWN_VARIANCE)])
        done["sigma"] = np.tile(sigma, (rows, 1)) if len(sigma) > 1 else np.full(rows, sigma[0])
    return {name: values for name, values in done.items() if name in kind.fields}
