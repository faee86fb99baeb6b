"""Tables and a replay's result on a terminal."""

import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.text import counted

if TYPE_CHECKING:  # other jobs draw tables, too, and load no replay for it
    from lowcostnav_ros.replay.result import ReplayResult

WIDTH = 100


def result_console() -> Console:
    """Where the tables of a result go: stdout, never wider than 100 columns."""
    return Console(width=min(WIDTH, Console().width) if sys.stdout.isatty() else WIDTH, soft_wrap=False)


def rich_table(table: Table) -> RichTable:
    """A table without its title as rich draws it; the last column of words wraps, and columns for a page only are not drawn."""
    drawn = RichTable(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    shown = [k for k, column in enumerate(table.columns) if not column.page_only]
    wrapping = max((k for k in shown if table.columns[k].left), default=None)
    for k in shown:
        column = table.columns[k]
        head = column.short or column.head
        head += f"{'' if head.endswith(chr(10)) else ' '}{column.unit}" if column.unit else ""
        drawn.add_column(escape(head), justify="left" if column.left else "right", no_wrap=k != wrapping)
    for row, colour in zip(table.rows, table.colours or ("",) * len(table.rows), strict=True):
        drawn.add_row(*(escape(row[k]) for k in shown), style=colour)
    return drawn


def print_table(table: Table, console: Console) -> None:
    """Print a table that has rows, with its notes."""
    if table.rows:
        if table.title:
            console.print(table.title, style="bold", highlight=False, markup=False)
        console.print(rich_table(table))
        for note in table.notes:
            console.print(note, highlight=False, markup=False)
        console.print()


def print_result(result: "ReplayResult", console: Console) -> None:
    """Print what was replayed, the errors, what they are good for, the outages, the aids and the speed."""
    from lowcostnav_ros.replay.tables import tables
    from lowcostnav_ros.replay.words import compared_with, sentence

    _print_head(result, console)
    for table in tables(result):
        print_table(table, console)
    for name, navigator in result.navigators.items():
        console.print(sentence(name, navigator, result.without_gps.total_s, compared_with(result.recording)), highlight=False)


def _print_head(result: "ReplayResult", console: Console) -> None:
    from lowcostnav_ros.replay.words import counted_outages

    recording = result.recording
    if recording:
        console.print(f"[bold]{recording.bag.name}[/bold]  sha256 {recording.bag.sha256[:16]}", highlight=False)
    span = f"stamps {result.first_stamp_s:.3f} to {result.last_stamp_s:.3f} s"
    lines = [f"{result.duration_s:.1f} s, {span}, settings {result.settings_hash}"]
    lost = result.without_gps
    if lost.total_s > 0.0:
        lines.append(f"without GPS for {lost.total_s:.0f} s in {counted_outages(len(lost.intervals_s))}")
    lines += result.withheld
    if recording:
        lines += [f"{name} not run: {reason}" for name, reason in recording.left_out.items()]
        rejecting = ((s, entry) for s, entry in recording.inputs.items() if entry.rejected)
        lines += [f"[yellow]{s}: of {e.count} messages rejected: {counted(e.rejected)}[/yellow]" for s, e in rejecting]
        lines += [f"{phrase} ({count} times)" if count > 1 else phrase for phrase, count in recording.assumed.items()]
    for line in lines:
        console.print(line, highlight=False)
    console.print()


Told = tuple[str, Sequence[Table], Sequence[str]]
"""A heading, tables, and sentences: what :func:`print_report` prints and a page shows."""


def print_report(title: str, tables: Iterable[Table], sentences: Iterable[str]) -> None:
    """Print a title, tables and sentences of a plan or a recording."""
    console = Console(width=None if sys.stdout.isatty() else 130, soft_wrap=True)
    if title:
        console.print(title, style="bold", highlight=False)
    for table in tables:
        print_table(table, console)
    for line in sentences:
        console.print(line, highlight=False)
