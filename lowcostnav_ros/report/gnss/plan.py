"""A plan of satellites in view as tables on the terminal and as JSON."""

import datetime
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.gnss.sky_plan import Lowest, SkyPlan, Window
from lowcostnav_ros.report.gnss.words import SPREAD, spread
from lowcostnav_ros.report.plan_folder import finite
from lowcostnav_ros.report.terminal import Told

DOPS = ("gdop", "pdop", "hdop", "vdop", "tdop")
MOST_WINDOWS = 8


@dataclass(frozen=True, slots=True, eq=False)
class GnssPlan:
    """A plan with what it is for.

    Attributes
    ----------
    sky : SkyPlan
    title, view : str
        Constellation and place; what hides the sky.
    start : datetime.datetime
        UTC.
    pdop_limit : float
        PDOP above which a position counts as not good enough.
    lowest : callable
        Lowest visible elevation, rad, by azimuth, rad.
    notes : list of str
    """

    sky: SkyPlan
    title: str
    view: str
    start: datetime.datetime
    pdop_limit: float
    lowest: Lowest
    notes: list[str]

    @property
    def windows(self) -> list[Window]:
        """Stretches without a good position, longest first."""
        return self.sky.windows(self.pdop_limit)

    def good_enough(self) -> bool:
        """Whether the position is good all the time."""
        return not self.windows

    def clock(self, time_s: float) -> str:
        """Time of day, with the days since the start where they are not zero."""
        moment = self.start + datetime.timedelta(seconds=float(time_s))
        days = (moment.date() - self.start.date()).days
        return f"{moment:%H:%M}" + (f" +{days} d" if days else "")


def told(plan: GnssPlan) -> Told:
    """Tell the spread over all hours, a row per hour, and the windows without a good position."""
    rows = [("satellites in view", *spread(plan.sky.counts, 0)), *((dop.upper(), *spread(plan.sky.column(dop), 2)) for dop in DOPS)]
    rows += [(f"{dop.upper()}, effective", *spread(plan.sky.column(dop, effective=True), 2)) for dop in DOPS]
    overall = Table.plain("over all hours", ("", *SPREAD), rows)
    heads = ("from", "satellites", "HDOP median/worst", "VDOP", "PDOP", f"PDOP above {plan.pdop_limit:g} or none")
    hourly = Table.plain(f"by the hour, UTC, from {plan.start:%Y-%m-%d %H:%M}", heads, hour_rows(plan))
    return f"{plan.title}, {plan.view}", (overall, hourly), (*sentences(plan), *plan.notes)


def hour_rows(plan: GnssPlan) -> list[tuple[str, ...]]:
    """One row for each hour that has begun: fewest to most satellites, dilutions, minutes without a good position."""
    sky, rows = plan.sky, []
    hour = (sky.time_s // 3600.0).astype(int)
    if len(hour) > 1:
        hour[-1] = -1  # the end of the last hour begins no other
    for k in np.unique(hour[hour >= 0]):
        inside = hour == k
        counts, poor = sky.counts[inside], ~(sky.column("pdop")[inside] <= plan.pdop_limit)
        minutes = np.count_nonzero(poor) * sky.step_s / 60.0
        dilutions = [_middle_and_worst(sky.column(dop)[inside]) for dop in ("hdop", "vdop", "pdop")]
        seen = f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()}-{counts.max()}"
        rows.append((plan.clock(3600.0 * k), seen, *dilutions, f"{minutes:.0f} min" if minutes else "-"))
    return rows


def _middle_and_worst(values: np.ndarray) -> str:
    ordered = np.sort(values)
    return "/".join(f"{v:.1f}" if math.isfinite(v) else "none" for v in (ordered[(len(ordered) - 1) // 2], ordered[-1]))


def sentences(plan: GnssPlan) -> list[str]:
    """The windows without a good position, longest first, or that there are none and when it is worst."""
    sky, windows = plan.sky, plan.windows
    if not windows:
        worst = int(np.argmax(sky.column("pdop")))
        at = f"{plan.clock(sky.time_s[worst])} ({sky.counts[worst]} satellites, PDOP {sky.column('pdop')[worst]:.1f})"
        return [f"A position with a PDOP of {plan.pdop_limit:g} or better all the time; it is worst at {at}."]
    lost_s = sum(window.end_s - window.start_s for window in windows)
    share = 100.0 * lost_s / max(sky.time_s[-1], 1.0)
    lines = [f"No good position (PDOP above {plan.pdop_limit:g} or fewer than four satellites) for {lost_s / 60.0:.0f} min, {share:.0f} %:"]
    lines += [f"  {plan.clock(w.start_s)} to {plan.clock(w.end_s)}: {_why(w)}" for w in windows[:MOST_WINDOWS]]
    if len(windows) > MOST_WINDOWS:
        lines.append(f"  ... and {len(windows) - MOST_WINDOWS} shorter ones.")
    return lines


def _why(window: Window) -> str:
    if window.fewest < 4:
        return f"down to {window.fewest} satellite{'' if window.fewest == 1 else 's'}."
    worst = f"PDOP up to {window.worst_pdop:.1f}" if math.isfinite(window.worst_pdop) else "lines of sight on one cone"
    return f"{worst} with {window.fewest} satellites."


def as_mapping(plan: GnssPlan) -> dict[str, Any]:
    """Return the plan as plain values, fit for JSON; angles in degrees, None where a number does not exist."""
    sky = plan.sky
    times = []
    for k, t_s in enumerate(sky.time_s):
        seen = [
            {"name": sky.names[j], "azimuth_deg": _degrees(sky.azimuth[k, j]), "elevation_deg": _degrees(sky.elevation[k, j])}
            for j in np.flatnonzero(sky.visible[k])
        ]
        errors = {dop: finite(getattr(sky.effective[k], dop)) for dop in DOPS}
        plain = {dop: finite(getattr(sky.dops[k], dop)) for dop in DOPS}
        times.append({"time_s": float(t_s), **plain, "effective": errors, "satellites": seen})
    return {
        "title": plan.title,
        "view": plan.view,
        "start_utc": plan.start.isoformat(),
        "pdop_limit": plan.pdop_limit,
        "good_enough": plan.good_enough(),
        "windows": [
            {"from_s": w.start_s, "to_s": w.end_s, "fewest_satellites": w.fewest, "worst_pdop": finite(w.worst_pdop)} for w in plan.windows
        ],
        "times": times,
        "notes": plan.notes,
    }


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 2)
