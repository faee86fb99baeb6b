"""Drawings of satellite geometry, canyon and computational load."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from lowcostnav_ros.gnss.canyon import Canyon, Level
from lowcostnav_ros.gnss.constellation import Constellation
from lowcostnav_ros.gnss.dop import Dops
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight
from lowcostnav_ros.physics.earth import geodetic_to_ecef
from lowcostnav_ros.reproduce.figures import SMALL, axes, legend

NAMES = ("gdop", "pdop", "hdop", "vdop", "tdop")


def budget(figure: Any, entries: Mapping[str, float], total_m: float) -> None:
    """Bars of the error sources and their sum."""
    figure.set_size_inches(6.5, 3.8)
    made = axes(figure, x="1-sigma range error [m]", y="")
    labels = [*entries, "all together"]
    made.barh(labels[::-1], [*entries.values(), total_m][::-1], color=["tab:orange", *["tab:blue"] * len(entries)])
    figure.tight_layout()


def elevation(figure: Any, compute: Callable[[float, bool], Dops], correlated: bool, low: int, high: int) -> None:
    """Dilutions over the elevation of the lower satellites."""
    made = axes(figure, x="elevation of the lower three [deg]", y="effective DOP" if correlated else "DOP")
    degrees = np.linspace(low, high, 141)
    values = [compute(float(d), correlated) for d in degrees]
    for name in NAMES:
        made.plot(degrees, [getattr(v, name) for v in values], label=name.upper())
    made.set_ylim(0.0, 12.0)
    legend(made, loc="upper left")


def availability(figure: Any, times: np.ndarray, counts: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    """Number of satellites and dilutions over ten minutes."""
    figure.set_size_inches(10.0, 4.0)
    number = axes(figure, (1, 2, 1), x="time [min]", y="satellites used")
    number.step(times / 60.0, counts, where="post")
    number.set_ylim(0, 10)
    made = axes(figure, (1, 2, 2), x="time [min]", y="DOP")
    for name, values in columns.items():
        made.step(times / 60.0, values, where="post", label=name.upper())
    made.set_ylim(bottom=0.0)
    legend(made, ncols=2, loc="upper left")


def sky(figure: Any, canyon: Canyon, constellation: Constellation) -> None:
    """Sky with the satellites and the edge of the cliffs from several heights."""
    figure.set_size_inches(5.4, 5.4)
    made = figure.add_subplot(projection="polar")
    made.set_theta_zero_location("N")
    made.set_theta_direction(-1)
    place = geodetic_to_ecef(canyon.lat, canyon.lon, canyon.cliff_m)
    azimuth, elev = azimuth_elevation(canyon.lat, canyon.lon, line_of_sight(place, constellation.states(0.0)[0])[1])
    up = elev >= 0.0
    made.plot(azimuth[up], 90.0 - np.degrees(elev[up]), "o", color="tab:blue")
    for sat, a, e in zip(constellation.sat_id[up], azimuth[up], elev[up], strict=True):
        made.annotate(str(sat), (a, 90.0 - np.degrees(e)), xytext=(4, 4), textcoords="offset points", fontsize=SMALL)
    around = np.linspace(0.0, 2.0 * np.pi, 181)
    for height in (0.0, 400.0, 600.0, 800.0, 900.0):
        radius = 90.0 - np.degrees(canyon.mask(height))
        made.plot(around, np.full_like(around, radius), "k-", lw=0.7)
        made.annotate(f"{height:.0f} m", (np.radians(262.0), radius), fontsize=SMALL)
    made.set_rlim(0.0, 90.0)
    made.set_rticks([0, 30, 60, 90], labels=["90", "60", "30", "0"], fontsize=SMALL)
    made.set_title("sky at the cliff tops, open sky from lower down", fontsize=9)


def canyon_dops(figure: Any, levels: Sequence[Level]) -> None:
    """Dilutions over the height in the canyon."""
    made = axes(figure, x="height [m]", y="DOP")
    finite = [level for level in levels if np.isfinite(level.dops.gdop)]
    for name in NAMES:
        made.step([level.height_m for level in finite], [getattr(level.dops, name) for level in finite], where="post", label=name.upper())
    made.set_ylim(bottom=0.0)
    legend(made)


def counts(figure: Any, heights: np.ndarray, seen: Mapping[int, Sequence[int]]) -> None:
    """Satellites in view over height, by longitude."""
    made = axes(figure, x="height [m]", y="satellites in view")
    for lon, numbers in seen.items():
        made.step(heights, numbers, where="post", label=f"{lon} deg")
    made.axhline(4, color="k", lw=0.8, ls="--")
    legend(made, title="longitude", title_fontsize=SMALL, loc="upper left")


def load(figure: Any, counted: Mapping[str, Sequence[int]], chosen: str) -> None:
    """Operations a cycle over the number of satellites, the chosen filter thick."""
    made = axes(figure, x="satellites", y="operations in a cycle")
    first = {"PV": 4, "PVA": 4, "LC": 4, "TC": 1}
    for name, values in counted.items():
        flat = list(values) * (6 if name == "LC" else 1)
        made.plot(np.arange(first[name], first[name] + len(flat)), flat, "o-", lw=2.5 if name == chosen else 0.8, ms=4, label=name)
    made.set_yscale("log")
    legend(made)


def load_ratios(figure: Any, satellites: np.ndarray, ratios: Sequence[np.ndarray]) -> None:
    """Extra load over the number of satellites."""
    made = axes(figure, x="satellites", y="extra operations [%]")
    for values, name in zip(ratios, ("loose+PVA over loose+PV", "tight over loose+PVA", "tight over loose+PV"), strict=True):
        made.plot(satellites, values, "o-", ms=4, label=name)
    made.set_ylim(bottom=0.0)
    legend(made)
