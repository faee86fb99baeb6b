"""The folder a plan leaves: its numbers as JSON and its figures."""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def write_plan(plan: Any, folder: Path, mapping: dict[str, Any], figures: Mapping[str, Callable[[Any, Any], None]]) -> None:
    """Write ``plan.json`` and the figures into a folder, made where it is not there, and print what was written.

    Parameters
    ----------
    plan : GnssPlan or Plan
    folder : Path
    mapping : dict
        The plan as plain values.
    figures : mapping of file name to function
        Each draws the plan on a figure.
    """
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plan.json").write_text(json.dumps(mapping, indent=1, allow_nan=False), encoding="utf-8")
    for name, draw in figures.items():
        figure = Figure(layout="constrained")
        draw(figure, plan)
        figure.savefig(folder / name, dpi=110)
    print(f"{folder}: {', '.join(('plan.json', *figures))}")


def finite(value: float) -> float | None:
    """A number for JSON, rounded; None where it does not exist."""
    return round(float(value), 3) if math.isfinite(value) else None
