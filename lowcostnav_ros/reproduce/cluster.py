"""Where a campaign runs: in processes of this machine, or on a dask cluster behind the same futures.

Every case carries its own seed and results keep the order of the cases, so the numbers are the same wherever it runs.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial
from typing import Any

from lowcostnav_ros.reproduce.registry import ReproduceError
from lowcostnav_ros.studies.campaign import CampaignError, run_campaign

Runner = Callable[[Callable[[Any], Any], Sequence[Any]], list]


@contextmanager
def runner(workers: int | None = None, cluster: str | None = None) -> Iterator[Runner]:
    """Give the function that runs campaigns, and release what it holds at the end.

    Parameters
    ----------
    workers : int, optional
        Processes on this machine; 1 works in this process, None takes every core.
    cluster : str, optional
        Address of a dask scheduler (``tcp://host:8786``), used instead of processes.

    Raises
    ------
    ReproduceError
        When dask is not installed or nothing answers at the address.
    """
    if cluster is None:
        yield partial(run_campaign, workers=workers)
        return
    client = _connect(cluster)
    try:
        yield partial(run_on, client.get_executor())
    finally:
        client.close()


def run_on(executor: Executor, function: Callable[[Any], Any], cases: Sequence[Any]) -> list:
    """Apply ``function`` to every case on any executor; results in the order of the cases.

    Raises
    ------
    CampaignError
        When a case fails; cases not yet begun are abandoned.
    """
    futures = [executor.submit(function, case) for case in cases]
    results = []
    for index, future in enumerate(futures):
        try:
            results.append(future.result())
        except Exception as error:
            for waiting in futures[index:]:
                waiting.cancel()
            raise CampaignError(f"Case {index} ({cases[index]!r}) failed: {error}") from error
    return results


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise ReproduceError("A cluster needs dask: pip install 'lowcostnav_ros[cluster]', or leave --cluster out.") from None
    try:
        return Client(address, timeout=10)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise ReproduceError(f"No dask scheduler answers at {address} ({error}); start one with 'dask scheduler'.") from error
