"""Campaigns: the same numbers whatever the number of workers, in the order of the cases."""

import numpy as np
import pytest

from lowcostnav_ros.studies.campaign import CampaignError, run_campaign


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
