"""A replay's result as tables; a terminal of 100 columns shows all but the columns that are for a page only."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any

from lowcostnav_ros.base.tables import Column, Table, number, percent
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.gnss.accuracy import CATEGORIES_M
from lowcostnav_ros.replay.baseline import WORSE, Verdict
from lowcostnav_ros.replay.metrics import MAGNITUDES
from lowcostnav_ros.replay.result import (
    ErrorSummary,
    Fused,
    InputSummary,
    IntervalErrors,
    NavigatorResult,
    ReplayResult,
    ServiceErrors,
    SourceCounts,
)
from lowcostnav_ros.replay.words import error_over_sigma

_PARTS = {"flight": "flight", "withheld_gps": "withheld", "without_gps": "no GPS"}
_SIZES = {
    "horizontal_m": ("horizontal", "horiz\nRMS", "m"),
    "vertical_m": ("vertical", "vert\nRMS", "m"),
    "velocity_mps": ("velocity", "vel\nRMS", "m/s"),
    "roll_deg": ("roll", "roll\n", "deg"),
    "pitch_deg": ("pitch", "pitch\n", "deg"),
    "heading_deg": ("heading", "hdg\n", "deg"),
    "wind_mps": ("wind", "wind\n", "m/s"),
}
"""Sizes that are shown: in full, the head of their RMS in short, unit."""
_VERDICTS = {"warned": "warned in time", "brief": "over before an alarm was due", "missed": "not warned"}

_NAVIGATOR = Column("navigator", itemgetter(0), left=True)
_OVER = Column("over", itemgetter(1), left=True)
_AXES = {"north": "N", "east": "E", "up": "U"}


def tables(result: ReplayResult) -> tuple[Table, ...]:
    """Every table that a terminal shows, in order."""
    of_errors = (error_table, accuracy_table, approach_table, alarm_table, interval_table)
    return tuple(make(result) for make in (*of_errors, aid_table, stamp_table, contradiction_table, integrity_table, run_table))


def _parts(result: ReplayResult) -> Iterator[tuple[str, str, ErrorSummary]]:
    """Navigator, part of the flight in words, errors."""
    for name, navigator in result.navigators.items():
        yield from ((name, _PARTS[part], errors) for part, errors in navigator.errors.parts())


def _smoothed(result: ReplayResult) -> Iterator[tuple[str, str, ErrorSummary]]:
    """The same of what was smoothed."""
    for name, navigator in result.navigators.items():
        parts = navigator.smoothed.parts() if navigator.smoothed else ()
        yield from ((f"{name}, smoothed", _PARTS[part], errors) for part, errors in parts)


def _size(size: str, statistic: str, page_only: bool = False, short: str = "") -> Column:
    """Column of one statistic of one size."""
    (name, _, unit), words = _SIZES[size], {"rms": "RMS", "p95": "95 %", "max": "max"}[statistic]

    def cell(row: tuple[str, str, ErrorSummary]) -> str:
        found = row[2].size(size)
        return "-" if found is None else number(getattr(found, statistic))

    return Column(f"{name} {words}", cell, unit, short, page_only=page_only)


def error_table(result: ReplayResult) -> Table:
    """Errors against the reference: a row per navigator and part of the flight."""

    def axes(row: tuple[str, str, ErrorSummary]) -> str:
        return " ".join(number(row[2].error_over_sigma.get(axis), 2) for axis in ("north_m", "east_m"))

    columns = [_NAVIGATOR, _OVER]
    for size, (_, short, _) in _SIZES.items():
        is_first = size == "horizontal_m"
        columns += [_size(size, "rms", short=short), _size(size, "p95", not is_first, "\n95 %")]
        columns += [_size(size, "max", short="\nmax")] if is_first else []
    columns += [
        Column("error/sigma N E", axes, "", "err/sigma\nN E"),
        Column("error/sigma", lambda row: number(error_over_sigma(row[2].error_over_sigma), 2), page_only=True),
    ]
    return Table.of("Errors (estimate minus reference)", columns, [*_parts(result), *_smoothed(result)])


def size_table(result: ReplayResult) -> Table:
    """Every size with its consistency: RMS, median, 95 %, maximum, error over sigma per axis."""
    rows = []
    for name, words, errors in _parts(result):
        for size, (label, _, unit) in _SIZES.items():
            if s := errors.size(size):
                ratios = " ".join(number(errors.error_over_sigma.get(axis), 2) for axis in MAGNITUDES[size])
                sizes = (number(s.rms), number(s.median), number(s.p95), number(s.max))
                rows.append((name, words, f"{label} [{unit}]", *sizes, f"{s.max_at_s:.1f}", ratios))
    heads = ("navigator", "over", "error", "RMS", "median", "95 %", "max", "max at t [s]", "error/sigma per axis")
    return Table.plain("Errors, estimate minus reference", heads, rows, left=3)


def accuracy_table(result: ReplayResult) -> Table:
    """Position accuracy: mean and RMS north, east, up, in the plane and in space, and the largest errors."""
    columns = [_NAVIGATOR, _OVER]
    for kind, head in (("mean_m", "mean"), ("rms_m", "RMS")):
        for axis, letter in _AXES.items():
            short = f"{head} {letter}\n" if letter == "N" else f"\n{letter}"
            unit = "m" if letter == "N" else ""
            columns.append(Column(f"{head} {letter}", _moment(kind, axis), unit, short))
    columns += [
        Column("2D RMS", lambda row: number(row[2].position.rms_2d_m), "m", "2D\nRMS"),
        Column("3D RMS", lambda row: number(row[2].position.rms_3d_m), "m", "3D\nRMS"),
        _size("horizontal_m", "max", page_only=True),
        _size("vertical_m", "max", page_only=True),
        Column("max 3D", lambda row: number(row[2].position_m.max), "m", "3D\nmax"),
    ]
    return Table.of("Position accuracy", columns, _positions(result))


def _moment(kind: str, axis: str) -> Callable[[Any], str]:
    return lambda row: number(getattr(row[2].position, kind)[axis])


def _positions(result: ReplayResult) -> Iterator[tuple[str, str, ErrorSummary]]:
    return (row for row in _parts(result) if row[2].position)


def approach_table(result: ReplayResult) -> Table:
    """Precision-approach categories: share of the errors within each, and which one the 95 % errors meet."""

    def present(row: Sequence[Any]) -> str:
        """Per cent of the flight through which the navigator gave a position."""
        seconds = result.navigators[row[0]].errors.position_present_s
        return percent(min(1.0, seconds / max(result.duration_s, 1e-9))) if row[1] == _PARTS["flight"] else "-"

    def share(category: str, h: float, v: float) -> Column:
        def cell(row: Sequence[Any]) -> str:
            return "/".join(percent(share) for share in row[2].approach.share_within[category].values())

        return Column(f"category {category}: {h:g} m, {v:g} m", cell, "", f"cat {category}\n{h:g} m, {v:g} m")

    columns = (
        *(_NAVIGATOR, _OVER),
        Column("position there", present, "%", "there\n"),
        _size("horizontal_m", "p95", short="95 % H\n"),
        _size("vertical_m", "p95", short="V\n"),
        *(share(name, *limits) for name, limits in reversed(CATEGORIES_M.items())),
        Column("95 % meet", lambda row: row[2].approach.met_by_95 or "none", "", "95 %\nmeet"),
    )
    return Table.of("Precision approach: share within, horizontal / vertical / both [%]", columns, _positions(result))


def alarm_table(result: ReplayResult) -> Table:
    """Alert limits of the services: how often and how long passed, and whether the navigator's own sigmas warned in time."""

    def limits(row: Sequence[Any]) -> str:
        return f"{row[2].horizontal_limit_m:g} m, {row[2].vertical_limit_m:g} m, {row[2].time_to_alert_s:g} s"

    columns = (
        _NAVIGATOR,
        Column("service", itemgetter(1), left=True),
        Column("limits H, V, time to alert", limits, "", "limits H, V,\nwithin"),
        Column("times passed", lambda row: str(row[2].exceedances), "", "passed"),
        Column("longest", lambda row: number(row[2].longest_s), "s", "longest\n"),
        Column("beyond", lambda row: number(row[2].beyond_limit_s), "s", page_only=True),
        Column("of it without alert", lambda row: number(row[2].beyond_without_alert_s), "s", page_only=True),
        Column(_VERDICTS["warned"], lambda row: str(row[2].warned), "", "warned\nin time"),
        Column(_VERDICTS["brief"], lambda row: str(row[2].brief), "", "over before\ndue"),
        Column(_VERDICTS["missed"], lambda row: str(row[2].missed), "", "not\nwarned"),
        Column("alert on", lambda row: number(row[2].alert_s), "s", "alert on\n"),
    )
    return Table.of("Alert limits (alert: by the navigator's own sigmas)", columns, _services(result))


def _services(result: ReplayResult) -> Iterator[tuple[str, str, ServiceErrors]]:
    """Navigator, service, errors against its limits."""
    for name, navigator in result.navigators.items():
        yield from ((name, service, found) for service, found in navigator.errors.services.items())


def exceedance_table(result: ReplayResult) -> Table:
    """Every stretch beyond an alert limit with the time its alarm was due and the time it came."""
    rows = []
    for name, service, found in _services(result):
        for e in found.listed:
            times = ("never" if t is None else f"{t:.1f}" for t in (e.start_s, e.end_s, e.alarm_due_s, e.alarm_s))
            rows.append((name, service, *times, _VERDICTS[e.verdict]))
    heads = ("navigator", "service", "from t [s]", "to t [s]", "alarm due by t [s]", "alert since t [s]", "")
    return Table.plain("Times beyond an alert limit", heads, rows, left=2)


def interval_kind(what: str, satellites: int | None) -> str:
    """What an interval was: withheld, without GPS, or the satellites that were left."""
    return what if satellites is None else f"{satellites} satellite{'' if satellites == 1 else 's'}"


def interval_table(result: ReplayResult) -> Table:
    """Outages and withheld windows: worst error and the error at the end."""

    def start(interval: IntervalErrors) -> float:
        return result.first_stamp_s if interval.start_s is None else interval.start_s

    def end(axis: str) -> Any:
        return lambda row: number(row[2].error_at_end.get(axis))

    zero = result.first_stamp_s
    columns = (
        _NAVIGATOR,
        Column("s from start", lambda row: f"{start(row[2]) - zero:.1f}-{row[2].end_s - zero:.1f}", left=True),
        Column("what", lambda row: interval_kind(row[1], row[2].satellites), left=True),
        Column("from t", lambda row: f"{start(row[2]):.1f}", "s", page_only=True),
        Column("to t", lambda row: f"{row[2].end_s:.1f}", "s", page_only=True),
        Column("length", lambda row: f"{row[2].end_s - start(row[2]):.0f}", "s", page_only=True),
        Column("worst horizontal", lambda row: number(row[2].worst_horizontal_m), "m", "worst horiz"),
        Column("worst 3D", lambda row: number(row[2].worst_3d_m), "m", "3D"),
        Column("at end N", end("north_m"), "m"),
        Column("E", end("east_m"), "m"),
        Column("D", end("down_m"), "m"),
        Column("heading", end("heading_deg"), "deg", "hdg"),
    )
    rows = []
    for name, navigator in result.navigators.items():
        for what, found in (("without GPS", navigator.errors.outages), ("withheld", navigator.errors.windows)):
            rows += [(name, what, interval) for interval in found if interval.samples]
    return Table.of("Outages and withheld windows", columns, rows)


def aid_table(result: ReplayResult) -> Table:
    """Use of the aids: NIS per degree of freedom near 1 says that the predicted innovations are consistent.

    Innovations of a filter that has all that they tell are white: a correlation with the one before of much more than 0 is an error that
    lasts (of the sensor, or of a state that moves more than the filter believes), of much less one that is corrected too far.
    """

    def named(values: dict[str, float] | None) -> str:
        return ", ".join(f"{label} {number(value)}" for label, value in (values or {}).items())

    columns = (
        _NAVIGATOR,
        Column("aid", itemgetter(1), left=True),
        Column("used", lambda row: str(row[2].used)),
        Column("NIS per degree of freedom", lambda row: number(row[2].nis_per_dof), "", "NIS/dof"),
        Column("RMS innovation", lambda row: named(row[2].innovation_rms), page_only=True),
        Column("correlation with the one before", lambda row: named(row[2].innovation_correlation), page_only=True),
        Column("not used, or limited", lambda row: counted(row[2].not_used_or_limited) or "-", left=True),
    )
    rows = [(name, aid, found) for name, navigator in result.navigators.items() for aid, found in navigator.aids.items()]
    return Table.of("Aids", columns, rows)


def contradiction_table(result: ReplayResult) -> Table:
    """What contradicted what, since when, for how long, how far apart, whom the others speak against."""
    columns = (
        _NAVIGATOR,
        Column("contradiction", lambda row: row[1].name, left=True),
        Column("between", lambda row: " and ".join(row[1].parties), left=True),
        Column("suspect", lambda row: row[1].suspect or "-", left=True),
        Column("from", lambda row: number(row[1].first_s - result.first_stamp_s), "s"),
        Column("held", lambda row: number(row[1].seconds), "s"),
        Column("largest", lambda row: f"{number(row[1].largest)} {row[1].unit}"),
    )
    rows = [(name, found) for name, navigator in result.navigators.items() for found in navigator.contradictions]
    notes = dict.fromkeys(f"{name}: {found.name}: {found.advice}" for name, found in rows if found.advice)
    return Table.of("Contradictions", columns, rows, notes=tuple(notes))


def stamp_table(result: ReplayResult) -> Table:
    """Offsets of the stamps that turns and accelerations have shown, and what of them was corrected."""
    columns = (
        _NAVIGATOR,
        Column("device", lambda row: row[1], left=True),
        Column("late", lambda row: f"{row[2].late_s:.3f}", "s"),
        Column("sigma", lambda row: f"{row[2].sigma_s:.3f}", "s"),
        Column("corrected", lambda row: f"{row[2].corrected_s:.3f}" if row[2].corrected_s else "-", "s"),
    )
    known = ((name, device, stamps) for name, navigator in result.navigators.items() for device, stamps in navigator.stamps.items())
    rows = [row for row in known if row[2].is_observed or row[2].corrected_s]
    return Table.of("Offsets of stamps", columns, rows)


def integrity_table(result: ReplayResult) -> Table:
    """Integrity where satellites are tested: share of time per verdict, exclusions, largest error over protection level."""

    def share(verdict: str) -> Column:
        def cell(row: Sequence[Any]) -> str:
            seconds = row[1].verdict_seconds
            return number(100.0 * seconds.get(verdict, 0.0) / max(sum(seconds.values()), 1e-9))

        return Column(verdict, cell, "%", f"{verdict}\n")

    columns = (
        _NAVIGATOR,
        *(share(verdict) for verdict in ("healthy", "excluded", "faulty", "not possible")),
        Column("exclusions", lambda row: str(row[1].exclusion_count), "", "exclu-\nsions"),
        Column("epochs with HPL", lambda row: str(row[1].epochs_with_protection_level), "", "epochs\nwith HPL"),
        Column("beyond HPL", lambda row: str(row[1].epochs_beyond_protection_level), "", "beyond\nHPL"),
        Column("largest error/HPL", lambda row: number(row[1].largest_error_over_protection_level), "", "error/HPL\nmax"),
    )
    rows = [(name, navigator.integrity) for name, navigator in result.navigators.items() if navigator.integrity]
    return Table.of("Integrity", columns, rows, notes=tuple(_integrity_notes(result)))


def _integrity_notes(result: ReplayResult) -> Iterator[str]:
    """Every exclusion and alarm, with the seconds from the start."""
    for name, found in ((name, navigator.integrity) for name, navigator in result.navigators.items() if navigator.integrity):
        for entry in found.exclusions:
            yield f"{name}: {entry.satellite} excluded at {entry.stamp_s - result.first_stamp_s:.1f} s: {entry.why}"
        if found.alarm:
            yield f"{name}: ALARM at {found.alarm.stamp_s - result.first_stamp_s:.1f} s: {found.alarm.text}"


def input_table(result: ReplayResult) -> Table:
    """What each navigator received and rejected, and what the decoder rejected."""

    def row(at: str, source: str, entry: SourceCounts | InputSummary) -> tuple[str, ...]:
        required, count = ("", entry.count) if isinstance(entry, SourceCounts) else ("required" * entry.required, entry.received)
        return at, source, required, str(count), counted(entry.rejected) or "-"

    inputs: dict[str, Mapping[str, Any]] = {"recording": result.recording.inputs} if result.recording else {}
    inputs |= {name: navigator.inputs for name, navigator in result.navigators.items()}
    rows = [row(at, source, entry) for at, sources in inputs.items() for source, entry in sources.items()]
    return Table.plain("Inputs", ("at", "source", "", "messages or samples", "rejected"), rows, left=3)


def run_table(result: ReplayResult) -> Table:
    """Fused solutions: their fingerprint, the comparison with the recording, what was late or rejected, speed."""

    def late(navigator: NavigatorResult) -> int:
        return sum(entry.rejected.get("late", 0) for entry in navigator.inputs.values())

    def rejected(navigator: NavigatorResult) -> int:
        return sum(sum(entry.rejected.values()) for entry in navigator.inputs.values()) - late(navigator)

    def factor(row: tuple[str, NavigatorResult]) -> str:
        found = result.time.real_time_factor_by_navigator.get(row[0]) if result.time else None
        return f"{found:.0f}" if found else "-"

    def nees(navigator: NavigatorResult) -> float | None:
        return next((errors.nees_horizontal for _, errors in navigator.errors.parts()), None)

    columns = (
        _NAVIGATOR,
        Column("mode at end", lambda row: row[1].mode_at_end, "", "mode\nat end", left=True),
        Column("as recorded in flight", lambda row: _as_recorded(row[1].fused), "", "as recorded", left=True),
        Column("equal, of recorded", lambda row: f"{row[1].fused.count_equal} of {row[1].fused.count_recorded}", page_only=True),
        Column("solutions", lambda row: str(row[1].solutions)),
        Column("horizontal NEES (2 expected)", lambda row: number(nees(row[1])), page_only=True),
        Column("late", lambda row: str(late(row[1]))),
        Column("rejected", lambda row: str(rejected(row[1]))),
        Column("x real time", factor, "", "x real\ntime"),
        Column("sha256 of fused output", lambda row: (row[1].fused.sha256 or "-")[:16], "", "sha256"),
    )
    return Table.of("Fused solutions", columns, result.navigators.items())


def _as_recorded(fused: Fused) -> str:
    if fused.equals_recorded is None:
        return "not recorded"
    return f"equal ({fused.count_equal})" if fused.equals_recorded else f"differs from {fused.first_differing_stamp_s:.3f} s"


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """The baseline's verdicts, worse ones first."""

    def found(v: Verdict) -> str:
        return "missing" if v.found is None else str(v.found).lower() if isinstance(v.found, bool) else f"{v.found:.4g}"

    columns = (
        Column("verdict", lambda v: v.verdict, left=True),
        Column("navigator", lambda v: v.navigator, left=True),
        Column("metric", lambda v: v.metric, left=True),
        Column("found", found),
        Column("expected", lambda v: v.expected),
    )
    ordered = sorted(verdicts, key=lambda v: v.verdict != WORSE)
    colours = tuple({"better": "green", "same": "", "worse": "red"}[v.verdict] for v in ordered)
    return Table.of("Against the baseline", columns, ordered, colours=colours)
