"""Small helpers for the figures of results: the axes readers of a thesis expect, one look for all."""

from collections.abc import Sequence
from typing import Any

import numpy as np

LABEL, SMALL = 9, 8


def axes(figure: Any, position: tuple[int, int, int] = (1, 1, 1), *, x: str, y: str, title: str = "", log: bool = False) -> Any:
    """Add axes with labels (units included), a light grid and an optional title; ``log`` makes both axes logarithmic."""
    made = figure.add_subplot(*position)
    made.set_xlabel(x, fontsize=LABEL)
    made.set_ylabel(y, fontsize=LABEL)
    made.tick_params(labelsize=SMALL)
    made.grid(True, which="both" if log else "major", linewidth=0.4, alpha=0.5)
    if title:
        made.set_title(title, fontsize=LABEL)
    if log:
        made.set_xscale("log")
        made.set_yscale("log")
    return made


def legend(made: Any, **options: Any) -> None:
    """Add a small legend."""
    made.legend(fontsize=SMALL, framealpha=0.8, **options)


def histogram(made: Any, samples: Sequence[np.ndarray], labels: Sequence[str], bins: int = 40) -> None:
    """Overlay the outlines of several histograms on common bins."""
    low = min(float(np.min(s)) for s in samples)
    high = max(float(np.max(s)) for s in samples)
    edges = np.linspace(low, high, bins + 1)
    for values, label in zip(samples, labels, strict=True):
        made.hist(values, bins=edges, histtype="step", label=label, linewidth=1.2)
    made.locator_params(axis="x", nbins=4)
