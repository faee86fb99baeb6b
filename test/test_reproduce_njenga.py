"""Results on the MEMS reference and GPS: cheap verdicts, figures that draw, and the flight against what it is made of."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from lowcostnav_ros.base.units import STANDARD_GRAVITY
from lowcostnav_ros.reproduce.njenga import flights
from lowcostnav_ros.reproduce.registry import BY_DEFINITION, FITTED, REPRODUCED, Context, all_results

MINE = {entry.id: entry for entry in all_results() if entry.study == "njenga"}
CHEAP = {"NR1": FITTED, "NR2": FITTED, "NR19": BY_DEFINITION, "NR20": BY_DEFINITION}
CHEAP |= dict.fromkeys(("NR3", "NR4", "NR7", "NR8", "NR9", "NR14", "NR15"), REPRODUCED)


def test_every_result_of_the_thesis_is_registered():
    assert set(MINE) == {f"NR{k}" for k in range(1, 21)}


@pytest.mark.parametrize("name", CHEAP)
def test_verdicts_hold_and_figures_draw(name):
    outcome = MINE[name].function(Context(quick=True))
    assert outcome.verdict == CHEAP[name]
    if outcome.figure is not None:
        figure = Figure()
        outcome.figure(figure)
        assert all(ax.has_data() for ax in figure.axes)


def test_the_flight_is_what_it_says():
    """Acceleration, velocity and position belong together; the reference feels gravity less acceleration and its biases."""
    flight = flights.path()
    gained = flights.STEP_S * 0.5 * (flight.accel[1:] + flight.accel[:-1])
    assert np.abs(np.diff(flight.velocity, axis=0) - gained).max() < 0.05  # ft/s
    assert -flight.position[-1, 2] == pytest.approx(flights.RUNWAY, abs=60.0)
    level = flights.samples(flights.Case())[:2000]
    mean = np.mean([a.specific_force_b for a in level], axis=0) / STANDARD_GRAVITY
    assert mean == pytest.approx(flights.BIAS_G + [0.0, 0.0, 1.0], abs=3e-4)
    assert np.abs(flights.BIAS_G - [-1.12e-3, -0.16e-3, 6.82e-3]).max() < 1e-5
