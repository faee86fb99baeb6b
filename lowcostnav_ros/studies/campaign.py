"""Campaigns: the same function over many cases on all cores, results in the order of the cases.

A case carries its own seed, so the numbers do not depend on how many processes share the work, nor on which one took which case.
"""

import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
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
    from rich.console import Console
    from rich.progress import Progress

    workers = min(len(cases), workers or len(os.sched_getaffinity(0)))
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty() or len(cases) < 2) as bar:
        step = partial(bar.advance, bar.add_task(label, total=len(cases)))
        if workers <= 1:
            return [_one(function, cases, index, step) for index in range(len(cases))]
        return _in_processes(function, cases, workers, step)


def _one(function: Callable[[Case], Result], cases: Sequence[Case], index: int, step: Callable[[], None]) -> Result:
    try:
        result = function(cases[index])
    except Exception as error:
        raise CampaignError(f"Case {index} ({cases[index]!r}) failed: {error}") from error
    step()
    return result


def _in_processes(function: Callable, cases: Sequence, workers: int, step: Callable[[], None]) -> list:
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
            step()
    return results
