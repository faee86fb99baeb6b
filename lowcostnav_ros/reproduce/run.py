"""Run results one after the other, draw their figures, and keep what the page and the JSON need."""

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from lowcostnav_ros.reproduce.registry import CRASHED, Context, DrawFunction, Entry, Outcome

FIGURE_INCHES = (9.0, 3.8)
FIGURE_DPI = 80
FIGURES = "figures"
COLOURS = 128
ONE_SEED = "; one seed is no verdict"


@dataclass(frozen=True)
class Record:
    """One finished result.

    ``figure`` is the path of its picture relative to the output directory, or None; ``seeds`` how many were flown, 0 where it draws all
    from one stream.
    """

    entry: Entry
    outcome: Outcome
    seconds: float
    figure: str | None
    trace: str = ""
    seeds: int = 0

    def as_json(self, out: Path | None) -> dict[str, str | float | None]:
        """Plain values under the names of the JSON output."""
        return {
            "id": self.entry.id,
            "title": self.entry.title,
            "source": self.entry.source,
            "thesis": self.entry.thesis,
            "ours": self.outcome.ours,
            "tolerance": self.entry.tolerance,
            "verdict": self.outcome.verdict,
            "reason": self.outcome.reason,
            "seeds": self.seeds,
            "seconds": round(self.seconds, 3),
            "figure": str(out / self.figure) if out is not None and self.figure else None,
        }


def run_results(
    entries: Sequence[Entry], context: Context, out: Path | None = None, report: Callable[[Record], None] | None = None
) -> list[Record]:
    """Compute results in order; in a quick run, whose results have no seeds to share out, module by module side by side.

    Parameters
    ----------
    entries : sequence of Entry
    context : Context
    out : Path, optional
        Directory that receives ``figures/<id>.png``; without it nothing is drawn.
    report : callable, optional
        Called with each record as it is finished; of a quick run, when all are.

    Returns
    -------
    list of Record
        A function that raises gives the verdict ``crashed``, and the others still run.
    """
    records = []
    for record in _side_by_side(entries, context, out) if context.quick else (_run_one(entry, context, out) for entry in entries):
        records.append(record)
        if report is not None:
            report(record)
    return records


def _side_by_side(entries: Sequence[Entry], context: Context, out: Path | None) -> list[Record]:
    """Records of results that share flights (those of a module) computed by one worker, in the order of the entries."""
    modules: dict[str, list[Entry]] = {}
    for entry in entries:
        modules.setdefault(entry.function.__module__, []).append(entry)
    longest_first = sorted(modules.values(), key=len, reverse=True)
    found = context.run(partial(_run_module, seed=context.seed, out=out), longest_first)
    records = {record.entry.id: record for some in found for record in some}
    return [replace(records[entry.id], entry=entry) for entry in entries]


def _run_module(entries: Sequence[Entry], seed: int, out: Path | None) -> list[Record]:
    """Records of a quick run without their drawings, which stay in the process that drew them."""
    context = Context(True, seed)
    records = (_run_one(entry, context, out) for entry in entries)
    return [replace(record, outcome=replace(record.outcome, figure=None)) for record in records]


def _run_one(entry: Entry, context: Context, out: Path | None) -> Record:
    start, context.flown = time.perf_counter(), 0
    try:
        outcome = entry.function(context)
        figure = save_figure(outcome.figure, out, entry.id) if out is not None and outcome.figure is not None else None
    except Exception as error:  # one broken result must not hide the others
        outcome = Outcome("-", CRASHED, f"{type(error).__name__}: {error}")
        return Record(entry, outcome, time.perf_counter() - start, None, traceback.format_exc())
    return Record(entry, outcome, time.perf_counter() - start, figure, seeds=context.flown)


def save_figure(draw: DrawFunction, out: Path, name: str) -> str:
    """Draw a figure to ``out/figures/<name>.png`` without any display; return its path relative to ``out``.

    The picture has few colours and no version inside, so that it is small and equal results stay equal files.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=FIGURE_INCHES, dpi=FIGURE_DPI, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    draw(figure)
    canvas.draw()
    path = Path(FIGURES) / f"{name}.png"
    (out / FIGURES).mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(COLOURS).save(out / path, optimize=True)
    return path.as_posix()
