"""The registered results of satellite geometry, canyon and load: verdicts and figures."""

import pytest
from matplotlib.figure import Figure

from lowcostnav_ros.reproduce import registry
from lowcostnav_ros.reproduce.registry import BY_DEFINITION, DIFFERS, REPRODUCED, Context


@pytest.fixture(scope="module")
def mine():
    """The entries of the module."""
    from lowcostnav_ros.reproduce.solimeno import gnss as solimeno_gnss

    return {e.id: e for e in registry._ENTRIES.values() if e.function.__module__ == solimeno_gnss.__name__}


@pytest.mark.parametrize("name", [f"SR{k}" for k in range(9, 22)])
def test_verdicts_hold_and_figures_draw(mine, name):
    outcome = mine[name].function(Context(quick=True))
    assert outcome.verdict == {"SR9": BY_DEFINITION, "SR12": DIFFERS}.get(name, REPRODUCED)
    figure = Figure()
    outcome.figure(figure)
    assert all(ax.has_data() for ax in figure.axes)


def test_thirteen_results_with_source_and_tolerance(mine):
    assert sorted(mine, key=lambda name: int(name[2:])) == [f"SR{k}" for k in range(9, 22)]
    assert all(e.study == "solimeno" and e.source and e.tolerance for e in mine.values())
