"""Campaigns: the same function over many cases on all cores, results in the order of the cases.

A case carries its own seed, so the numbers do not depend on how many processes share the work, nor on which one took which case.
"""

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

Case = TypeVar("Case")
Result = TypeVar("Result")


class CampaignError(RuntimeError):
    """A case failed; the message names it, the cause is chained."""


def run_campaign(
    function: Callable[[Case], Result], cases: Sequence[Case], workers: int | None = None, label: str = "campaign"
) -> list[Result]:
    """Apply ``function`` to every case.

    Parameters
    ----------
    function : callable
        Importable by name (a module-level function): the workers are fresh processes that inherit nothing.
    cases : sequence
        Picklable; each holds all the function needs, its seed included.
    workers : int, optional
        Processes; 1 runs in this process, None takes every core this process may use.
    label : str
        What the progress bar calls it.

    Returns
    -------
    list
        One result per case, in the order of the cases whatever the number of workers.

    Raises
    ------
    CampaignError
        When a case fails; cases not yet begun are abandoned.
    """
    workers = min(len(cases), workers or len(os.sched_getaffinity(0)))
    with _Progress(label, len(cases)) as progress:
        if workers <= 1:
            return [_one(function, cases, index, progress) for index in range(len(cases))]
        return _in_processes(function, cases, workers, progress)


def _one(function: Callable[[Case], Result], cases: Sequence[Case], index: int, progress: "_Progress") -> Result:
    try:
        result = function(cases[index])
    except Exception as error:
        raise CampaignError(f"Case {index} ({cases[index]!r}) failed: {error}") from error
    progress.step()
    return result


def _in_processes(function: Callable, cases: Sequence, workers: int, progress: "_Progress") -> list:
    results: list = [None] * len(cases)
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        futures = {pool.submit(function, case): index for index, case in enumerate(cases)}
        for future in as_completed(futures):
            index = futures[future]
            try:
                results[index] = future.result()
            except Exception as error:
                pool.shutdown(wait=False, cancel_futures=True)
                raise CampaignError(f"Case {index} ({cases[index]!r}) failed: {error}") from error
            progress.step()
    return results


class _Progress:
    """A progress bar on a terminal's stderr, nothing elsewhere."""

    def __init__(self, label: str, total: int) -> None:
        self._bar = None
        if sys.stderr.isatty() and total > 1:
            from rich.console import Console
            from rich.progress import Progress

            self._bar = Progress(console=Console(stderr=True))
            self._task = self._bar.add_task(label, total=total)

    def step(self) -> None:
        if self._bar is not None:
            self._bar.advance(self._task)

    def __enter__(self) -> "_Progress":
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
