"""The table model and its two renderers."""

from rich.console import Console

from lowcostnav_ros.base.tables import Column, Table, number
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.report.document import html_table
from lowcostnav_ros.report.terminal import print_table

TABLE = Table.of(
    "Errors [of <all>]",
    (
        Column("navigator", lambda row: row[0], left=True),
        Column("horizontal RMS", lambda row: number(row[1]), "m", "horiz\nRMS"),
        Column("median", lambda row: number(row[1]), "m", page_only=True),
    ),
    [("a [u/rtHz]", 1234.5), ("b", None)],
    colours=("red", ""),
    notes=("a: [left out] at 3 s",),
)


def printed(table):
    with open("/dev/null", "w") as nowhere:
        console = Console(width=100, record=True, file=nowhere)
        print_table(table, console)
    return console.export_text()


def test_a_terminal_shows_short_heads_and_no_column_for_pages():
    lines = [line.rstrip() for line in printed(TABLE).splitlines()]
    assert lines[0] == "Errors [of <all>]" and lines[1].split() == ["horiz"] and lines[2].split() == ["navigator", "RMS", "m"]
    assert lines[3].split() == ["a", "[u/rtHz]", "1234"] and lines[4].split() == ["b", "-"]
    assert lines[5] == "a: [left out] at 3 s" and "median" not in printed(TABLE)


def test_a_page_shows_all_columns_with_units_and_escapes():
    page = html_table(TABLE)
    assert '<th class="l">navigator</th><th class="r">horizontal RMS [m]</th><th class="r">median [m]</th>' in page
    assert "<caption>Errors [of &lt;all&gt;]</caption>" in page and '<td class="r">1234</td><td class="r">1234</td>' in page
    assert page.endswith('<p class="note">a: [left out] at 3 s</p>')


def test_a_table_without_rows_is_not_shown():
    assert html_table(Table.plain("t", ("a",), ())) == printed(Table.plain("t", ("a",), ())) == ""


def test_counts_stand_by_size_then_name():
    assert counted({"late": 2, "a": 2, "wrong frame": 30}) == "30 wrong frame, 2 a, 2 late"
