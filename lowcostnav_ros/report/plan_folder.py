"""The folder a plan leaves: its numbers as JSON and its figures."""

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any


def write_plan(plan: Any, folder: Path, as_mapping: Callable[[Any], dict], write_figures: Callable[[Any, Path], Iterable[str]]) -> None:
    """Write ``plan.json`` and the figures into a folder, made where it is not there, and say what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plan.json").write_text(json.dumps(as_mapping(plan), indent=1, allow_nan=False), encoding="utf-8")
    print(f"{folder}: plan.json, {', '.join(write_figures(plan, folder))}")


def finite(value: float) -> float | None:
    """A number for JSON, rounded; None where it does not exist."""
    return round(float(value), 3) if math.isfinite(value) else None
