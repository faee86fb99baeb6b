"""A DME plan as tables on the terminal and as JSON."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.radionav.benchmarks_vor import REQUIREMENT_M
from lowcostnav_ros.radionav.geometry import hdop
from lowcostnav_ros.radionav.layouts import NOISE_M
from lowcostnav_ros.radionav.plan import Point, pair_changes
from lowcostnav_ros.radionav.selection import best_pair, usable, view
from lowcostnav_ros.report.dme.plan import Leg, Level, Plan
from lowcostnav_ros.report.plan_folder import finite
from lowcostnav_ros.report.terminal import Told

BIAS_M = 0.17 * NAUTICAL_MILE
SCHEDULE_S = 120.0


def told(plan: Plan) -> Told:
    """Tell coverage, expected error, stations asked, schedule and what is wrong."""
    rows = []
    for level in plan.levels:
        shares = "/".join(f"{100.0 * level.coverage.share(n):.0f}" for n in (1, 2, 3))
        for k, leg in enumerate(level.legs):
            first = (f"{level.altitude_m:.0f} m", shares) if k == 0 else ("", "")
            rows.append((*first, leg.name, f"{100.0 * leg.paired:.0f} %", _metres(leg.worst_m), f"{leg.arrival_m:.0f} m"))
    heads = ("altitude", "area % with 1/2/3", "way flown", "with a pair", "worst 1-sigma", "on arrival")
    table = Table.plain("Expected error without GPS, one receiver, a range every 15 s", heads, rows, left=3)
    lines = (*_verdict(plan), *_asked(plan), _schedule_line(plan), *plan.notes)
    return f"{len(plan.table)} stations in the area", (table,), lines


def _metres(value: float) -> str:
    return f"{value:.0f} m" + ("" if value <= REQUIREMENT_M else " > 0.5 NM")


def _asked(plan: Plan) -> list[str]:
    """Stations asked and what is wrong, one paragraph per way; altitudes with the same answer share it."""
    answers: dict[tuple[str, ...], list[str]] = {}
    for level in plan.levels:
        for leg in level.legs:
            changes = pair_changes(leg.points)
            asked = ", ".join(f"{a / NAUTICAL_MILE:.0f}-{b / NAUTICAL_MILE:.0f} NM {'-'.join(p) or 'none'}" for a, b, p in changes)
            key = (f"{leg.name}: ask {asked}", *(f"  {sentence}" for sentence in leg.sentences))
            answers.setdefault(key, []).append(f"{level.altitude_m:.0f}")
    return [line for key, at in answers.items() for line in (f"{', '.join(at)} m, {key[0]}", *key[1:])]


def _schedule_line(plan: Plan) -> str:
    highest = plan.levels[-1].legs[0]
    replies = [f"{r.time_s:.0f} s {r.station}" for r in highest.replies if r.time_s <= SCHEDULE_S]
    return f"schedule ({highest.name}, {plan.levels[-1].altitude_m:.0f} m), replies: {', '.join(replies) or 'none'} ..."


def _verdict(plan: Plan) -> list[str]:
    verdict = "stays within" if plan.good_enough() else "exceeds"
    place = "at one altitude or more" if plan.good_enough() else "at every altitude"
    return [
        f"The expected 1-sigma error {verdict} 0.5 NM {place}.",
        "Line of sight over a smooth earth; hills are not in it. Not a substitute for published coverage.",
    ]


def as_mapping(plan: Plan) -> dict[str, Any]:
    """Return the plan as plain values, fit for JSON; angles in degrees, None where a number does not exist."""
    return {
        "waypoints_deg": [[_degrees(lat), _degrees(lon)] for lat, lon in plan.waypoints],
        "stations": [
            {
                "ident": s.ident, "name": s.name, "lat_deg": _degrees(s.lat), "lon_deg": _degrees(s.lon),
                "elevation_m": round(s.elevation, 1), "channel": s.channel, "service_volume": s.service_volume,
            }
            for s in plan.table
        ],
        "schedule": {"scheme": plan.schedule.scheme, "interval_s": plan.schedule.interval_s},
        "requirement_m": REQUIREMENT_M,
        "good_enough": plan.good_enough(),
        "levels": [_level(plan, level) for level in plan.levels],
        "notes": plan.notes,
    }  # fmt: skip


def _level(plan: Plan, level: Level) -> dict[str, Any]:
    shares = {f"at_least_{n}": round(level.coverage.share(n), 4) for n in (1, 2, 3)}
    out = {"altitude_m": level.altitude_m, "area_share": shares, "legs": [_leg(leg) for leg in level.legs]}
    if len(plan.waypoints) == 1:
        out["at_airport"] = _at_airport(plan, level)
    return out


def _at_airport(plan: Plan, level: Level) -> dict[str, Any]:
    """What is received over the airport: the stations with range and bearing, and the accuracy of a fix by the best pair."""
    place = (*plan.waypoints[0], level.altitude_m)
    seen = usable(plan.table, *place)
    pair = best_pair(plan.table, *place) or ()
    dilution = hdop(np.array([view(s, *place).direction_n for s in pair])) if pair else math.inf
    return {
        "stations": [
            {
                "ident": v.station.ident,
                "range_nm": round(v.range_m / NAUTICAL_MILE, 2),
                "bearing_deg": round(math.degrees(math.atan2(-v.direction_n[1], -v.direction_n[0])) % 360.0, 1),
            }
            for v in seen
        ],
        "pair": [s.ident for s in pair],
        "hdop": finite(dilution),
        "fix_1_sigma_noise_m": finite(dilution * NOISE_M),
        "fix_1_sigma_with_bias_m": finite(dilution * math.hypot(BIAS_M, NOISE_M)),
    }


def _leg(leg: Leg) -> dict[str, Any]:
    estimated = np.sqrt(np.trace(leg.sigma.estimated, axis1=1, axis2=2))
    every = slice(None, None, max(1, len(estimated) // 400))
    return {
        "name": leg.name,
        "length_m": round(float(leg.route.time_s[-1] * leg.route.speed), 1),
        "worst_1_sigma_m": round(leg.worst_m, 1),
        "arrival_1_sigma_m": round(leg.arrival_m, 1),
        "share_with_pair": round(leg.paired, 4),
        "sentences": leg.sentences,
        "stations_asked": [{"from_m": a, "to_m": b, "stations": list(pair)} for a, b, pair in pair_changes(leg.points)],
        "points": [_point(p) for p in leg.points],
        "schedule": [{"time_s": r.time_s, "station": r.station} for r in leg.replies],
        "expected": {
            "time_s": np.round(leg.sigma.time_s[every], 2).tolist(),
            "horizontal_1_sigma_m": np.round(leg.sigma.horizontal()[every], 1).tolist(),
            "believed_by_navigator_m": np.round(estimated[every], 1).tolist(),
        },
    }


def _point(point: Point) -> dict[str, Any]:
    return {
        "distance_m": round(point.distance_m, 1),
        "lat_deg": _degrees(point.lat),
        "lon_deg": _degrees(point.lon),
        "usable": list(point.usable),
        "pair": list(point.pair or ()),
        "gamma_deg": round(math.degrees(point.gamma), 1),
        "hdop": finite(point.hdop),
        "collinear": point.collinear,
    }


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 6)
