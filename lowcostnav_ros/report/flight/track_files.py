"""The tracks of a flight as KML, for Google Earth, or as GPX, by the ending of the file's name."""

import datetime
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.report.flight.figures import colour_of, reference_of
from lowcostnav_ros.report.flight.result_folder import Columns, ReportError, Result
from lowcostnav_ros.report.svg import element, escape

STEP_S = 0.5
"""Least time between two points."""
_GREY = "#777777"


def write_track(result: Result, path: Path) -> None:
    """Write reference, fixes and every navigator's track.

    Raises
    ------
    ReportError
        For another ending than ``.kml`` or ``.gpx``, or without any position.
    """
    make = {".kml": kml, ".gpx": gpx}.get(path.suffix.lower())
    if make is None:
        raise ReportError(f"{path}: name a file that ends in .kml or .gpx.")
    write_text(path, make(result))


def _tracks(result: Result) -> Iterator[tuple[str, str, Columns]]:
    names = list(result.navigators)
    own = ((name, colour_of(name, names), one.solutions) for name, one in result.navigators.items())
    for name, colour, columns in ((reference_of(result), "#222222", result.truth), ("GPS fixes", _GREY, result.gps), *own):
        if not len(columns.get("t_s", ())) or not np.isfinite(columns["lat_deg"]).any():
            continue
        known = np.flatnonzero(np.isfinite(columns["lat_deg"]))
        slots = np.floor(columns["t_s"][known] / STEP_S)
        rows = known[np.flatnonzero(np.diff(slots, prepend=-np.inf) > 0)]
        yield name, colour, {key: columns[key][rows] for key in ("t_s", "lat_deg", "lon_deg", "height_m")}


def _rows(columns: Columns) -> Iterator[tuple[float, float, float, float]]:
    height = np.nan_to_num(columns["height_m"] - undulation(np.radians(columns["lat_deg"]), np.radians(columns["lon_deg"])))
    yield from zip(columns["t_s"].tolist(), columns["lat_deg"].tolist(), columns["lon_deg"].tolist(), height.tolist(), strict=True)


def kml(result: Result) -> str:
    """Tracks with their times, heights above the sea, as the viewer takes them."""
    folders = []
    for name, colour, columns in _tracks(result):
        red, green, blue = colour[1:3], colour[3:5], colour[5:7]
        style = f"<Style><LineStyle><color>ff{blue}{green}{red}</color><width>3</width></LineStyle></Style>"
        when = "".join(f"<when>{_utc(t)}</when>" for t, *_ in _rows(columns))
        where = "".join(f"<gx:coord>{lon:.7f} {lat:.7f} {h:.1f}</gx:coord>" for _, lat, lon, h in _rows(columns))
        track = f"<gx:Track><altitudeMode>absolute</altitudeMode>{when}{where}</gx:Track>"
        folders.append(f"<Placemark><name>{escape(name)}</name>{style}{track}</Placemark>")
    names = 'xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<kml {names}><Document>{"".join(folders)}</Document></kml>\n'


def gpx(result: Result) -> str:
    """Tracks with their times, heights above the sea, as GPX has them."""
    tracks = []
    for name, _, columns in _tracks(result):
        points = "".join(
            f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><ele>{h:.1f}</ele><time>{_utc(t)}</time></trkpt>' for t, lat, lon, h in _rows(columns)
        )
        tracks.append(f"<trk>{element('name', escape(name))}<trkseg>{points}</trkseg></trk>")
    head = '<gpx version="1.1" creator="lowcostnav_ros" xmlns="http://www.topografix.com/GPX/1/1">'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{head}{"".join(tracks)}</gpx>\n'


def _utc(stamp_s: float) -> str:
    return f"{datetime.datetime.fromtimestamp(round(stamp_s, 3), tz=datetime.UTC):%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z"
