"""A plan of ground transmitters: dilutions over an area at a height, and where the next transmitter helps most."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.network import Dilution, best_next, dilutions, places_of
from lowcostnav_ros.radionav.stations import Station
from lowcostnav_ros.radionav.transmitters import BEACON
from lowcostnav_ros.replay.result import Place
from lowcostnav_ros.report.map_chart import Cells, map_chart
from lowcostnav_ros.report.plan_folder import finite
from lowcostnav_ros.report.svg import escape
from lowcostnav_ros.report.terminal import Told

DOPS = ("hdop", "vdop", "pdop")
LEVELS = (1.5, 2.0, 3.0, 4.0, 6.0, 10.0)
COLOURS = ("#1a9850", "#66bd63", "#a6d96a", "#fee08b", "#fdae61", "#f46d43", "#7f2704")
GRID, COARSE = 31, 9
"""Points of the map, and of the places where a next transmitter is tried, along each side."""


@dataclass(frozen=True, slots=True, eq=False)
class TransmitterPlan:
    """Dilutions ``found`` (GRID * GRID) over the offsets (GRID,) m north and east of ``centre`` (rad, rad) at ``height`` m.

    ``places`` (n, 3) are the transmitters, m NED; ``site`` that of the next transmitter with the PDOP it leads to; ``limit`` a good PDOP.
    """

    stations: Sequence[Station]
    centre: tuple[float, float]
    height: float
    offsets_m: np.ndarray
    places: np.ndarray
    found: list[Dilution]
    site: Station
    pdop_now: float
    site_pdop: float
    limit: float

    def map_of(self, name: str) -> np.ndarray:
        """One dilution over the area (GRID, GRID), north by east."""
        return np.array([getattr(d, name) for d in self.found]).reshape(GRID, GRID)

    def good_enough(self) -> bool:
        """Whether the PDOP is within the limit everywhere."""
        return bool(np.all(self.map_of("pdop") <= self.limit))


def plan_transmitters(stations: Sequence[Station], height: float, half_width_m: float, limit: float) -> TransmitterPlan:
    """Work out a plan over a square about the middle of the stations, which all are pseudolites or all beacons."""
    lat, lon = float(np.mean([s.lat for s in stations])), float(np.mean([s.lon for s in stations]))
    ground = float(np.median([s.height for s in stations]))
    frame = LocalFrame(lat, lon, ground)
    places, clock = places_of(stations, frame), stations[0].kind != BEACON
    offsets, coarse = (np.linspace(-half_width_m, half_width_m, n) for n in (GRID, COARSE))
    reach = np.array([s.reach_m for s in stations])

    def square(sides: np.ndarray, down: float) -> np.ndarray:
        return np.array([[n, e, down] for n in sides for e in sides])

    found = dilutions(square(offsets, ground - height), places, reach, clock)
    sites = square(coarse, 0.0)
    apart = np.linalg.norm(sites[:, None, :] - places[None, :, :], axis=2).min(axis=1)
    sites = sites[apart > 0.02 * half_width_m]
    above = square(coarse, ground - height)
    best, pdop = best_next(above, places, sites, clock)
    now = np.array([d.pdop for d in dilutions(above, places, clock=clock)])
    now_rms = float(np.sqrt(np.mean(now[np.isfinite(now)] ** 2))) if np.isfinite(now).any() else math.inf
    at = frame.from_ned(sites[best])
    site = Station("NEXT", "best next", float(at[0]), float(at[1]), float(at[2]), float(at[2]), "", "", stations[0].kind)
    return TransmitterPlan(stations, (lat, lon), height, offsets, places, found, site, now_rms, pdop, limit)


def as_mapping(plan: TransmitterPlan) -> dict[str, Any]:
    """The plan as plain values."""
    return {
        "centre_deg": np.degrees(plan.centre).tolist(),
        "height_m": plan.height,
        "transmitters": [s.ident for s in plan.stations],
        "offsets_m": plan.offsets_m.tolist(),
        "best_next_deg": np.degrees([plan.site.lat, plan.site.lon]).tolist(),
        "best_next_pdop": finite(plan.site_pdop),
        **{name: [[finite(v) for v in row] for row in plan.map_of(name)] for name in DOPS},
    }


def told(plan: TransmitterPlan) -> Told:
    """Tell the dilutions and where the next transmitter helps."""
    middle = plan.found[len(plan.found) // 2]
    rows = []
    for name in DOPS:
        values = plan.map_of(name)
        solved = values[np.isfinite(values)]
        over = [f"{np.percentile(solved, p):.2f}" for p in (50, 95)] if solved.size else ["-", "-"]
        rows.append((name.upper(), f"{getattr(middle, name):.2f}", *over, f"{100.0 * np.mean(values <= plan.limit):.0f}"))
    half_km = plan.offsets_m[-1] / 1e3
    title = f"{len(plan.stations)} transmitters, {2 * half_km:g} km square at {plan.height:g} m"
    columns = ("dilution", "middle", "median", "95 %", f"% within {plan.limit:g}")
    good = float(np.mean(plan.map_of("pdop") <= plan.limit))
    where = "everywhere" if plan.good_enough() else f"over {100.0 * good:.0f} % of the area"
    sentences = [f"A PDOP of {plan.limit:g} or better {where}."]
    without = float(np.mean(~np.isfinite(plan.map_of("pdop"))))
    if without:
        sentences.append(f"No position over {100.0 * without:.0f} % of the area: too few transmitters are received there.")
    lat, lon = np.degrees([plan.site.lat, plan.site.lon])
    where = f"{lat:.4f}, {lon:.4f} at {plan.site.height:.0f} m"
    sentences.append(f"The next transmitter helps most at {where}: RMS PDOP {plan.pdop_now:.2f} becomes {plan.site_pdop:.2f}.")
    return title, (Table.plain("Dilutions", columns, rows),), sentences


def drawings(plan: TransmitterPlan) -> list[str]:
    """HDOP, VDOP and PDOP over the area, the transmitters and the best next one."""
    pins = [Place(s.ident, math.degrees(s.lat), math.degrees(s.lon)) for s in (*plan.stations, plan.site)]
    words = [*(f"to {v:g}" for v in LEVELS), f"above {LEVELS[-1]:g}"]
    drawn = []
    for name in DOPS:
        values = plan.map_of(name)
        classes = np.where(np.isfinite(values), np.searchsorted(LEVELS, np.nan_to_num(values)), -1)
        cells = Cells(plan.offsets_m, plan.offsets_m, classes, COLOURS, words, LocalFrame(*plan.centre))
        title = f"{name.upper()} at {plan.height:g} m; {plan.site.ident}: where the next transmitter helps most; clear: no position"
        drawn.append(f'<p class="note"><b>{escape(title)}</b></p>{map_chart([], pins, cells=cells)}')
    return drawn
