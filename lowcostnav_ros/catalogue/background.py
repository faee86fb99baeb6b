"""What maps draw under a flight without a network: coast (Natural Earth 1:10 million, public domain), airports (airportsdata, MIT).

The coast is good to about a kilometre, an airport to a hundred metres; neither is for navigation.  The licences are inside the file.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from lowcostnav_ros.catalogue.config_files import config_dir

MOST_AIRPORTS = 60


@dataclass(frozen=True, slots=True)
class Airport:
    """Its location indicator, name and place, degrees."""

    ident: str
    name: str
    lat_deg: float
    lon_deg: float


@cache
def _file() -> dict[str, np.ndarray]:
    with np.load(config_dir() / "background.npz") as file:
        return {name: file[name] for name in file.files}


@cache
def _lines() -> tuple[list[np.ndarray], np.ndarray]:
    """Lines of the coast, (n, 2) of latitude and longitude in degrees, and their bounds (lines, 4): south, west, north, east."""
    file = _file()
    steps = np.split(file["steps"].astype(np.int32), np.cumsum(file["counts"] - 1)[:-1])
    step_deg = float(file["step_deg"])
    lines = [step_deg * np.vstack([first, first + np.cumsum(part, axis=0)]) for first, part in zip(file["first"], steps, strict=True)]
    return lines, np.array([[*line.min(axis=0), *line.max(axis=0)] for line in lines])


def coast(south: float, west: float, north: float, east: float) -> list[np.ndarray]:
    """Stretches of coast in a rectangle, degrees, each (n, 2) of latitude and longitude with the points before and behind it."""
    lines, bounds = _lines()
    near = (bounds[:, 0] <= north) & (bounds[:, 2] >= south) & (bounds[:, 1] <= east) & (bounds[:, 3] >= west)
    found = []
    for k in np.flatnonzero(near):
        line = lines[k]
        inside = np.asarray(np.logical_and(line >= (south, west), line <= (north, east)).all(axis=1))
        inside[1:] |= inside[:-1].copy()
        inside[:-1] |= inside[1:].copy()
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.view(np.int8), [0]])))
        found += [line[a:b] for a, b in zip(edges[0::2], edges[1::2], strict=True) if b - a > 1]
    return found


def airports(south: float, west: float, north: float, east: float) -> list[Airport]:
    """Airports in a rectangle, degrees, those nearest to its middle where they are many."""
    file = _file()
    place = float(file["step_deg"]) * file["airports"]
    rows = np.flatnonzero(np.logical_and(place >= (south, west), place <= (north, east)).all(axis=1))
    off = (place[rows] - (0.5 * (south + north), 0.5 * (west + east))) * (1.0, math.cos(math.radians(0.5 * (south + north))))
    return _airports(rows[np.argsort(np.hypot(*off.T), kind="stable")][:MOST_AIRPORTS])


def airport_named(ident: str) -> Airport | None:
    """The airport of a location indicator, None where there is none."""
    found = _airports(np.flatnonzero(_file()["idents"] == ident.encode()))
    return found[0] if found else None


def _airports(rows: np.ndarray) -> list[Airport]:
    file = _file()
    place = float(file["step_deg"]) * file["airports"][rows]
    names = file["names"].tobytes().decode().split("\n") if len(rows) else []
    return [Airport(file["idents"][k].decode(), names[k], *(round(float(v), 4) for v in at)) for k, at in zip(rows, place, strict=True)]
