"""Results of the error models and calibrations, few runs, against the printed numbers; what must differ still differs."""

import pytest

from lowcostnav_ros.reproduce.registry import BY_DEFINITION, DIFFERS, FITTED, NOT_IN_NUMBERS, REPRODUCED, Context, selected

EXPECTED = {
    **{f"GR{k}": REPRODUCED for k in range(1, 23)},
    **{"GR9": NOT_IN_NUMBERS, "GR15": DIFFERS, "GR18": FITTED, "GR19": FITTED, "GR20": DIFFERS},
    **dict.fromkeys(("GR21", "GR22"), BY_DEFINITION),
}


@pytest.fixture(scope="module")
def context():
    return Context(quick=True)


@pytest.mark.parametrize("id", EXPECTED)
def test_verdict(context, id):
    (entry,) = selected([id])
    outcome = entry.function(context)
    assert outcome.verdict == EXPECTED[id], outcome
    assert any(character.isdigit() for character in outcome.ours)
