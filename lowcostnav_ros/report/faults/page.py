"""The page of the fault study."""

from collections.abc import Sequence

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.report.document import details, document, html_table, section
from lowcostnav_ros.report.faults.matrix import legend, matrix
from lowcostnav_ros.report.faults.tables import bad, fault_table, row_table, summary_table
from lowcostnav_ros.report.svg import escape
from lowcostnav_ros.studies.faults.judge import Row

MEANING = (
    "Each fault is injected into a copy of one flight, and every navigator that it reaches flies on it; the same flight without the fault "
    "is the reference. Wrong: position or attitude is beyond 4 sigma for more than 1 % of the time from the start of the fault to the end "
    "of the flight; the number is what error over sigma does not exceed 99 % of that time. Sound: covered, and the faulty source was named."
    " Harmless: errors stay about as they are without the fault. Silent: no solution for more than 5 s."
)


def page(rows: Sequence[Row]) -> str:
    """The whole page as text."""
    faults = len({row.fault for row in rows})
    seeds = sorted({row.seed for row in rows})
    groups = list(dict.fromkeys(row.fault.split("_")[0] for row in rows))
    wrong = bad(rows)
    title = f"{faults} fault{'' if faults == 1 else 's'}, {len(wrong)} of {len(rows)} flights of a navigator wrong and sure"
    sections = [
        f'<header><h1>{escape(title)}</h1></header><p class="note">{escape(MEANING)}</p>',
        section("Verdicts", html_table(summary_table(rows))),
        *(section(f"{group}", legend(), matrix([r for r in rows if _in(r, group) and r.seed == seeds[0]])) for group in groups),
        section("Wrong and sure", html_table(row_table("The worst first", wrong))) if wrong else "",
        details("All numbers", html_table(row_table("", rows))),
        details("What was injected", html_table(fault_table(list(dict.fromkeys(row.fault for row in rows))))),
    ]
    return document("Faults", sections)


def _in(row: Row, group: str) -> bool:
    return row.fault.split("_")[0] == group


def markdown(rows: Sequence[Row], command: str) -> str:
    """The page of the documentation."""
    wrong, seeds = bad(rows), sorted({row.seed for row in rows})
    lines = ["# Faults", "", f"Written by `{command}`, seeds {', '.join(map(str, seeds))}. {MEANING}", "", "## Verdicts", ""]
    lines += [*_table(summary_table(rows)), "", "## Wrong and sure", ""]
    lines += _table(row_table("", wrong)) if wrong else ["None."]
    return "\n".join([*lines, "", "## Every fault", "", *_table(row_table("", rows))]) + "\n"


def _table(table: Table) -> list[str]:
    """A table in Markdown."""
    heads = [f"{column.head} [{column.unit}]" if column.unit else column.head for column in table.columns]
    rule = [":---" if column.left else "---:" for column in table.columns]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in (heads, rule, *table.rows)]
