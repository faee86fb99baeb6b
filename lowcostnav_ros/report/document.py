"""The frame of every page: one self-contained HTML file with the house style, a table of contents, and the behaviour of its charts."""

import base64
import re
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.report.svg import element, escape

_HERE = Path(__file__).parent
_SHORT = 44
"""A cell of more characters than this may be broken into lines."""
_FEW = 4
"""So many sections need no table of contents."""
_NO_SCRIPT = "<noscript>Drawn by the script of this page.</noscript>"
_SPEEDS = {str(k): f"{k}\N{MULTIPLICATION SIGN}" for k in (1, 5, 20, 60, 200)}
PLAIN = 200_000
"""So much of a page is written out; what lies further down is packed, and unpacked by the script as soon as the page is there."""
_COLOURS = {"": "track: one colour", "error_m": "by error", "ratio": "by error over sigma", "mode": "by mode"}


def document(name: str, sections: Iterable[str], flight: str = "") -> str:
    """A whole page of some sections, under ``name`` in the browser.

    Parameters
    ----------
    name : str
    sections : iterable of str
        HTML; what :func:`section` makes is listed in the table of contents.
    flight : str
        What there is to play, as JSON; see :mod:`.flight.playback`.
    """
    sections = _lighter(sections)
    style, script, panel = (_text(file) for file in ("page.css", "page.js", "instruments.js"))
    view = '<meta name="viewport" content="width=device-width,initial-scale=1">'
    head = f'<meta charset="utf-8">{view}<title>{escape(name)}</title><style>{style}</style>'
    tools = _button("\N{CIRCLE WITH RIGHT HALF BLACK}", "light or dark", id="theme")
    tools += _button("SI", "units: SI or of aviation", id="units", hidden="hidden")
    tools += _button("whole flight", "zoom out", id="unzoom")
    fixed = f'<div id="tools">{tools}</div><div id="when"></div>'
    scripts = script
    if flight:
        fixed += f'{_player()}<script id="flight" type="application/octet-stream" data-packed="{packed(flight)}"></script>'
        scripts = panel + script
    if any('id="fields"' in one for one in sections):
        scripts += _text("fields.js")
    body = f"<main>{_with_contents(sections)}</main>{fixed}<script>{scripts}</script>"
    return f'<!doctype html><html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def packed(text: str) -> str:
    """Deflated, in base 64."""
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def _lighter(sections: Iterable[str]) -> list[str]:
    """The sections, their contents packed once so much is written out."""
    written, out = 0, list[str]()
    for one in sections:
        head, end, content = one.partition("</h2>")
        if end and written > PLAIN and len(content) > PLAIN // 20:
            one = f'{head}{end}<div data-packed="{packed(content.removesuffix("</section>"))}">{_NO_SCRIPT}</div></section>'
        written += len(one)
        out.append(one)
    return out


def _text(file: str) -> str:
    return (_HERE / file).read_text(encoding="utf-8")


def _button(text: str, label: str, **attributes: str) -> str:
    return element("button", text, aria_label=label, title=label, **attributes)


def _player() -> str:
    def choice(kind: str, label: str, options: dict[str, str]) -> str:
        listed = "".join(element("option", text, value=value) for value, text in options.items())
        return element("select", listed or " ", class_=kind, aria_label=label)

    slide = element("input", type="range", min="0", step="any", value="0", class_="slide", aria_label="time")
    play = _button("\N{BLACK RIGHT-POINTING TRIANGLE}", "play or pause", class_="play")
    choices = choice("who", "navigator", {}) + choice("by", "colour of the track", _COLOURS)
    fold = _button("\N{WHITE CIRCLE}", "attitude indicator", class_="fold")
    horizon = '<div class="horizon"><canvas role="img" aria-label="attitude, speed, height and heading"></canvas></div>'
    parts = (play, choice("speed", "speed", _SPEEDS), slide, '<span class="time"></span>', choices, fold, horizon)
    return f'<div id="player" hidden>{"".join(parts)}</div>'


def _with_contents(sections: list[str]) -> str:
    """The sections, with a table of contents behind the heading."""
    found = list[str]()

    def named(match: re.Match[str]) -> str:
        found.append(match[1])
        return f'<section id="s{len(found)}"><h2>{match[1]}</h2>'

    body = re.sub(r"<section><h2>(.*?)</h2>", named, "".join(sections))
    if len(found) <= _FEW:
        return body
    items = "".join(f'<li><a href="#s{k}">{text}</a></li>' for k, text in enumerate(found, 1))
    head, end, rest = body.partition("</header>")
    return f'{head}{end}<nav aria-label="contents"><ol>{items}</ol></nav>{rest}'


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

    def cells(tag: str, row: Sequence[str]) -> str:
        texts = zip(table.columns, row, strict=True)
        looks = ("r" if not column.left else "l" if len(text) <= _SHORT else "long" for column, text in texts)
        return "".join(f'<{tag} class="{look}">{escape(text)}</{tag}>' for look, text in zip(looks, row, strict=True))

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in table.notes)
    caption = f"<caption>{escape(table.title)}</caption>"
    table_text = f"<table>{caption}<thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="wide">{table_text}</div>{notes}'
