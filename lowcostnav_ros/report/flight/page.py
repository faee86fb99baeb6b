"""The page: header, sentences, figures, tables, in one self-contained HTML file."""

import datetime
import json
from collections.abc import Sequence
from pathlib import Path

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.replay import tables
from lowcostnav_ros.replay.result import ReplayResult
from lowcostnav_ros.replay.words import compared_with, counted_outages, sentence
from lowcostnav_ros.report.chart import TimeAxis
from lowcostnav_ros.report.document import details, document, html_table, section
from lowcostnav_ros.report.flight import figures
from lowcostnav_ros.report.flight.events import events
from lowcostnav_ros.report.flight.fields import fields_section
from lowcostnav_ros.report.flight.findings import clock, findings, has_gps
from lowcostnav_ros.report.flight.playback import playback
from lowcostnav_ros.report.flight.result_folder import Result, read_result
from lowcostnav_ros.report.flight.timeline import timeline
from lowcostnav_ros.report.svg import escape

WALL_CLOCK_S = 1.0e8
"""Stamps from here on are seconds since 1970 and are shown as a date too."""

_NOTE = (
    '<p class="note">Shaded: no GPS fix, or fewer than four satellites, for more than 3 s. '
    "Red ticks: a measurement was refused, or its innovation limited.</p>"
)

_REQUIREMENTS = (
    '<p class="note">Red lines: what precision approaches of category III, II and I ask for. Alert limits: safety-of-life (SOL) and public '
    "regulated (PRS) service. An alert is on while the navigator's own sigma, times what its error may pass with half the service's "
    "integrity risk each way, is beyond a limit.</p>"
)


def write_page(folder: Path, output: Path, title: str | None = None) -> int:
    """Write the report of a replay's result folder; return its size in bytes.

    Parameters
    ----------
    folder : Path
        Written by ``replay --out``.
    output : Path
        The HTML file.
    title : str, optional
        Heading; the name of the bag where None.

    Raises
    ------
    ReportError
        When the folder is no result of a replay.
    """
    page = page_of(read_result(folder), title)
    write_text(output, page)
    return len(page.encode())


def page_of(
    result: Result,
    title: str | None = None,
    before: Sequence[str] = (),
    after: Sequence[str] = (),
    outages: str = "",
    bag: Path | None = None,
) -> str:
    """The page as text.

    Parameters
    ----------
    result : Result
    title : str, optional
        Heading; the name of the bag where None.
    before, after : sequence of str
        Further sections, behind the first sentences and at the end.
    outages : str
        What a study of outages found, in a sentence.
    bag : Path, optional
        The recording, whose inputs a reader may draw.
    """
    summary = result.summary
    axis = figures.axis_of(summary)
    name = title or (summary.recording.bag.name if summary.recording else "simulated flight")
    last = (tables.input_table, tables.aid_table, tables.stamp_table, tables.contradiction_table, tables.integrity_table, tables.run_table)
    lanes = timeline(list(result.navigators.values()), axis)
    drawn, ground = figures.ground_map(result)
    other = compared_with(summary.recording)
    sections = [
        _header(summary, name, outages),
        *before,
        section("In a sentence each", _sentences(summary)),
        section("Map", drawn),
        section("Modes and refused measurements", lanes, _NOTE if lanes else "", _events(result, axis)),
        section(f"Differences from {other}" if other else "Errors", *_error_tables(summary)),
        section("Accuracy and requirements", *_requirements(result, axis)) if not other else "",
        *_per_navigator(result, axis),
        section("Attitude", *figures.compared_figures(result, axis, figures.ATTITUDE)),
        section("Height and speed", *figures.compared_figures(result, axis, figures.MOTION)),
        section("Wind (velocity of the air mass)", *figures.compared_figures(result, axis, figures.WIND)),
        section("Inputs, aids, speed", *(html_table(make(summary)) for make in last)),
        *after,
        fields_section(result, axis, bag),
        section("What is missing for more", _missing(summary)),
        details("Settings", f"<pre>{escape(json.dumps(summary.settings, indent=1))}</pre>"),
    ]
    return document(name, sections, playback(result, ground, axis))


def _header(summary: ReplayResult, name: str, outages: str) -> str:
    recording = summary.recording
    facts = {
        "bag": f"sha256 {recording.bag.sha256[:16]}" if recording else "simulated stream, no bag",
        "settings": summary.settings_hash,
        "duration": f"{summary.duration_s:.1f} s",
        "stamps": f"{summary.first_stamp_s:.2f} to {summary.last_stamp_s:.2f} s",
        "date": _date(summary.first_stamp_s),
        "without GPS": _without_gps(summary),
        "reference": _reference(summary),
        "software": f"lowcostnav_ros {summary.version}",
    }
    cells = "".join(f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in facts.items())
    withheld = "".join(f'<p class="note">{escape(text)}</p>' for text in summary.withheld)
    first = "".join(f"<p>{escape(text)}</p>" for text in findings(summary, outages))
    return f'<header><h1>{escape(name)}</h1><div class="findings">{first}</div><dl>{cells}</dl>{withheld}</header>'


def _missing(summary: ReplayResult) -> str:
    """Navigators that did not run and what they would need, and what was assumed for want of better."""
    recording = summary.recording
    if recording is None:
        return ""
    notes = [f"{name} did not run: {reason}." for name, reason in recording.left_out.items()] + [f"{text}." for text in recording.assumed]
    return "".join(f'<p class="note">{escape(text)}</p>' for text in notes)


def _events(result: Result, axis: TimeAxis) -> str:
    """What happened, in order; each time is a link that moves the cursor there."""
    rows = "".join(
        f'<tr><td class="r"><a href="#" data-go="{e.at_s:.2f}">{clock(e.at_s - axis.start_s)}</a></td>'
        f'<td class="l">{escape(e.who)}</td><td>{escape(e.what)}</td></tr>'
        for e in events(result)
    )
    head = '<tr><th class="r">time</th><th class="l">of</th><th class="l">what</th></tr>'
    return details("Events, in order", f'<div class="wide"><table><thead>{head}</thead>{rows}</table></div>') if rows else ""


def _without_gps(summary: ReplayResult) -> str:
    lost = summary.without_gps
    if not lost.total_s:
        return "never" if has_gps(summary) else "always"
    return f"{lost.total_s:.0f} s in {counted_outages(len(lost.intervals_s))}"


def _reference(summary: ReplayResult) -> str:
    if other := compared_with(summary.recording):
        return f"{other}, no truth"
    kinds = {n.errors.reference for n in summary.navigators.values() if n.errors.reference}
    return " and ".join(sorted(kinds)) or "none"


def _date(stamp_s: float) -> str:
    if stamp_s < WALL_CLOCK_S:
        return "not in the stamps"
    return f"{datetime.datetime.fromtimestamp(stamp_s, tz=datetime.UTC):%Y-%m-%d %H:%M:%S} UTC"


def _sentences(summary: ReplayResult) -> str:
    names = list(summary.navigators)
    items = []
    for name, navigator in summary.navigators.items():
        text = sentence(name, navigator, summary.without_gps.total_s, compared_with(summary.recording))
        rest = escape(text.removeprefix(name))
        items.append(f'<li style="border-color:{figures.colour_of(name, names)}"><b>{escape(name)}</b>{rest}</li>')
    return f'<ul class="sentences">{"".join(items)}</ul>'


def _error_tables(summary: ReplayResult) -> list[str]:
    everything = details("All error statistics", html_table(tables.size_table(summary)))
    return [html_table(tables.error_table(summary)), html_table(tables.interval_table(summary)), everything]


def _requirements(result: Result, axis: TimeAxis) -> list[str]:
    shown = [html_table(make(result.summary)) for make in (tables.accuracy_table, tables.approach_table, tables.alarm_table)]
    if not any(shown):
        return []
    each = details("Every time beyond an alert limit", html_table(tables.exceedance_table(result.summary)))
    return [*figures.requirement_figures(result, axis), *shown, each, _REQUIREMENTS]


def _per_navigator(result: Result, axis: TimeAxis) -> list[str]:
    names = list(result.navigators)
    sections = []
    for name, navigator in result.navigators.items():
        colour = figures.colour_of(name, names)
        states = details("Biases and other states, with 1 and 2 sigma", "".join(figures.state_figures(navigator, axis, colour)))
        innovations = "".join(figures.aid_figures(navigator, axis, colour))
        aids = details("Innovations per aid, in their own 1 and 2 sigma", innovations)
        other = compared_with(result.summary.recording)
        errors = figures.error_figures(navigator, axis, colour, f"difference from {other}" if other else "error")
        integrity = figures.integrity_figure(navigator, axis, colour)
        content = [*errors, integrity, figures.ratio_figure(navigator, axis), aids, states]
        sections.append(section(f"{name}: {'differences' if other else 'errors'} in their sigmas" if errors else name, *content))
    return sections
