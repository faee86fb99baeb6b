"""What a plan leaves: words on the terminal, and a folder with its numbers as JSON and a page of words, tables, charts and maps."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from lowcostnav_ros.report.document import document, html_table, section
from lowcostnav_ros.report.svg import escape
from lowcostnav_ros.report.terminal import Told, print_report


def show_plan(plan: Any, told: Told, folder: str | None, mapping: dict[str, Any], drawings: Callable[[Any], Sequence[str]]) -> None:
    """Print a plan; write ``plan.json`` and ``plan.html`` into a folder, made where it is not there.

    Parameters
    ----------
    plan : GnssPlan or Plan
    told : Told
    folder : str or None
        None: it is only printed.
    mapping : dict
        The plan as plain values.
    drawings : callable
        Charts and maps of the plan.
    """
    print_report(*told)
    if not folder:
        return
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    (out / "plan.json").write_text(json.dumps(mapping, indent=1, allow_nan=False), encoding="utf-8")
    (out / "plan.html").write_text(page_of(told, drawings(plan)), encoding="utf-8")
    print(f"{out}: plan.html, plan.json")


def page_of(told: Told, drawn: Sequence[str]) -> str:
    """A page of words, tables and drawings."""
    title, tables, lines = told
    said = "".join(f"<p>{escape(line)}</p>" for line in lines)
    findings = f'<div class="findings">{said}</div>' if said else ""
    head = f"<header><h1>{escape(title)}</h1>{findings}</header>"
    return document(title, [head, section("Drawn", *drawn), section("In numbers", *(html_table(table) for table in tables))])


def finite(value: float) -> float | None:
    """A number for JSON, rounded; None where it does not exist."""
    return round(float(value), 3) if math.isfinite(value) else None
