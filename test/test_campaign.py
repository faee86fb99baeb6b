"""Campaigns: the same numbers whatever the number of workers, in the order of the cases."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.reproduce.gebre.magnetometer import CASES, two_step_case
from lowcostnav_ros.studies.campaign import CampaignError, count, executor, parse_workers, run_campaign, run_on


def draw(seed):
    """One case: a number that depends on the seed alone."""
    if seed < 0:
        raise ValueError("negative seed")
    return float(np.random.default_rng(seed).normal())


def test_processes_give_the_numbers_of_one_process_in_order():
    cases = [5, 3, 9, 1]
    expected = [float(np.random.default_rng(seed).normal()) for seed in cases]
    assert run_campaign(draw, cases, workers=1) == expected
    assert run_campaign(draw, cases, workers=2) == expected


def test_a_failing_case_is_named():
    with pytest.raises(CampaignError, match=r"Case 1 \(-4\) failed: negative seed"):
        run_campaign(draw, [1, -4], workers=1)


def test_no_cases_no_results():
    assert run_campaign(draw, []) == []


def test_any_executor_keeps_the_order_and_names_the_case_that_failed():
    with ThreadPoolExecutor(3) as pool:
        assert run_on(pool, abs, range(-9, 0)) == list(range(9, 0, -1))
        with pytest.raises(CampaignError, match=r"Case 2 \(-7\) failed: negative seed"):
            run_on(pool, draw, [0, 1, -7, 3])


def test_who_shares_the_work():
    assert parse_workers("3") == 3 and parse_workers("tcp://there:8786") == "tcp://there:8786" and count(3) == 3 and count(None) >= 1
    for text in ("0", "-1", "many", "1.5", ""):
        with pytest.raises(SettingsError, match="takes a number of processes, or the address"):
            parse_workers(text)


def test_a_dask_cluster_gives_the_same_numbers():
    distributed = pytest.importorskip("distributed", reason="the cluster extra is not installed")
    cases = [(CASES[k % 4], 2, 100 + k) for k in range(4)]
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as local:
        address = local.scheduler_address
        assert count(address) == 2
        for (a, _), (b, _) in zip(run_campaign(two_step_case, cases, address), run_campaign(two_step_case, cases, 1), strict=True):
            np.testing.assert_array_equal(a, b)
        with pytest.raises(CampaignError, match="negative seed"):
            run_campaign(draw, [1, -4], address)


def test_no_scheduler_at_the_address_is_refused_with_a_sentence(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the cluster extra is not installed")

    def unanswered(*_, **__):
        raise OSError("timed out")

    monkeypatch.setattr(distributed, "Client", unanswered)
    with pytest.raises(SettingsError, match="No dask scheduler answers"), executor("tcp://127.0.0.1:1"):
        pass
