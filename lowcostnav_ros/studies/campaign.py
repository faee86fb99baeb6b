"""Campaigns: the same function over many cases on all cores, or on a dask cluster; results in the order of the cases.

A case carries its own seed, so the numbers do not depend on how many processes share the work, nor on which one took which case.
"""

import multiprocessing
import os
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, as_completed, wait
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar

from lowcostnav_ros.base.settings import SettingsError

Case = TypeVar("Case")
Result = TypeVar("Result")
Workers = int | str | None
"""Who shares the work: so many processes, all cores of this machine (None), or those of the dask scheduler at an address."""


AHEAD = 3
"""Cases that each other process is given at once, while there are so many: one that it works on, and what it goes on with."""


class CampaignError(RuntimeError):
    """A case failed; the message names it, the cause is chained."""


def parse_workers(text: str) -> int | str:
    """Return what an option says of who shares the work: a number of processes, or the address of a scheduler (``tcp://host:8786``).

    Raises
    ------
    SettingsError
        When it is neither.
    """
    if "://" in text:
        return text
    if not text.isdecimal() or int(text) < 1:
        raise SettingsError(f"--workers takes a number of processes, or the address of a dask scheduler (tcp://host:8786), not '{text}'.")
    return int(text)


def run_campaign(
    function: Callable[[Case], Result], cases: Sequence[Case], workers: Workers = None, label: str = "campaign"
) -> list[Result]:
    """Apply ``function`` to every case.

    Parameters
    ----------
    function : callable
        Importable by name (a module-level function): the workers are this process and fresh ones that inherit nothing.
    cases : sequence
        Picklable; each holds all the function needs, its seed included.
    workers : int or str, optional
        Processes, 1 for this one, or the address of a dask scheduler; None takes every core this process may use.
    label : str
        What the progress bar calls it.

    Returns
    -------
    list
        One result per case, in the order of the cases whoever has worked.

    Raises
    ------
    CampaignError
        When a case fails; cases not yet begun are abandoned.
    SettingsError
        When no scheduler answers at the address.
    """
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty() or len(cases) < 2) as bar:
        step = partial(bar.advance, bar.add_task(label, total=len(cases)))
        if isinstance(workers, str):
            with executor(workers) as cluster:
                return run_on(cluster, function, cases, step)
        workers = min(len(cases), workers or cores())
        if workers <= 1:
            return [_one(function, cases, index, step) for index in range(len(cases))]
        with executor(workers - 1) as others:
            return _run_with(others, workers - 1, function, cases, step)


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))


def count(workers: Workers) -> int:
    """How many cases are worked on at once.

    Raises
    ------
    SettingsError
        When no scheduler answers at the address.
    """
    if not isinstance(workers, str):
        return workers or cores()
    with _connected(workers) as client:
        return sum(client.nthreads().values()) or 1


@contextmanager
def executor(workers: Workers) -> Iterator[Executor]:
    """Give the executor that these workers are.

    Raises
    ------
    SettingsError
        When dask is not installed or nothing answers at the address.
    """
    if isinstance(workers, str):
        with _connected(workers) as client:
            yield client.get_executor()
        return
    with ProcessPoolExecutor(workers or cores(), mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def run_on(pool: Executor, function: Callable, cases: Sequence, step: Callable[[], None] = lambda: None) -> list:
    """Apply ``function`` to every case on any executor; results in the order of the cases.

    Raises
    ------
    CampaignError
        When a case fails; cases not yet begun are abandoned.
    """
    results: list = [None] * len(cases)
    futures = {pool.submit(function, case): index for index, case in enumerate(cases)}
    for future in as_completed(futures):
        index = futures[future]
        try:
            results[index] = future.result()
        except Exception as error:
            for waiting in futures:
                waiting.cancel()
            raise CampaignError(f"Case {index} ({cases[index]!r}) failed: {error}") from error
        step()
    return results


def _run_with(pool: Executor, others: int, function: Callable, cases: Sequence, step: Callable[[], None]) -> list:
    """The same by this process, too, which has imported all and would wait otherwise; it takes cases as they are, one at a time."""
    results, waiting, futures = [None] * len(cases), deque(range(len(cases))), dict[Future, int]()
    while waiting or futures:
        left = len(waiting) + len(futures)
        while waiting and len(futures) < others * min(AHEAD, -(-left // (others + 1))):
            index = waiting.popleft()
            futures[pool.submit(function, cases[index])] = index
        if waiting:
            index = waiting.pop()
            results[index] = _one(function, cases, index, step)
        for future in wait(futures, 0 if waiting else None, FIRST_COMPLETED).done:
            index = futures.pop(future)
            results[index] = _one(partial(_result_of, future), cases, index, step)
    return results


def _result_of(future: Future, _case: Any) -> Any:
    return future.result()


def _one(function: Callable[[Case], Result], cases: Sequence[Case], index: int, step: Callable[[], None]) -> Result:
    try:
        result = function(cases[index])
    except Exception as error:
        raise CampaignError(f"Case {index} ({cases[index]!r}) failed: {error}") from error
    step()
    return result


def _connected(address: str) -> Any:
    """A client of the scheduler at an address, to be closed."""
    try:
        from distributed import Client
    except ImportError:
        raise SettingsError("A cluster needs dask: pip install 'lowcostnav_ros[cluster]', or give a number of processes.") from None
    try:
        return Client(address, timeout=10)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise SettingsError(f"No dask scheduler answers at {address} ({error}); start one with 'dask scheduler'.") from error
