"""Run results one after the other, draw their figures, and keep what the page and the JSON need."""

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
    """Compute results in order.

    Parameters
    ----------
    entries : sequence of Entry
    context : Context
    out : Path, optional
        Directory that receives ``figures/<id>.png``; without it nothing is drawn.
    report : callable, optional
        Called with each record as it is finished.

    Returns
    -------
    list of Record
        A function that raises gives the verdict ``crashed``, and the others still run.
    """
    records = []
    for entry in entries:
        record = _run_one(entry, context, out)
        records.append(record)
        if report is not None:
            report(record)
    return records


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
