"""A replay's result as tables that fit 100 columns of a terminal."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from lowcostnav_ros.gnss.accuracy import CATEGORIES_M
from lowcostnav_ros.replay.baseline import WORSE, Verdict
from lowcostnav_ros.replay.words import sentence

WIDTH = 100
_SIZES = (
    ("horizontal_m", "rms"),
    ("horizontal_m", "p95"),
    ("horizontal_m", "max"),
    ("vertical_m", "rms"),
    ("velocity_mps", "rms"),
    ("roll_deg", "rms"),
    ("pitch_deg", "rms"),
    ("heading_deg", "rms"),
    ("wind_mps", "rms"),
)
_SIZE_HEADS = ("horiz\nRMS m", "\n95 % m", "\nmax m", "vert\nRMS m", "vel\nRMS m/s", "roll\ndeg", "pitch\ndeg", "hdg\ndeg", "wind\nm/s")
_PARTS = {"flight": "flight", "withheld_gps": "withheld", "without_gps": "no GPS"}


def number(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, never in exponents; a dash for none."""
    if value is None:
        return "-"
    whole = len(str(int(abs(value)))) if abs(value) >= 1.0 else 1
    return f"{value:.{max(0, digits - whole)}f}"


def print_summary(summary: Mapping[str, Any], console: Console) -> None:
    """Print what was replayed, the errors, what they are good for, the outages, the aids and the speed."""
    _print_head(summary, console)
    requirements = (accuracy_table(summary), approach_table(summary), alarm_table(summary))
    rest = (interval_table(summary), aid_table(summary), integrity_table(summary), run_table(summary))
    for table in (error_table(summary), *requirements, *rest):
        if table.row_count:
            console.print(table)
            console.print()
    for text in integrity_sentences(summary):
        console.print(text, highlight=False)
    for name, navigator in summary["navigators"].items():
        console.print(sentence(name, navigator, summary["without_gps"]["total_s"]), highlight=False)


def _print_head(summary: Mapping[str, Any], console: Console) -> None:
    bag = summary.get("bag")
    if bag:
        console.print(f"[bold]{bag['name']}[/bold]  sha256 {bag['sha256'][:16]}", highlight=False)
    span = f"stamps {summary['first_stamp_s']:.3f} to {summary['last_stamp_s']:.3f} s"
    console.print(f"{summary['duration_s']:.1f} s, {span}, settings {summary['settings_hash']}", highlight=False)
    lost = summary["without_gps"]["total_s"]
    if lost > 0.0:
        console.print(f"without GPS for {lost:.0f} s in {len(summary['without_gps']['intervals_s'])} outage(s)", highlight=False)
    for text in summary["withheld"]:
        console.print(text, highlight=False)
    for name, reason in summary.get("left_out", {}).items():
        console.print(f"{name} left out: {reason}", highlight=False)
    for source, entry in summary.get("inputs", {}).items():
        if entry["rejected"]:
            reasons = ", ".join(f"{count} {reason}" for reason, count in entry["rejected"].items())
            console.print(f"[yellow]{source}: of {entry['count']} messages rejected: {reasons}[/yellow]", highlight=False)
    for phrase, count in summary.get("assumed", {}).items():
        console.print(f"{phrase} ({count} times)", highlight=False)
    console.print()


def _table(title: str, heads: Sequence[str], left: int) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k < left else "right", no_wrap=True)
    return table


def error_table(summary: Mapping[str, Any]) -> Table:
    """Errors against the reference: a row per navigator and part of the flight."""
    table = _table("Errors (estimate minus reference)", ("navigator", "over", *_SIZE_HEADS, "err/sigma\nN E"), left=2)
    for name, navigator in summary["navigators"].items():
        for part, words in _PARTS.items():
            errors = navigator["errors"].get(part)
            if errors:
                sizes = [number((errors.get(size) or {}).get(statistic)) for size, statistic in _SIZES]
                ratios = errors["error_over_sigma"]
                ratio = f"{number(ratios.get('north_m'), 2)} {number(ratios.get('east_m'), 2)}"
                table.add_row(name, words, *sizes, ratio)
    return table


def position_rows(summary: Mapping[str, Any], parts: Mapping[str, str] = _PARTS) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Navigator, part of the flight in words and errors, where a position was compared."""
    for name, navigator in summary["navigators"].items():
        for part, words in parts.items():
            errors = navigator["errors"].get(part)
            if errors and "position" in errors:
                yield name, words, errors


def accuracy_table(summary: Mapping[str, Any]) -> Table:
    """Position accuracy: mean and RMS north, east, up, in the plane and in space, and the largest errors."""
    heads = ("navigator", "over", "mean N\nm", "\nE", "\nU", "RMS N\nm", "\nE", "\nU", "2D\nRMS m", "3D\nRMS m", "3D\nmax m")
    table = _table("Position accuracy", heads, left=2)
    for name, words, errors in position_rows(summary):
        position = errors["position"]
        axes = [number(position[kind][axis]) for kind in ("mean_m", "rms_m") for axis in ("north", "east", "up")]
        table.add_row(name, words, *axes, number(position["rms_2d_m"]), number(position["rms_3d_m"]), number(errors["position_m"]["max"]))
    return table


def approach_table(summary: Mapping[str, Any]) -> Table:
    """Precision-approach categories: share of the errors within each, and which one the 95 % errors meet."""
    limits = [f"cat {name}\n{h:g} m, {v:g} m" for name, (h, v) in reversed(CATEGORIES_M.items())]
    heads = ("navigator", "over", "there\n%", "95 % H\nm", "V\nm", *limits, "95 %\nmeet")
    table = _table("Precision approach: share within, horizontal / vertical / both", heads, left=2)
    for name, words, errors in position_rows(summary):
        there = presence(summary, name) if words == _PARTS["flight"] else "-"
        sizes = (number(errors["horizontal_m"]["p95"]), number(errors["vertical_m"]["p95"]))
        table.add_row(name, words, there, *sizes, *shares_within(errors), errors["approach"]["met_by_95"] or "none")
    return table


def alarm_table(summary: Mapping[str, Any]) -> Table:
    """Alert limits of the services: how often and how long passed, and whether the navigator's own sigmas warned in time."""
    counts = ("warned\nin time", "over before\ndue", "not\nwarned")
    heads = ("navigator", "service", "limits H V m\nwithin s", "passed", "longest\ns", *counts, "alert on\ns")
    table = _table("Alert limits (alert: by the navigator's own sigmas)", heads, left=2)
    for name, navigator in summary["navigators"].items():
        for service, found in navigator["errors"].get("services", {}).items():
            limits = f"{found['horizontal_limit_m']:g} {found['vertical_limit_m']:g} in {found['time_to_alert_s']:g}"
            counts = [str(found[k]) for k in ("warned", "brief", "missed")]
            table.add_row(name, service, limits, str(found["exceedances"]), number(found["longest_s"]), *counts, number(found["alert_s"]))
    return table


def presence(summary: Mapping[str, Any], name: str) -> str:
    """Per cent of the flight through which a navigator gave a position."""
    return percent(min(1.0, summary["navigators"][name]["errors"]["position_present_s"] / max(summary["duration_s"], 1e-9)))


def shares_within(errors: Mapping[str, Any], between: str = "/") -> list[str]:
    """Shares within each approach category, per cent: horizontal, vertical, both."""
    return [between.join(percent(share) for share in shares.values()) for shares in errors["approach"]["share_within"].values()]


def percent(share: float) -> str:
    """A share in per cent; 100 and 0 only where it is all and nothing."""
    if 0.0 < share < 1.0:
        return f"{min(99.9, max(0.1, 100.0 * share)):.3g}"
    return f"{100.0 * share:.0f}"


def interval_kind(what: str, interval: Mapping[str, Any]) -> str:
    """What an interval was: withheld, without GPS, or the satellites that were left."""
    left = interval.get("satellites")
    return what if left is None else f"{left} satellite{'' if left == 1 else 's'}"


def interval_table(summary: Mapping[str, Any]) -> Table:
    """Outages and withheld windows: worst error and the error at the end."""
    heads = ("navigator", "s from start", "what", "worst horiz m", "3D m", "at end N m", "E m", "D m", "hdg deg")
    table = _table("Outages and withheld windows", heads, left=3)
    for name, navigator in summary["navigators"].items():
        errors = navigator["errors"]
        for what, intervals in (("without GPS", errors["outages"]), ("withheld", errors["windows"])):
            for interval in (i for i in intervals if i["samples"]):
                zero = summary["first_stamp_s"]
                start = 0.0 if interval["start_s"] is None else interval["start_s"] - zero
                end = interval["error_at_end"]
                cells = [number(end.get(axis)) for axis in ("north_m", "east_m", "down_m", "heading_deg")]
                worst = (number(interval["worst_horizontal_m"]), number(interval["worst_3d_m"]))
                table.add_row(name, f"{start:.1f}-{interval['end_s'] - zero:.1f}", interval_kind(what, interval), *worst, *cells)
    return table


def aid_table(summary: Mapping[str, Any]) -> Table:
    """Innovations: used, not used and why, NIS per degree of freedom."""
    table = _table("Aids", ("navigator", "aid", "used", "NIS/dof", "not used, or limited"), left=2)
    table.columns[-1].justify, table.columns[-1].no_wrap = "left", False
    for name, navigator in summary["navigators"].items():
        for aid, entry in navigator["aids"].items():
            reasons = ", ".join(f"{count} {reason}" for reason, count in entry["not_used_or_limited"].items())
            table.add_row(name, aid, str(entry["used"]), number(entry.get("nis_per_dof")), reasons or "-")
    return table


def integrity_table(summary: Mapping[str, Any]) -> Table:
    """Integrity of those who test their satellites: share of time per verdict, satellites left out, largest error over protection level."""
    verdicts = ("healthy", "excluded", "faulty", "not possible")
    table = _table(
        "Integrity", ("navigator", *(f"{v}\n%" for v in verdicts), "left out", "epochs\nwith HPL", "beyond\nHPL", "error/HPL\nmax"), left=1
    )
    for name, navigator in summary["navigators"].items():
        integrity = navigator.get("integrity")
        if integrity:
            seconds = integrity["verdict_seconds"]
            total = max(sum(seconds.values()), 1e-9)
            shares = [number(100.0 * seconds.get(v, 0.0) / total) for v in verdicts]
            counts = (integrity["exclusion_count"], integrity["epochs_with_protection_level"], integrity["epochs_beyond_protection_level"])
            table.add_row(name, *shares, *(str(c) for c in counts), number(integrity["largest_error_over_protection_level"]))
    return table


def integrity_sentences(summary: Mapping[str, Any]) -> list[str]:
    """Every exclusion and alarm, with the seconds from the start."""
    out = []
    for name, navigator in summary["navigators"].items():
        integrity = navigator.get("integrity") or {"exclusions": (), "alarm": None}
        for entry in integrity["exclusions"]:
            out.append(f"{name}: {entry['satellite']} left out at {entry['stamp_s'] - summary['first_stamp_s']:.1f} s: {entry['why']}")
        if integrity["alarm"]:
            out.append(f"{name}: ALARM at {integrity['alarm']['stamp_s'] - summary['first_stamp_s']:.1f} s: {integrity['alarm']['text']}")
    return out


def run_table(summary: Mapping[str, Any]) -> Table:
    """What came out and how fast."""
    heads = ("navigator", "mode at end", "as recorded", "solutions", "late", "rejected", "x real time", "sha256")
    table = _table("Fused solutions", heads, left=3)
    for name, navigator in summary["navigators"].items():
        rejected = [(reason, count) for i in navigator["inputs"].values() for reason, count in i["rejected"].items()]
        late = sum(count for reason, count in rejected if reason == "late")
        factor = summary["time"]["real_time_factor_by_navigator"][name]
        sha = navigator["fused"]["sha256"]
        counts = (str(navigator["solutions"]), str(late), str(sum(c for _, c in rejected) - late), f"{factor:.0f}" if factor else "-")
        table.add_row(name, navigator["mode_at_end"], _as_recorded(navigator["fused"]), *counts, sha[:12] if sha else "-")
    return table


def _as_recorded(fused: Mapping[str, Any]) -> str:
    if fused["equals_recorded"] is None:
        return "not recorded"
    if fused["equals_recorded"]:
        return f"equal ({fused['count_equal']})"
    return f"differs from {fused['first_differing_stamp_s']:.3f} s"


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """The baseline's verdicts, worse ones first."""
    table = _table("Against the baseline", ("verdict", "navigator", "metric", "found", "expected"), left=3)
    colours = {"better": "green", "same": "", "worse": "red"}
    for v in sorted(verdicts, key=lambda v: v.verdict != WORSE):
        found = "missing" if v.found is None else str(v.found).lower() if isinstance(v.found, bool) else f"{v.found:.4g}"
        table.add_row(v.verdict, v.navigator, v.metric, found, v.expected, style=colours[v.verdict])
    return table
