"""Counts by phrase stay bounded, whatever they are counted by."""

import pickle

from lowcostnav_ros.base.tally import MOST, OTHERS, Tally


def test_further_keys_are_counted_as_others_and_nothing_is_lost():
    tally = Tally(["late", "late"])
    for k in range(10_000):
        tally[f"station {k}"] += 1
    assert tally["late"] == 2 and len(tally) == MOST + 1
    assert sum(tally.values()) == 10_002 and tally[OTHERS] == 10_001 - MOST
    tally["late"] += 5
    assert tally["late"] == 7


def test_an_assigned_count_of_a_further_key_adds_to_the_others():
    tally = Tally({(f"s{k}", "late"): 1 for k in range(MOST)}, others=(OTHERS, OTHERS))
    tally["gps/fix", "late"] += 3
    tally["gps/vel", "late"] += 2
    assert tally[OTHERS, OTHERS] == 5 and tally == tally.copy() == pickle.loads(pickle.dumps(tally))
