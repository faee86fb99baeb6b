"""The tables of a report."""

from collections.abc import Iterable, Sequence
from typing import Any

from lowcostnav_ros.gnss.accuracy import CATEGORIES_M
from lowcostnav_ros.replay.metrics import MAGNITUDES
from lowcostnav_ros.replay.tables import interval_kind, number, position_rows, presence, shares_within
from lowcostnav_ros.replay.words import error_over_sigma
from lowcostnav_ros.report.svg import escape

_PARTS = {"flight": "whole flight", "withheld_gps": "withheld fixes", "without_gps": "without GPS"}
_VERDICTS = {"warned": "warned in time", "brief": "over before an alarm was due", "missed": "not warned"}
_SIZES = {
    "horizontal_m": "horizontal [m]",
    "vertical_m": "vertical [m]",
    "velocity_mps": "velocity [m/s]",
    "roll_deg": "roll [deg]",
    "pitch_deg": "pitch [deg]",
    "heading_deg": "heading [deg]",
    "wind_mps": "wind [m/s]",
}


def table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """An HTML table; an empty string without rows."""
    rows = list(rows)
    if not rows:
        return ""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(f'<{tag} class="{"l" if k < left else "r"}">{escape(c)}</{tag}>' for k, c in enumerate(row))

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def errors(summary: dict[str, Any]) -> str:
    """Error sizes with their honesty: RMS, median, 95 %, maximum, error over sigma per axis."""
    rows = []
    for name, navigator in summary["navigators"].items():
        for part, words in _PARTS.items():
            found = navigator["errors"].get(part)
            for size, label in _SIZES.items() if found else ():
                if size in found:
                    s = found[size]
                    ratios = [number(found["error_over_sigma"].get(axis), 2) for axis in MAGNITUDES[size]]
                    sizes = [number(s[k]) for k in ("rms", "median", "p95", "max")]
                    rows.append((name, words, label, *sizes, f"{s['max_at_s']:.1f}", " ".join(ratios)))
    heads = ("navigator", "over", "error", "RMS", "median", "95 %", "max", "max at t [s]", "error/sigma per axis")
    return table("Errors, estimate minus reference", heads, rows, left=3)


def overview(summary: dict[str, Any]) -> str:
    """The errors at a glance: RMS and 95 % of every size, a row per navigator and part of the flight."""
    rows = []
    for name, navigator in summary["navigators"].items():
        for part, words in _PARTS.items():
            found = navigator["errors"].get(part)
            if found:
                sizes = [f"{number(found[s]['rms'])} / {number(found[s]['p95'])}" if s in found else "-" for s in _SIZES]
                ratio = error_over_sigma(found["error_over_sigma"])
                rows.append((name, words, *sizes, number(ratio, 2)))
    heads = ("navigator", "over", *_SIZES.values(), "error/sigma")
    return table("Errors, RMS / 95 %, estimate minus reference", heads, rows, left=2)


def intervals(summary: dict[str, Any]) -> str:
    """Outages and withheld windows with the error at their end."""
    rows = []
    for name, navigator in summary["navigators"].items():
        for what, found in (("without GPS", navigator["errors"]["outages"]), ("withheld", navigator["errors"]["windows"])):
            for i in (i for i in found if i["samples"]):
                start = summary["first_stamp_s"] if i["start_s"] is None else i["start_s"]
                end = [number(i["error_at_end"].get(axis)) for axis in ("north_m", "east_m", "down_m", "heading_deg")]
                times = (f"{start:.1f}", f"{i['end_s']:.1f}", f"{i['end_s'] - start:.0f}")
                rows.append((name, interval_kind(what, i), *times, number(i["worst_horizontal_m"]), number(i["worst_3d_m"]), *end))
    times = ("from t [s]", "to t [s]", "length [s]")
    heads = ("navigator", "what", *times, "worst horizontal [m]", "worst 3D [m]", "at end N [m]", "E [m]", "D [m]", "heading [deg]")
    return table("Outages and withheld windows", heads, rows, left=2)


def accuracy(summary: dict[str, Any]) -> str:
    """Position accuracy: mean and RMS north, east, up, in the plane and in space, and the largest errors."""
    rows = []
    for name, words, found in position_rows(summary, _PARTS):
        position = found["position"]
        axes = [number(position[kind][axis]) for kind in ("mean_m", "rms_m") for axis in ("north", "east", "up")]
        largest = [number(found[size]["max"]) for size in ("horizontal_m", "vertical_m", "position_m")]
        rows.append((name, words, *axes, number(position["rms_2d_m"]), number(position["rms_3d_m"]), *largest))
    heads = ("navigator", "over", "mean N", "E", "U", "RMS N", "E", "U", "2D RMS", "3D RMS", "max horizontal", "max vertical", "max 3D")
    return table("Position accuracy [m]", heads, rows, left=2)


def approaches(summary: dict[str, Any]) -> str:
    """Precision-approach categories: share of the errors within each, and which one the 95 % errors meet."""
    rows = []
    for name, words, found in position_rows(summary, _PARTS):
        there = presence(summary, name) if words == _PARTS["flight"] else "-"
        sizes = (number(found["horizontal_m"]["p95"]), number(found["vertical_m"]["p95"]))
        rows.append((name, words, there, *sizes, *shares_within(found, " / "), found["approach"]["met_by_95"] or "none"))
    limits = [f"category {name}: {h:g} m, {v:g} m" for name, (h, v) in reversed(CATEGORIES_M.items())]
    heads = ("navigator", "over", "position there [%]", "95 % horizontal [m]", "95 % vertical [m]", *limits, "95 % meet")
    return table("Precision approach: share of the errors within, horizontal / vertical / both [%]", heads, rows, left=2)


def alarms(summary: dict[str, Any]) -> str:
    """Alert limits of the services: passed how often, for how long, and whether the navigator's own sigmas warned in time."""
    rows = []
    for name, navigator in summary["navigators"].items():
        for service, found in navigator["errors"].get("services", {}).items():
            limits = f"{found['horizontal_limit_m']:g} m, {found['vertical_limit_m']:g} m, {found['time_to_alert_s']:g} s"
            counts = [str(found[k]) for k in ("exceedances", "warned", "brief", "missed")]
            times = [number(found[k]) for k in ("longest_s", "beyond_limit_s", "beyond_without_alert_s", "alert_s")]
            rows.append((name, service, limits, *counts, *times))
    counts = ("times passed", "warned in time", "over before an alarm was due", "not warned")
    times = ("longest [s]", "beyond [s]", "of it without alert [s]", "alert on [s]")
    heads = ("navigator", "service", "limits H, V, time to alert", *counts, *times)
    return table("Alert limits; the alert is the navigator's own, from its sigmas", heads, rows, left=3)


def exceedances(summary: dict[str, Any]) -> str:
    """Every stretch beyond an alert limit with the time its alarm was due and the time it came."""
    rows = []
    for name, navigator in summary["navigators"].items():
        for service, found in navigator["errors"].get("services", {}).items():
            for e in found["listed"]:
                alarm = "never" if e["alarm_s"] is None else f"{e['alarm_s']:.1f}"
                times = (f"{e['start_s']:.1f}", f"{e['end_s']:.1f}", f"{e['alarm_due_s']:.1f}", alarm)
                rows.append((name, service, *times, _VERDICTS[e["verdict"]]))
    heads = ("navigator", "service", "from t [s]", "to t [s]", "alarm due by t [s]", "alert since t [s]", "")
    return table("Times beyond an alert limit", heads, rows, left=2)


def inputs(summary: dict[str, Any]) -> str:
    """What each navigator received and refused at its door, and what the decoder refused."""
    rows = [
        ("recording", source, "", str(entry["count"]), _reasons(entry["rejected"])) for source, entry in summary.get("inputs", {}).items()
    ]
    for name, navigator in summary["navigators"].items():
        for source, entry in navigator["inputs"].items():
            rows.append((name, source, "required" if entry["required"] else "", str(entry["received"]), _reasons(entry["rejected"])))
    return table("Inputs", ("at", "source", "", "messages or samples", "rejected"), rows, left=3)


def aids(summary: dict[str, Any]) -> str:
    """Use of the aids: NIS per degree of freedom near 1 says that the predicted innovations are honest."""
    rows = []
    for name, navigator in summary["navigators"].items():
        for aid, entry in navigator["aids"].items():
            rms = ", ".join(f"{label} {number(value)}" for label, value in entry.get("innovation_rms", {}).items())
            rows.append((name, aid, str(entry["used"]), number(entry.get("nis_per_dof")), rms, _reasons(entry["not_used_or_limited"])))
    heads = ("navigator", "aid", "used", "NIS per degree of freedom", "RMS innovation", "not used, or limited")
    return table("Aids", heads, rows, left=2)


def runs(summary: dict[str, Any]) -> str:
    """Fused solutions, their fingerprint, the comparison with the recording, speed."""
    rows = []
    for name, navigator in summary["navigators"].items():
        fused = navigator["fused"]
        same = {None: "not recorded", True: f"equal, {fused['count_equal']} of {fused['count_recorded']}"}
        first = fused["first_differing_stamp_s"]
        recorded = same.get(fused["equals_recorded"], f"differs from t = {first} s, {fused['count_equal']} equal")
        factor = summary["time"]["real_time_factor_by_navigator"].get(name)
        nees = next((e["nees_horizontal"] for p in _PARTS if (e := navigator["errors"].get(p))), None)
        sha = (fused["sha256"] or "-")[:16]
        numbers = (str(navigator["solutions"]), number(nees), f"{factor:.0f}" if factor else "-")
        rows.append((name, navigator["mode_at_end"], recorded, sha, *numbers))
    outcome = ("mode at end", "as recorded in flight", "sha256 of fused output")
    heads = ("navigator", *outcome, "solutions", "horizontal NEES (2 expected)", "x real time")
    return table("Fused solutions", heads, rows, left=4)


def _reasons(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} \N{MULTIPLICATION SIGN} {reason}" for reason, count in counts.items()) or "-"
