"""What a plan leaves: words on the terminal, and a folder with its numbers as JSON, its figures, and a page of both."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from lowcostnav_ros.report.document import document, html_table, section
from lowcostnav_ros.report.svg import escape
from lowcostnav_ros.report.terminal import Told, print_report

Figures = Mapping[str, Callable[[Any, Any], None]]


def show_plan(plan: Any, told: Told, folder: str | None, mapping: dict[str, Any], figures: Figures) -> None:
    """Print a plan; write ``plan.json``, the figures and ``plan.html`` into a folder, made where it is not there.

    Parameters
    ----------
    plan : GnssPlan or Plan
    told : Told
    folder : str or None
        None: it is only printed.
    mapping : dict
        The plan as plain values.
    figures : mapping of file name to function
        Each draws the plan on a figure.
    """
    print_report(*told)
    if not folder:
        return
    from matplotlib.figure import Figure

    out, drawn = Path(folder), list[str]()
    out.mkdir(parents=True, exist_ok=True)
    (out / "plan.json").write_text(json.dumps(mapping, indent=1, allow_nan=False), encoding="utf-8")
    for name, draw in figures.items():
        figure = Figure(layout="constrained")
        draw(figure, plan)
        figure.savefig(out / name, dpi=110)
        drawn.append(drawing(figure, name.partition(".")[0]))
    (out / "plan.html").write_text(page_of(told, drawn), encoding="utf-8")
    print(f"{out}: {', '.join(('plan.html', 'plan.json', *figures))}")


def page_of(told: Told, drawn: Sequence[str]) -> str:
    """A page of words, tables and drawings."""
    title, tables, lines = told
    said = "".join(f'<p class="note">{escape(line)}</p>' for line in lines)
    head = f"<header><h1>{escape(title)}</h1></header>"
    return document(title, [head, section("Found", *(html_table(table) for table in tables), said), section("Drawn", *drawn)])


def drawing(figure: Any, name: str) -> str:
    """A figure of matplotlib inside a page, its text as text; ``name`` tells its parts from those of other figures."""
    import io

    from matplotlib import rc_context

    text = io.StringIO()
    with rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    return f'<figure class="drawing">{text.getvalue().partition("?>")[2].partition(".dtd")[2].partition(">")[2]}</figure>'


def finite(value: float) -> float | None:
    """A number for JSON, rounded; None where it does not exist."""
    return round(float(value), 3) if math.isfinite(value) else None
