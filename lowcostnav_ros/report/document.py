"""The frame of every page: one self-contained HTML file with the house style and the common cursor."""

from collections.abc import Iterable

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.report.style import SCRIPT, STYLE
from lowcostnav_ros.report.svg import escape


def document(name: str, sections: Iterable[str]) -> str:
    """A whole page of some sections, under ``name`` in the browser."""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(name)}</title><style>{STYLE}</style>'
    body = f'<main>{"".join(sections)}</main><div id="when"></div><script>{SCRIPT}</script>'
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def section(title: str, *parts: str) -> str:
    """A section of the parts that are not empty; an empty string without any."""
    content = "".join(p for p in parts if p)
    return f"<section><h2>{escape(title)}</h2>{content}</section>" if content else ""


def details(title: str, content: str) -> str:
    """A section that is folded at first."""
    return f"<details><summary>{escape(title)}</summary>{content}</details>" if content else ""


def html_table(table: Table) -> str:
    """A table with all its columns and its notes; an empty string without rows."""
    if not table.rows:
        return ""
    heads = [f"{c.head} [{c.unit}]" if c.unit else c.head for c in table.columns]

    def cells(tag: str, row: Iterable[str]) -> str:
        texts = zip(table.columns, row, strict=True)
        return "".join(f'<{tag} class="{"l" if column.left else "r"}">{escape(text)}</{tag}>' for column, text in texts)

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in table.notes)
    caption = f"<caption>{escape(table.title)}</caption>"
    table_text = f"<table>{caption}<thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="wide">{table_text}</div>{notes}'
