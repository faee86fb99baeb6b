"""Ground transmitters whose signals are measured to the centimetre, and beacons of two-way ranges: their rows in a station table.

Columns beside ``ident``, ``name``, ``lat_deg``, ``lon_deg`` and ``kind`` (PSEUDOLITE or BEACON): ``height_m`` of the antenna's phase centre
above the ellipsoid.  The weather there may be given as ``pressure_hpa``, ``temperature_c`` and ``humidity_pct``, all three or none, and the
ranges between which the station is received as ``nearest_m`` and ``farthest_m``.
"""

import math
from collections.abc import Sequence
from statistics import median
from typing import Protocol

from lowcostnav_ros.base.units import kelvin
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.radionav.station_cells import StationError, number
from lowcostnav_ros.radionav.weather import Weather

PSEUDOLITE, BEACON = KINDS = ("PSEUDOLITE", "BEACON")
COLUMNS = ("ident", "name", "lat_deg", "lon_deg", "height_m", "kind")
WEATHER = ("pressure_hpa", "temperature_c", "humidity_pct")
COINCIDENT_M = 1.0
LOWEST_M, HIGHEST_M = -450.0, 6000.0
ALONE_M, APART_M = 300_000.0, 2500.0
"""No network is so wide, and none of its stations so much higher or lower than the others."""


class Placed(Protocol):
    """What has an ident and stands somewhere."""

    @property
    def ident(self) -> str: ...
    @property
    def lat(self) -> float: ...
    @property
    def lon(self) -> float: ...
    @property
    def height(self) -> float: ...


def from_cells(cells: dict[str, str], where: str) -> tuple[float, Weather | None, tuple[float, float]]:
    """Return height (m), weather and reach (m) of the row of a transmitter.

    Raises
    ------
    StationError
        For a cell that cannot be right.
    """
    if "height_m" not in cells:
        raise StationError(f"{where}: a {cells['kind']} needs height_m, that of its antenna above the ellipsoid.")
    height = number(cells, "height_m", LOWEST_M, HIGHEST_M, where)
    nearest = number(cells, "nearest_m", 0.0, 1e5, where) if cells.get("nearest_m") else 0.0
    farthest = number(cells, "farthest_m", 1.0, 1e6, where) if cells.get("farthest_m") else math.inf
    if nearest >= farthest:
        raise StationError(f"{where}: nearest_m of {nearest:g} is not below farthest_m of {farthest:g}.")
    return height, _weather(cells, height, where), (nearest, farthest)


def _weather(cells: dict[str, str], height: float, where: str) -> Weather | None:
    given = [column for column in WEATHER if cells.get(column)]
    if not given:
        return None
    if len(given) < len(WEATHER):
        raise StationError(f"{where}: give {', '.join(WEATHER)} together, or none of them.")
    hpa, degc, percent = (number(cells, column, -1e6, 1e6, where) for column in WEATHER)
    weather = Weather(100.0 * hpa, kelvin(degc), 0.01 * percent)
    absurd = weather.absurdity(height)
    if absurd:
        raise StationError(f"{where}: {absurd}.")
    return weather


def refuse_outliers(stations: Sequence[Placed]) -> None:
    """Refuse a station that lies far from all the others, or far above or below them: a cell is wrong.

    Raises
    ------
    StationError
        Naming the station and, where latitude and longitude seem swapped, that.
    """
    for station in stations if len(stations) >= 3 else ():
        others = [s for s in stations if s is not station]
        if min(_apart_m(station.lat, station.lon, s) for s in others) > ALONE_M:
            swapped = abs(station.lon) <= math.pi / 2 and min(_apart_m(station.lon, station.lat, s) for s in others) < ALONE_M
            why = "latitude and longitude look swapped" if swapped else "check its coordinates"
            raise StationError(f"Station {station.ident} is more than {ALONE_M / 1000:.0f} km from all others: {why}.")
        higher = station.height - median(s.height for s in others)
        if abs(higher) > APART_M:
            side = "above" if higher > 0.0 else "below"
            raise StationError(f"Station {station.ident} is {abs(higher):.0f} m {side} the others; check its height, in metres.")


def _apart_m(lat: float, lon: float, other: Placed) -> float:
    return math.hypot(*difference_n(lat, lon, 0.0, other.lat, other.lon, 0.0).tolist())
