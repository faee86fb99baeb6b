"""Stations with DME out of public lists: our own CSV, OurAirports ``navaids.csv``, X-Plane and FlightGear ``earth_nav.dat``/``nav.dat``.

A public list is large, world-wide and dirty: a row that cannot be used is rejected and counted with its reason, never guessed.  Public
lists give elevations above mean sea level and no geoid, so the height above the ellipsoid needs ``undulation_m`` for the area; what is
planned on heights above sea level throughout does not depend on it.

OurAirports gives the declination a VOR was aligned with (``slaved_variation_deg``); X-Plane's DME rows do not, so its stations range only.
Service volumes are read from the power class (HIGH H, MEDIUM L, anything else T, the smallest), or as the largest standard volume
within the published range.
"""

import collections
import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.documents import number_in
from lowcostnav_ros.base.units import FOOT, NAUTICAL_MILE
from lowcostnav_ros.physics.earth import geodetic_to_ecef
from lowcostnav_ros.radionav import stations as table
from lowcostnav_ros.radionav.channels import channel_of
from lowcostnav_ros.radionav.coverage import near
from lowcostnav_ros.radionav.stations import COINCIDENT_M, COLUMNS, Station, StationError, StationTable

_OURAIRPORTS = ("ident", "name", "latitude_deg", "longitude_deg", "elevation_ft", "dme_channel", "power")
_POWER = {"HIGH": "H", "MEDIUM": "L"}
_DME_ROWS = ("12", "13")


@dataclass(frozen=True, eq=False)
class NavaidList:
    """Stations as a list, idents repeated as the world does; ``region`` per station, and why rows were rejected with their number."""

    stations: list[Station]
    region: list[str]
    left_out: collections.Counter = field(default_factory=collections.Counter)


def navaids_from_text(text: str, where: str = "stations", undulation_m: float = 0.0) -> NavaidList:
    """Read any of the known formats, recognised by their first line.

    Parameters
    ----------
    text : str
    where : str
        Name of the file for messages.
    undulation_m : float
        Mean sea level above the ellipsoid, m, for lists that do not carry it.

    Raises
    ------
    StationError
        For an unknown format, or a list without one usable station.
    """
    first = next((line for line in text.lstrip("\ufeff").splitlines() if line.strip() and not line.lstrip().startswith("#")), "")
    header = [cell.strip().strip('"') for cell in first.split(",")]
    if set(_OURAIRPORTS) <= set(header):
        rows = _ourairports(text.lstrip("\ufeff"), where)
    elif re.match(r"\s*([AI]\s*$|\d{3,4}\s+Version|1[23]\s+-?\d)", first):
        rows = _xplane(text)
    elif {"ident", "lat_deg"} & set(header):
        return _own_table(text, where)
    else:
        raise StationError(
            f"{where}: not a known station list; give a CSV with {', '.join(COLUMNS)}, OurAirports navaids.csv or X-Plane earth_nav.dat."
        )
    return _collected(rows, where, undulation_m)


def select_near(
    navaids: NavaidList, lat: np.ndarray, lon: np.ndarray, within_m: float, where: str = "stations"
) -> tuple[StationTable, list[str]]:
    """Choose the stations within ``within_m`` of any of the places (rad) and make them a table of unique idents.

    Returns
    -------
    table : StationTable
    notes : list of str
        One sentence for each station that had to be dropped, nearest kept.

    Raises
    ------
    StationError
        When there is none; a lost sign of the longitude is named.
    """
    chosen: list[Station] = []
    notes: list[str] = []
    for station in near(navaids.stations, lat, lon, within_m):
        clash = _clash(station, chosen)
        if clash:
            notes.append(clash)
        else:
            chosen.append(station)
    if not chosen:
        raise StationError(_why_none(navaids, lat, lon, within_m, where))
    return StationTable(chosen), notes


def lost_longitude_signs(navaids: NavaidList) -> list[Station]:
    """Return the stations that stand alone in their region and opposite two or more others of it: their sign looks lost."""
    regions: dict[str, list[Station]] = {}
    for station, region in zip(navaids.stations, navaids.region, strict=True):
        regions.setdefault(region, []).append(station)
    return [s for region, members in regions.items() if region for s in _opposite(members)]


def table_as_text(stations: Iterable[Station]) -> str:
    """Write stations in the package's own format, see :mod:`lowcostnav_ros.radionav.stations`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS + table.OPTIONAL_COLUMNS)
    for s in stations:
        place = (f"{math.degrees(s.lat):.6f}", f"{math.degrees(s.lon):.6f}", f"{s.elevation / FOOT:.0f}")
        radial = (s.kind, f"{math.degrees(s.declination):.1f}" if s.has_vor else "")
        writer.writerow((s.ident, s.name, *place, f"{s.height - s.elevation:.1f}", s.channel, s.service_volume, *radial))
    return out.getvalue()


def _own_table(text: str, where: str) -> NavaidList:
    listed = list(table.stations_from_text(text, where))
    ranging = [station for station in listed if station.has_dme]
    if not ranging:
        raise StationError(f"{where}: no station with DME, only VOR; add one to plan ranges.")
    left_out = collections.Counter({"VOR without DME": len(listed) - len(ranging)} if len(ranging) < len(listed) else {})
    return NavaidList(ranging, [""] * len(ranging), left_out)


def _table_rows(text: str, where: str) -> Iterator[dict[str, str]]:
    try:
        yield from csv.DictReader(io.StringIO(text, newline=""))
    except csv.Error as error:
        raise StationError(f"{where}: not readable as comma-separated text ({error}); fetch the list again.") from None


def _ourairports(text: str, where: str) -> Iterator[tuple[str, dict[str, str]]]:
    for row in _table_rows(text, where):
        channel = (row["dme_channel"] or "").strip().lstrip("0")
        if not channel and not (row.get("dme_frequency_khz") or "").strip():
            if "DME" in (row.get("type") or "") or row.get("type") in ("TACAN", "VORTAC"):
                yield "no channel", {}
            continue  # a VOR or NDB without DME
        terminal = (row.get("usageType") or "") == "TERMINAL"
        yield row.get("iso_country") or "", {
            "ident": row["ident"] or "",
            "name": row["name"] or "",
            "lat_deg": row.get("dme_latitude_deg") or row["latitude_deg"] or "",
            "lon_deg": row.get("dme_longitude_deg") or row["longitude_deg"] or "",
            "elevation_ft": row.get("dme_elevation_ft") or row["elevation_ft"] or "",
            "channel": channel or _paired(row["dme_frequency_khz"], 1000.0),
            "service_volume": "T" if terminal else _POWER.get((row["power"] or "").upper(), "T"),
            **_radials(row),
        }


def _radials(row: dict[str, str]) -> dict[str, str]:
    """Kind and declination of a row; a VOR whose slaved variation is not published is good for ranges only."""
    kind, declination = (row.get("type") or "").strip().upper(), (row.get("slaved_variation_deg") or "").strip()
    return {"kind": kind, "declination_deg": declination} if kind in table.BEARING and declination else {}


def _xplane(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Rows 12 and 13: code lat lon elevation_ft frequency range_nm bias_nm ident [airport region] name ..."""
    enroute = bool(re.search(r"^(1[1-9]|[2-9]\d)\d\d\s+Version", text, re.MULTILINE))  # 1100 and later carry airport and region
    for line in text.splitlines():
        cells = line.split()
        if not cells or cells[0] not in _DME_ROWS:
            continue
        if len(cells) < (11 if enroute else 9):
            yield "row too short", {}
            continue
        volume = _volume_within(cells[5])
        if not volume:
            yield "range below 25 NM", {}
        elif number_in(cells[6]) != 0.0:
            yield "range offset by design", {}
        else:
            yield cells[9][0:1] if enroute else "", {
                "ident": cells[7],
                "name": " ".join(cells[10 if enroute else 8 :]),
                "lat_deg": cells[1],
                "lon_deg": cells[2],
                "elevation_ft": cells[3],
                "channel": _paired(cells[4], 100.0),
                "service_volume": volume,
            }


def _volume_within(range_nm: str) -> str:
    value = number_in(range_nm)
    return "H" if value >= 100.0 else "L" if value >= 40.0 else "T" if value >= 25.0 else ""


def _paired(frequency: str, per_mhz: float) -> str:
    """Channel of a frequency given in 1/``per_mhz`` MHz; empty, and refused later, where none is paired."""
    try:
        return channel_of(float(frequency) / per_mhz)
    except ValueError:
        return ""


def _collected(rows: Iterable[tuple[str, dict[str, str]]], where: str, undulation_m: float) -> NavaidList:
    """Validate row by row with the rules of the package's own format; the first field of a row without cells is the reason."""
    found = NavaidList([], [])
    for region, cells in rows:
        if not cells:
            found.left_out[region] += 1
            continue
        try:
            plain = {column: " ".join(text.split()) for column, text in cells.items()}
            station = table.station_from_cells(plain | {"undulation_m": f"{undulation_m:g}"}, cells["ident"] or "a row")
        except StationError as error:
            found.left_out[_reason(error)] += 1
            continue
        found.stations.append(station)
        found.region.append(region)
    if not found.stations:
        reasons = ", ".join(f"{n} with {reason}" for reason, n in found.left_out.items())
        raise StationError(f"{where}: no usable DME station{f' ({reasons})' if reasons else ''}; check that it is a navaid list with DME.")
    return found


def _reason(error: StationError) -> str:
    words = ("lat_deg", "lon_deg", "elevation_ft", "channel", "ident", "undulation_m")
    return f"unusable {next((w for w in words if f'{w} ' in str(error)), 'text')}"


def _clash(station: Station, chosen: Sequence[Station]) -> str:
    """Why a station cannot stand beside those chosen already, empty when it can."""
    place = geodetic_to_ecef(station.lat, station.lon, station.height)
    for other in chosen:
        apart = math.dist(place, geodetic_to_ecef(other.lat, other.lon, other.height))
        if other.ident == station.ident:
            where = f"{apart / NAUTICAL_MILE:.0f} NM apart" if apart > NAUTICAL_MILE else "one place"
            return f"{station.ident} is listed twice ({where}); the nearer entry, '{other.name}', is used."
        if apart < COINCIDENT_M:
            return f"{station.ident} stands beside {other.ident} ({apart:.0f} m) and adds nothing to a fix; {other.ident} is used."
    return ""


def _opposite(members: Sequence[Station]) -> list[Station]:
    lat, lon = (np.degrees([getattr(s, name) for s in members]) for name in ("lat", "lon"))
    found = []
    for i, station in enumerate(members):
        apart = np.abs(lon - lon[i])
        alone = np.sum(np.minimum(apart, 360.0 - apart) < 10.0) == 1
        if alone and np.sum((np.abs(lon + lon[i]) < 10.0) & (np.abs(lat - lat[i]) < 5.0)) >= 2:
            found.append(station)
    return found


def _why_none(navaids: NavaidList, lat: np.ndarray, lon: np.ndarray, within_m: float, where: str) -> str:
    lat, lon = np.atleast_1d(lat), np.atleast_1d(lon)
    place = f"{math.degrees(lat[0]):.3f}, {math.degrees(lon[0]):.3f}"
    mirrored = near(navaids.stations, lat, -lon, within_m)
    if mirrored:
        return f"{where}: no station near {place}, but {len(mirrored)} at the mirrored longitude; a minus sign of the longitude looks lost."
    return f"{where}: no station within {within_m / NAUTICAL_MILE:.0f} NM of {place}; give a list that covers the place."
