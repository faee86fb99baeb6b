"""Ground stations: one value per station, a table that refuses doubtful entries, and the text format it is read from.

The format is CSV with a header; ``#`` starts a comment line.  Columns: ``ident``, ``name``, ``lat_deg`` (north +), ``lon_deg``
(east +), ``elevation_ft`` (above mean sea level, as published), ``undulation_m`` (height of mean sea level above the ellipsoid),
``channel`` (such as 86X; a VOR alone has the one its frequency is paired with) and ``service_volume`` (T terminal, L low, H high).

Two more columns may be there.  ``kind`` is DME (taken where the column or the cell is empty), VOR, VOR-DME, VORTAC or TACAN (whose bearings
only military receivers read: here a DME).  ``declination_deg`` (east +) is the station's own, set when its radials were last aligned, not
that of the magnetic field today; a VOR cannot do without.

A kind of :mod:`~lowcostnav_ros.radionav.transmitters` (PSEUDOLITE, BEACON) has columns of its own; a table may hold all of them.
"""

import csv
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from lowcostnav_ros.base.units import FOOT, NAUTICAL_MILE
from lowcostnav_ros.physics.earth import geodetic_to_ecef
from lowcostnav_ros.radionav import transmitters
from lowcostnav_ros.radionav.station_cells import StationError as StationError
from lowcostnav_ros.radionav.station_cells import number as number_of
from lowcostnav_ros.radionav.weather import Weather

COLUMNS = ("ident", "name", "lat_deg", "lon_deg", "elevation_ft", "undulation_m", "channel", "service_volume")
OPTIONAL_COLUMNS = ("kind", "declination_deg")
RANGING = ("DME", "VOR-DME", "VORTAC", "TACAN")
"""Kinds of station that answer a DME."""
BEARING = ("VOR", "VOR-DME", "VORTAC")
"""Kinds of station whose radials a VOR receiver reads."""
KINDS = ("DME", "VOR", *RANGING[1:], *transmitters.KINDS)
COINCIDENT_M = 100.0
LOWEST_FT, HIGHEST_FT = -1500.0, 15_000.0
SERVICE_VOLUMES = ("T", "L", "H")


@dataclass(frozen=True, slots=True)
class Station:
    """One station.

    ``lat``, ``lon`` rad, ``height`` m above the ellipsoid, ``elevation`` m above mean sea level, ``service_volume`` T, L or H, ``kind`` of
    :data:`KINDS`; ``declination`` rad, east positive: true bearing = radial + declination (0 and unused without a VOR).  A transmitter may
    state its ``weather`` and the ranges ``reach_m`` between which it is received.
    """

    ident: str
    name: str
    lat: float
    lon: float
    height: float
    elevation: float
    channel: str
    service_volume: str
    kind: str = "DME"
    declination: float = 0.0
    weather: Weather | None = None
    reach_m: tuple[float, float] = (0.0, math.inf)

    @property
    def has_dme(self) -> bool:
        """Whether it answers a DME."""
        return self.kind in RANGING

    @property
    def has_vor(self) -> bool:
        """Whether a VOR receiver reads its radials."""
        return self.kind in BEARING

    def service_range_m(self, height: float) -> float:
        """Return the range to which service is assured at an aircraft height (m above the ellipsoid).

        Standard service volumes: T 25 NM; L 40 NM; H 40 NM, 100 NM above 14 500 ft, 130 NM above 18 000 ft over the station.
        """
        above_ft = (height - self.height) / FOOT
        if self.service_volume == "H" and above_ft >= 14_500.0:
            return (130.0 if above_ft >= 18_000.0 else 100.0) * NAUTICAL_MILE
        return (25.0 if self.service_volume == "T" else 40.0) * NAUTICAL_MILE


class StationTable:
    """Stations by ident, checked as a whole.

    Raises
    ------
    StationError
        For a duplicate ident, coincident stations, or a longitude whose sign differs from that of all the others around it.
    """

    def __init__(self, stations: Iterable[Station]) -> None:
        self._by_ident: dict[str, Station] = {}
        for station in stations:
            if station.ident in self._by_ident:
                raise StationError(f"Station {station.ident} is listed twice; remove one line.")
            self._by_ident[station.ident] = station
        if not self._by_ident:
            raise StationError("The station table is empty; list at least one station.")
        _refuse_lost_longitude_sign(list(self))
        _refuse_coincident(list(self))
        transmitters.refuse_outliers([s for s in self if s.kind in transmitters.KINDS])

    def __iter__(self) -> Iterator[Station]:
        return iter(self._by_ident.values())

    def __len__(self) -> int:
        return len(self._by_ident)

    def __contains__(self, ident: str) -> bool:
        return ident in self._by_ident

    def __getitem__(self, ident: str) -> Station:
        if ident not in self._by_ident:
            raise StationError(f"Station {ident} is not in the table; it has {', '.join(sorted(self._by_ident))}.")
        return self._by_ident[ident]

    def named(self, idents: str, kinds: tuple[str, ...]) -> list[Station]:
        """Return the stations of a list of idents separated by commas, in its order.

        Raises
        ------
        StationError
            For one that is not in the table or of none of the ``kinds``.
        """
        stations = [self[ident.strip().upper()] for ident in idents.split(",") if ident.strip()]
        for station in stations:
            if station.kind not in kinds:
                raise StationError(f"Station {station.ident} is a {station.kind}; name one of kind {', '.join(kinds)}.")
        return stations


def stations_from_text(text: str, where: str = "stations") -> StationTable:
    """Read a station table from CSV text; see the module docstring for the columns.

    Raises
    ------
    StationError
        Naming the line and what to do.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise StationError(f"{where}: no stations; the first line names the columns {', '.join(COLUMNS)}.")
    header = _cells(lines[0][1], where)
    missing = [column for column in COLUMNS if column not in header]
    if missing and any(column not in header for column in transmitters.COLUMNS):
        raise StationError(f"{where}: column {', '.join(missing)} is missing; the first line names {', '.join(COLUMNS)}.")
    stations = []
    for number, line in lines[1:]:
        row = _cells(line, f"{where} line {number}")
        if len(row) != len(header):
            raise StationError(f"{where} line {number}: {len(row)} cells for {len(header)} columns; check the commas.")
        stations.append(station_from_cells(dict(zip(header, row, strict=True)), f"{where} line {number}"))
    return StationTable(stations)


def _cells(line: str, where: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise StationError(f"{where}: not readable as comma-separated text ({error}); retype the line.") from None


def station_from_cells(cells: dict[str, str], where: str) -> Station:
    """Return the station one row of text cells describes, by column name.

    Raises
    ------
    StationError
        For a cell that cannot be right; the message begins with ``where``.
    """
    ident = cells["ident"].upper()
    if not re.fullmatch(r"[A-Z0-9]{1,4}", ident):
        raise StationError(f"{where}: ident '{cells['ident']}' must be one to four letters or digits.")
    lat_deg = number_of(cells, "lat_deg", -90.0, 90.0, where)
    lon_deg = number_of(cells, "lon_deg", -180.0, 180.0, where)
    if cells.get("kind", "").upper() in transmitters.KINDS:
        height, weather, reach_m = transmitters.from_cells(cells, where)
        place = math.radians(lat_deg), math.radians(lon_deg), height, height
        return Station(ident, cells["name"], *place, "", "", cells["kind"].upper(), weather=weather, reach_m=reach_m)
    missing = [column for column in COLUMNS if column not in cells]
    if missing:
        raise StationError(f"{where}: a {cells.get('kind') or 'DME'} needs the column {missing[0]}.")
    elevation_ft = number_of(cells, "elevation_ft", LOWEST_FT, HIGHEST_FT, where)
    undulation_m = number_of(cells, "undulation_m", -110.0, 90.0, where)
    if not re.fullmatch(r"\d{1,3}[XY]", cells["channel"]) or not 1 <= int(cells["channel"][:-1]) <= 126:
        raise StationError(f"{where}: channel '{cells['channel']}' must be 1 to 126 followed by X or Y.")
    if cells["service_volume"] not in SERVICE_VOLUMES:
        raise StationError(f"{where}: service volume '{cells['service_volume']}' must be T, L or H.")
    kind, declination = _kind_and_declination(cells, where)
    elevation = elevation_ft * FOOT
    place = math.radians(lat_deg), math.radians(lon_deg), elevation + undulation_m, elevation
    return Station(ident, cells["name"], *place, cells["channel"], cells["service_volume"], kind, declination)


def _kind_and_declination(cells: dict[str, str], where: str) -> tuple[str, float]:
    kind = cells.get("kind", "").upper() or "DME"
    if kind not in KINDS:
        raise StationError(f"{where}: kind '{cells['kind']}' must be one of {', '.join(KINDS)}.")
    if cells.get("declination_deg", ""):
        return kind, math.radians(number_of(cells, "declination_deg", -180.0, 180.0, where))
    if kind in BEARING:
        raise StationError(f"{where}: a {kind} needs declination_deg, the station's own (east +), or its radials point nowhere.")
    return kind, 0.0


def _refuse_lost_longitude_sign(stations: list[Station]) -> None:
    """A lost minus sign puts a station alone on the other side of the world, at the mirrored place of its neighbours."""
    near, beside = math.radians(10.0), math.radians(5.0)
    for station in stations:
        others = [s for s in stations if s is not station]
        alone = all(abs(s.lon - station.lon) > near for s in others)
        neighbours = [s for s in others if abs(s.lon + station.lon) < near and abs(s.lat - station.lat) < beside]
        if alone and len(neighbours) >= 2:
            raise StationError(
                f"Station {station.ident} at longitude {math.degrees(station.lon):.4f} lies opposite {neighbours[0].ident} and others; "
                f"its sign looks lost, try {-math.degrees(station.lon):.4f}."
            )


def _refuse_coincident(stations: list[Station]) -> None:
    places = [(s, geodetic_to_ecef(s.lat, s.lon, s.height)) for s in stations]
    for i, (a, place_a) in enumerate(places):
        for b, place_b in places[i + 1 :]:
            distance_m = math.dist(place_a, place_b)
            if distance_m < (transmitters.COINCIDENT_M if a.kind in transmitters.KINDS else COINCIDENT_M):
                raise StationError(f"Stations {a.ident} and {b.ident} are {distance_m:.0f} m apart, as good as one; remove one of them.")
