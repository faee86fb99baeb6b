"""The map: truth, solutions, fixes and stations, north up, equal scale both ways."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.replay.columns import position_difference_n
from lowcostnav_ros.replay.result import Place
from lowcostnav_ros.report import svg

WIDTH, MARGIN = 960, 46
MAX_POINTS = 1800
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


class _Ground:
    """Metres north and east of the middle of the tracks, and pixels of them."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        lat = np.concatenate([t.lat_deg[np.isfinite(t.lat_deg)] for t in tracks])
        lon = np.concatenate([t.lon_deg[np.isfinite(t.lat_deg)] for t in tracks])
        self.lat0, self.lon0 = math.radians(0.5 * (lat.min() + lat.max())), math.radians(lon[0])
        north, east = self.metres(lat, lon)
        margin = max(0.06 * max(np.ptp(north), np.ptp(east)), 50.0)
        width_m, height_m = np.ptp(east) + 2.0 * margin, np.ptp(north) + 2.0 * margin
        inner = WIDTH - 2 * MARGIN
        self.scale = min(inner / width_m, 620.0 / height_m)
        shown_height = max(260.0, self.scale * height_m)
        self.south, self.north = 0.5 * (north.min() + north.max()) + 0.5 * shown_height / self.scale * np.array([-1.0, 1.0])
        self.west, self.east = 0.5 * (east.min() + east.max()) + 0.5 * inner / self.scale * np.array([-1.0, 1.0])
        self.height = round(shown_height) + 2 * MARGIN

    def metres(self, lat_deg: np.ndarray, lon_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Metres north and east of the middle."""
        position = np.column_stack([np.radians(lat_deg), np.radians(lon_deg), np.zeros(len(lat_deg))])
        reference = np.tile([self.lat0, self.lon0, 0.0], (len(position), 1))
        offset = position_difference_n(position, reference)
        return offset[:, 0], offset[:, 1]

    def pixels(self, lat_deg: np.ndarray | float, lon_deg: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Pixels of positions."""
        north, east = self.metres(np.atleast_1d(lat_deg), np.atleast_1d(lon_deg))
        return MARGIN + (east - self.west) * self.scale, MARGIN + (self.north - north) * self.scale


def map_chart(tracks: Sequence[Track], stations: Sequence[Place] = (), ellipses: Sequence[Ellipse] = ()) -> str:
    """Draw the map; an empty string without positions.

    Parameters
    ----------
    tracks : sequence of Track
        Drawn in this order; together they decide the extent.
    stations : sequence of Place
        Those inside the extent are drawn, the rest is named below with distance and bearing.
    ellipses : sequence of Ellipse
    """
    tracks = [t for t in tracks if np.isfinite(t.lat_deg).any()]
    if not tracks:
        return ""
    ground = _Ground(tracks)
    parts = [_graticule(ground), *(_ellipse(ground, e) for e in ellipses), *(_track(ground, t) for t in tracks)]
    shown, outside = _stations(ground, stations)
    parts += [shown, _ends(ground, tracks[0]), _scale_bar(ground), _north(), _legend(tracks, bool(ellipses))]
    note = f'<p class="note">Stations outside the map: {svg.escape(", ".join(outside))}.</p>' if outside else ""
    inner = svg.element("rect", x=MARGIN, y=MARGIN, width=WIDTH - 2 * MARGIN, height=ground.height - 2 * MARGIN)
    clip = svg.element("clipPath", inner, id="map")
    return svg.drawing("map", "map", WIDTH, ground.height, "".join([clip, *parts])) + note


def _track(ground: _Ground, track: Track) -> str:
    step = max(1, math.ceil(len(track.lat_deg) / MAX_POINTS))
    x, y = ground.pixels(track.lat_deg[::step], track.lon_deg[::step])
    if track.dots:
        return svg.path(svg.dots_data(x, y), fill="none", stroke=track.colour, stroke_width=track.size, stroke_linecap="round")
    data = svg.path_data(x, y)
    return svg.path(data, fill="none", stroke=track.colour, stroke_width=track.width, stroke_dasharray=track.dash, stroke_linejoin="round")


def _ellipse(ground: _Ground, e: Ellipse) -> str:
    (x,), (y,) = ground.pixels(e.lat_deg, e.lon_deg)
    rx, ry = 2.0 * e.sigma_east_m * ground.scale, 2.0 * e.sigma_north_m * ground.scale
    colours: dict[str, Any] = {"fill": e.colour, "fill_opacity": 0.06, "stroke": e.colour, "stroke_opacity": 0.5}
    return svg.element("ellipse", cx=f"{x:.1f}", cy=f"{y:.1f}", rx=f"{rx:.1f}", ry=f"{ry:.1f}", clip_path="url(#map)", **colours)


def _stations(ground: _Ground, stations: Sequence[Place]) -> tuple[str, list[str]]:
    parts, outside = [], []
    for s in stations:
        (north,), (east,) = ground.metres(np.array([s.lat_deg]), np.array([s.lon_deg]))
        if ground.south < north < ground.north and ground.west < east < ground.east:
            (x,), (y,) = ground.pixels(s.lat_deg, s.lon_deg)
            hexagon = " ".join(f"{x + 6 * math.cos(k * math.pi / 3):.1f},{y + 6 * math.sin(k * math.pi / 3):.1f}" for k in range(6))
            parts.append(svg.element("polygon", points=hexagon, class_="station"))
            parts.append(svg.text(x + 9, y + 4, s.ident, class_="station-name"))
        elif (distance := math.hypot(north, east) / NAUTICAL_MILE) <= FARTHEST_NM:
            outside.append(f"{s.ident} {distance:.0f} NM, {math.degrees(math.atan2(east, north)) % 360:03.0f}\N{DEGREE SIGN}")
    return "".join(parts), outside


def _ends(ground: _Ground, track: Track) -> str:
    known = np.flatnonzero(np.isfinite(track.lat_deg))
    parts = []
    for row, word in ((known[0], "start"), (known[-1], "end")):
        (x,), (y,) = ground.pixels(track.lat_deg[row], track.lon_deg[row])
        parts.append(svg.element("circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r=4, class_="end"))
        parts.append(svg.text(x + 7, y - 6, word, class_="tick"))
    return "".join(parts)


def _graticule(ground: _Ground) -> str:
    """Grid lines every round number of nautical miles from the south-west corner's round values, labelled on the edges."""
    parts = []
    right, base = WIDTH - MARGIN, ground.height - MARGIN
    ticks = svg.nice_ticks(ground.west / NAUTICAL_MILE, ground.east / NAUTICAL_MILE, 8)
    for value in ticks:
        x = MARGIN + (value * NAUTICAL_MILE - ground.west) * ground.scale
        parts.append(svg.element("line", x1=f"{x:.1f}", x2=f"{x:.1f}", y1=MARGIN, y2=base, class_="grid"))
        parts.append(svg.text(x, base + 14, svg.tick_label(value, ticks), class_="tick", text_anchor="middle"))
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
    first = math.ceil(ground.south / NAUTICAL_MILE / step)
    for value in [k * step for k in range(first, math.floor(ground.north / NAUTICAL_MILE / step) + 1)]:
        y = MARGIN + (ground.north - value * NAUTICAL_MILE) * ground.scale
        parts.append(svg.element("line", x1=MARGIN, x2=right, y1=f"{y:.1f}", y2=f"{y:.1f}", class_="grid"))
        parts.append(svg.text(MARGIN - 6, y + 3.5, svg.tick_label(value, ticks), class_="tick", text_anchor="end"))
    parts.append(svg.element("rect", x=MARGIN, y=MARGIN, width=right - MARGIN, height=base - MARGIN, class_="frame"))
    origin = f"{_side(ground.lat0, 'NS')}, {_side(ground.lon0, 'EW')}"
    parts.append(svg.text(WIDTH / 2, base + 30, f"east of {origin} [NM]", class_="tick", text_anchor="middle"))
    middle = ground.height / 2
    parts.append(svg.text(14, middle, "north [NM]", class_="tick", text_anchor="middle", transform=f"rotate(-90 14 {middle:.0f})"))
    return "".join(parts)


def _side(angle: float, letters: str) -> str:
    return f"{letters[angle < 0.0]} {abs(math.degrees(angle)):.4f}\N{DEGREE SIGN}"


def _scale_bar(ground: _Ground) -> str:
    """Two bars, one in nautical miles and one in kilometres, each about a sixth of the width."""
    parts = []
    for row, (unit, metres) in enumerate((("NM", NAUTICAL_MILE), ("km", 1000.0))):
        longest = (WIDTH - 2 * MARGIN) / ground.scale / metres / 6.0
        power = 10.0 ** math.floor(math.log10(longest))
        length = max(s * power for s in (1.0, 2.0, 5.0) if s * power <= longest)
        pixels = length * metres * ground.scale
        x, y = MARGIN + 14, ground.height - MARGIN - 14 - 18 * row
        parts.append(svg.element("path", d=f"M{x} {y - 4}v4h{pixels:.1f}v-4", class_="scale"))
        parts.append(svg.text(x + pixels + 6, y + 1, f"{length:g} {unit}", class_="tick"))
    return "".join(parts)


def _north() -> str:
    x, y = WIDTH - MARGIN - 22, MARGIN + 34
    arrow = svg.element("path", d=f"M{x} {y - 24}l6 20l-6 -4l-6 4z", class_="north")
    return arrow + svg.text(x, y + 10, "N", class_="station-name", text_anchor="middle")


def _legend(tracks: Sequence[Track], has_ellipses: bool) -> str:
    parts, x, y = [], float(MARGIN), MARGIN - 32.0
    labels = [t.label for t in tracks] + (["ellipses: 2 sigma, every minute without GPS"] if has_ellipses else [])
    for index, label in enumerate(labels):
        width = 44 + 6.6 * len(label)
        if x + width > WIDTH - MARGIN / 2 and x > MARGIN:
            x, y = float(MARGIN), y + 18.0
        if index < len(tracks):
            parts.append(_sample(tracks[index], x, y - 4))
        parts.append(svg.text(x + (26 if index < len(tracks) else 0), y, label, class_="legend"))
        x += width
    return "".join(parts)


def _sample(track: Track, x: float, y: float) -> str:
    """The mark of a track in the legend."""
    if track.dots:
        return svg.element("circle", cx=x + 10, cy=y, r=2.5, fill=track.colour)
    return svg.element("line", x1=x, x2=x + 20, y1=y, y2=y, stroke=track.colour, stroke_width=3, stroke_dasharray=track.dash)
