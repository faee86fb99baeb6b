"""The map: truth, solutions, fixes and stations, north up, equal scale both ways; the page's script draws its grid and its scales."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.catalogue import background
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.replay.columns import position_difference_n
from lowcostnav_ros.replay.result import Place
from lowcostnav_ros.report import svg

WIDTH, MARGIN = 960, 46
MAX_POINTS = 1800
FINER = 20
"""Units of the drawing in a pixel: a reader may look so much closer."""
WIDER = 4.0
"""Coast is there for a reader who zooms out, over so many widths of the map."""
FARTHEST_NM = 200.0
"""A station farther away than any receiver receives is not named."""


@dataclasses.dataclass(frozen=True)
class Track:
    """A ground track: degrees, with how to draw it; ``size`` is that of its dots."""

    lat_deg: np.ndarray
    lon_deg: np.ndarray
    colour: str
    label: str
    width: float = 1.8
    dash: str | None = None
    dots: bool = False
    size: float = 3.2


@dataclasses.dataclass(frozen=True)
class Ellipse:
    """Two-sigma region of a solution: centre in degrees, one-sigma north and east in metres."""

    lat_deg: float
    lon_deg: float
    sigma_north_m: float
    sigma_east_m: float
    colour: str
    label: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Cells:
    """Classes over a rectangle: ``classes`` (rows, columns) of whole numbers, from south and west, of which the negative ones stay clear.

    ``north_m`` and ``east_m`` are the middles of rows and columns, evenly apart, in ``frame``.
    """

    north_m: np.ndarray
    east_m: np.ndarray
    classes: np.ndarray
    colours: Sequence[str]
    words: Sequence[str]
    frame: LocalFrame

    def at(self, north_m: np.ndarray, east_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Latitude and longitude of places, degrees."""
        lat, lon, _ = self.frame.from_ned(np.column_stack([north_m, east_m, np.zeros(len(north_m))]))
        return np.degrees(lat), np.degrees(lon)

    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of rows and of columns, m."""
        halves = [0.5 * (side[1] - side[0]) for side in (self.north_m, self.east_m)]
        return tuple(np.append(s - h, s[-1] + h) for s, h in zip((self.north_m, self.east_m), halves, strict=True))  # type: ignore[return-value]

    def extent(self) -> Track:
        """Its middle and its corners."""
        north, east = self.edges()
        corners = self.at(np.append(0.0, north[[0, 0, -1, -1]]), np.append(0.0, east[[0, -1, 0, -1]]))
        return Track(*corners, "none", "", dots=True)

    def drawn(self, ground: "Ground") -> str:
        """A path for each class, of rectangles that lie side by side."""
        north, east = self.edges()
        n, e = np.meshgrid(north, east, indexing="ij")
        x, y = (v.reshape(n.shape).round().astype(int) for v in ground.units(*self.at(n.ravel(), e.ravel())))
        paths: dict[int, list[str]] = {}
        for i, row in enumerate(self.classes):
            starts = np.flatnonzero(np.append(True, row[1:] != row[:-1]))
            for a, b in zip(starts, [*starts[1:], len(row)], strict=True):
                if row[a] >= 0:
                    corners = ((i, a), (i, b), (i + 1, b), (i + 1, a))
                    paths.setdefault(int(row[a]), []).append("M" + "L".join(f"{x[c]} {y[c]}" for c in corners) + "z")
        looks = {k: {"fill": self.colours[k], "stroke": self.colours[k], "stroke_width": 0.8} for k in paths}
        cells = (svg.path("".join(d), data_label=self.words[k], **looks[k]) for k, d in sorted(paths.items()))
        return svg.element("g", "".join(cells), opacity=0.8)

    def legend(self) -> str:
        """The colours in a line of text, those that are there."""
        there = sorted({int(k) for k in np.unique(self.classes) if k >= 0})
        spans = (svg.element("span", svg.escape(self.words[k]), style=f"border-color:{self.colours[k]}") for k in there)
        return svg.element("p", "".join(spans), class_="note colours")


class Ground:
    """Metres north and east of the middle of the tracks, and pixels of them."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        lat = np.concatenate([t.lat_deg[np.isfinite(t.lat_deg)] for t in tracks])
        lon = np.concatenate([t.lon_deg[np.isfinite(t.lat_deg)] for t in tracks])
        self.lat0, self.lon0 = math.radians(0.5 * (lat.min() + lat.max())), math.radians(lon[0])
        north, east = self.metres(lat, lon)
        margin = max(0.06 * max(np.ptp(north), np.ptp(east)), 5.0)
        width_m, height_m = np.ptp(east) + 2.0 * margin, np.ptp(north) + 2.0 * margin
        inner = WIDTH - 2 * MARGIN
        self.scale = min(inner / width_m, 620.0 / height_m)
        shown_height = max(260.0, self.scale * height_m)
        self.south, self.north = 0.5 * (north.min() + north.max()) + 0.5 * shown_height / self.scale * np.array([-1.0, 1.0])
        self.west, self.east = 0.5 * (east.min() + east.max()) + 0.5 * inner / self.scale * np.array([-1.0, 1.0])
        self.height = round(shown_height) + 2 * MARGIN

    @classmethod
    def under(cls, tracks: Sequence[Track]) -> "Ground | None":
        """The ground of a map of tracks; None without positions."""
        known = [t for t in tracks if np.isfinite(t.lat_deg).any()]
        return cls(known) if known else None

    def holds(self, north: float, east: float) -> bool:
        """Whether a place lies within the map."""
        return bool(self.south < north < self.north and self.west < east < self.east)

    def metres(self, lat_deg: np.ndarray, lon_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Metres north and east of the middle."""
        position = np.column_stack([np.radians(lat_deg), np.radians(lon_deg), np.zeros(len(lat_deg))])
        reference = np.tile([self.lat0, self.lon0, 0.0], (len(position), 1))
        offset = position_difference_n(position, reference)
        return offset[:, 0], offset[:, 1]

    def units(self, lat_deg: np.ndarray | float, lon_deg: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Units of positions, from the north-west corner."""
        north, east = self.metres(np.atleast_1d(lat_deg), np.atleast_1d(lon_deg))
        return (east - self.west) * self.scale * FINER, (self.north - north) * self.scale * FINER

    def degrees(self, wider: float) -> tuple[float, float, float, float]:
        """South, west, north and east of the map, made so many times wider, degrees."""
        per_north = math.radians(6_371_000.0)
        per_east = per_north * max(math.cos(self.lat0), 0.01)
        half_north, half_east = (0.5 * wider * (b - a) for a, b in ((self.south, self.north), (self.west, self.east)))
        lat = math.degrees(self.lat0) + 0.5 * (self.south + self.north) / per_north
        lon = math.degrees(self.lon0) + 0.5 * (self.west + self.east) / per_east
        return lat - half_north / per_north, lon - half_east / per_east, lat + half_north / per_north, lon + half_east / per_east

    def pin(self, lat_deg: float, lon_deg: float, content: str) -> str:
        """Marks drawn about (0, 0) at a place, as large however close a reader looks."""
        (x,), (y,) = self.units(lat_deg, lon_deg)
        where = f"translate({MARGIN + x / FINER:.1f} {MARGIN + y / FINER:.1f})"
        return svg.element("g", content, class_="pin", transform=where, data_x=f"{x:.0f}", data_y=f"{y:.0f}")


def map_chart(
    tracks: Sequence[Track], stations: Sequence[Place] = (), ellipses: Sequence[Ellipse] = (), cells: Cells | None = None
) -> str:
    """Draw the map; an empty string without positions.

    Parameters
    ----------
    tracks : sequence of Track
        Drawn in this order; together they decide the extent.
    stations : sequence of Place
        Those inside the extent are drawn, the rest is named below with distance and bearing.
    ellipses : sequence of Ellipse
    cells : Cells, optional
        Colours under all of it, which lie within the extent too.
    """
    ground = Ground.under([*tracks, cells.extent()] if cells else tracks)
    if ground is None:
        return ""
    tracks = [t for t in tracks if np.isfinite(t.lat_deg).any()]
    under = (cells.drawn(ground) if cells else "") + _coast(ground)
    inside = "".join([under, *(_ellipse(ground, e) for e in ellipses), *(_track(ground, t) for t in tracks)])
    pins, outside = _stations(ground, stations)
    pins = _airports(ground) + pins
    width, height = WIDTH - 2 * MARGIN, ground.height - 2 * MARGIN
    box = {"x": MARGIN, "y": MARGIN, "width": width, "height": height, "viewBox": f"0 0 {width * FINER} {height * FINER}"}
    plot = svg.element("svg", inside, class_="plot", preserveAspectRatio="xMidYMid meet", **box)
    marks = svg.element("g", pins + ("" if cells else _ends(ground, tracks[0])), class_="pins")
    axes = svg.element("g", svg.element("rect", **{k: box[k] for k in ("x", "y", "width", "height")}, class_="frame"), class_="axes")
    parts = [axes, plot, marks, _names(ground), _north()]
    note = f'<p class="note">Stations outside the map: {svg.escape(", ".join(outside))}.</p>' if outside else ""
    corner = {"data_per_metre": f"{ground.scale * FINER:.6g}", "data_west": f"{ground.west:.1f}", "data_north": f"{ground.north:.1f}"}
    corner |= {"data_lat": f"{math.degrees(ground.lat0):.6f}", "data_lon": f"{math.degrees(ground.lon0):.6f}"}
    drawn = svg.drawing("map", "map", WIDTH, ground.height, "".join(parts), data_margin=MARGIN, **corner)
    caption = (cells.legend() if cells else "") + _legend([t for t in tracks if t.label], bool(ellipses))
    return f"{caption}{drawn}{note}"


def _track(ground: Ground, track: Track) -> str:
    step = max(1, math.ceil(len(track.lat_deg) / MAX_POINTS))
    x, y = ground.units(track.lat_deg[::step], track.lon_deg[::step])
    if track.dots:
        look: dict[str, Any] = {"stroke_width": track.size, "stroke_linecap": "round"}
        data = svg.dots_data(x, y)
    else:
        look = {"stroke_width": track.width, "stroke_dasharray": track.dash, "stroke_linejoin": "round"}
        data = svg.path_data(x, y)
    return svg.path(data, stroke=track.colour, data_label=track.label, **look)


def _ellipse(ground: Ground, e: Ellipse) -> str:
    (x,), (y,) = ground.units(e.lat_deg, e.lon_deg)
    rx, ry = (2.0 * sigma * ground.scale * FINER for sigma in (e.sigma_east_m, e.sigma_north_m))
    colours: dict[str, Any] = {"fill": e.colour, "fill_opacity": 0.06, "stroke": e.colour, "stroke_opacity": 0.5}
    title = svg.element("title", svg.escape(e.label)) if e.label else ""
    return svg.element("ellipse", title, cx=f"{x:.0f}", cy=f"{y:.0f}", rx=f"{rx:.0f}", ry=f"{ry:.0f}", **colours)


def _coast(ground: Ground) -> str:
    lines = (svg.path_data(*ground.units(line[:, 0], line[:, 1])) for line in background.coast(*ground.degrees(WIDER)))
    return svg.path("".join(lines), class_="coast")


def _airports(ground: Ground) -> str:
    """Pins of the airports, their names for who points at them."""
    pins = []
    for one in background.airports(*ground.degrees(1.0)):
        (north,), (east,) = ground.metres(np.array([one.lat_deg]), np.array([one.lon_deg]))
        if ground.holds(north, east):
            title = svg.element("title", svg.escape(one.name))
            mark = svg.element("circle", title, r=3.5) + svg.element("path", d="M-5 0h10") + svg.text(7, 4, one.ident)
            pins.append(ground.pin(one.lat_deg, one.lon_deg, svg.element("g", mark, class_="airport")))
    return "".join(pins)


def _stations(ground: Ground, stations: Sequence[Place]) -> tuple[str, list[str]]:
    """Pins of all stations that may be received, and those in words that lie outside the map."""
    pins, outside = [], []
    hexagon = " ".join(f"{6 * math.cos(k * math.pi / 3):.1f},{6 * math.sin(k * math.pi / 3):.1f}" for k in range(6))
    for s in stations:
        (north,), (east,) = ground.metres(np.array([s.lat_deg]), np.array([s.lon_deg]))
        distance, is_inside = math.hypot(north, east) / NAUTICAL_MILE, ground.holds(north, east)
        if is_inside or distance <= FARTHEST_NM:
            mark = svg.element("polygon", points=hexagon, class_="station") + svg.text(9, 4, s.ident, class_="station-name")
            pin = ground.pin(s.lat_deg, s.lon_deg, mark)
            pins.append(pin if is_inside else pin.replace("<g", '<g visibility="hidden"', 1))
        if not is_inside and distance <= FARTHEST_NM:
            outside.append(f"{s.ident} {distance:.0f} NM, {math.degrees(math.atan2(east, north)) % 360:03.0f}\N{DEGREE SIGN}")
    return "".join(pins), outside


def _ends(ground: Ground, track: Track) -> str:
    known = np.flatnonzero(np.isfinite(track.lat_deg))
    ends = (known[0], "start"), (known[-1], "end")
    dot = svg.element("circle", cx=0, cy=0, r=4, class_="end")
    return "".join(ground.pin(track.lat_deg[k], track.lon_deg[k], dot + svg.text(7, -6, word, class_="tick")) for k, word in ends)


def _names(ground: Ground) -> str:
    """What the numbers on the edges are."""
    origin = f"{_side(ground.lat0, 'NS')}, {_side(ground.lon0, 'EW')}"
    caption = f"east and north of {origin} [NM]; coast to about 1 km"
    along = svg.text(WIDTH / 2, ground.height - MARGIN + 30, caption, class_="tick", text_anchor="middle")
    return svg.element("g", along, class_="names")


def _side(angle: float, letters: str) -> str:
    return f"{letters[angle < 0.0]} {abs(math.degrees(angle)):.4f}\N{DEGREE SIGN}"


def _north() -> str:
    x, y = WIDTH - MARGIN - 22, MARGIN + 34
    arrow = svg.element("path", d=f"M{x} {y - 24}l6 20l-6 -4l-6 4z")
    return svg.element("g", arrow + svg.text(x, y + 10, "N", class_="station-name", text_anchor="middle"), class_="north")


def _legend(tracks: Sequence[Track], has_ellipses: bool) -> str:
    """The marks of the tracks in a line of text, which a narrow window breaks."""
    if not tracks:
        return ""
    caption = "".join(f"<span>{_sample(track)}{svg.escape(track.label)}</span>" for track in tracks)
    caption += "<span>ellipses: 2 sigma, every minute without GPS</span>" if has_ellipses else ""
    return f'<p class="note names-of-tracks">{caption}</p>'


def _sample(track: Track) -> str:
    """The mark of a track in the legend."""
    if track.dots:
        mark = svg.element("circle", cx=11, cy=4, r=2.5, fill=track.colour)
    else:
        mark = svg.element("line", x1=1, x2=21, y1=4, y2=4, stroke=track.colour, stroke_width=3, stroke_dasharray=track.dash)
    return svg.element("svg", mark, width=22, height=8, aria_hidden="true")
