"""The folder a plan leaves: its numbers as JSON and its figures."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any


def write_plan(
    plan: Any, folder: Path, write_json: Callable[[Any, Path], None], write_figures: Callable[[Any, Path], Iterable[str]]
) -> None:
    """Write ``plan.json`` and the figures into a folder, made where it is not there, and say what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(plan, folder / "plan.json")
    print(f"{folder}: plan.json, {', '.join(write_figures(plan, folder))}")
