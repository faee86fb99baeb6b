"""A progress bar on a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

LINE_EVERY_S, DRAWN_EVERY_S = 10.0, 0.1


@contextmanager
def progress_bar(label: str, in_lines: bool = False) -> Iterator[Callable[[float], None] | None]:
    """A bar on a terminal's stderr, fed with the share done; elsewhere None, so that logs stay clean, or now and then a line."""
    if not sys.stderr.isatty():
        yield _lines(label) if in_lines else None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, auto_refresh=False) as bar:  # without a thread, so that work may fork
        task = bar.add_task(label, total=1.0)
        drawn = [0.0]

        def advance(share: float) -> None:
            now = perf_counter()
            is_due = now - drawn[0] >= DRAWN_EVERY_S
            drawn[0] = now if is_due else drawn[0]
            bar.update(task, completed=share, refresh=is_due)

        yield advance


def _lines(label: str) -> Callable[[float], None]:
    """A line every :data:`LINE_EVERY_S`, with the time it may still take."""
    began = said = perf_counter()

    def advance(share: float) -> None:
        nonlocal said
        now = perf_counter()
        if now - said >= LINE_EVERY_S and share > 0.0:
            said = now
            print(f"{label}: {share:.0%}, {(now - began) * (1.0 / share - 1.0):.0f} s to go", file=sys.stderr, flush=True)

    return advance
