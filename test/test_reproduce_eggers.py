"""Results on GPS and air data: the flight generator and the estimator against worked numbers, cheap verdicts, figures that draw."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from lowcostnav_ros.reproduce.eggers.realisations import path
from lowcostnav_ros.reproduce.registry import BY_DEFINITION, DIFFERS, REPRODUCED, Context, all_results
from lowcostnav_ros.studies import air_corrections as study
from lowcostnav_ros.trajectory.load_factor import AirSeen, fly

MINE = {entry.id: entry for entry in all_results() if entry.study == "eggers"}
CHEAP = {"ER1": REPRODUCED, "ER2": REPRODUCED, "ER3": REPRODUCED, "ER5": REPRODUCED, "ER11": BY_DEFINITION, "ER12": BY_DEFINITION}
CHEAP |= {"ER13": BY_DEFINITION, "ER14": REPRODUCED, "ER30": REPRODUCED, "ER32": REPRODUCED, "ER33": REPRODUCED, "ER34": REPRODUCED}
CHEAP |= {"ER39": REPRODUCED, "ER10b": DIFFERS}


def test_every_result_of_the_thesis_is_registered():
    wanted = [f"ER{k}" for k in range(1, 42)] + ["ER10b", "ER19b", "ER20b", "ER23b"]
    assert not set(wanted) - set(MINE)


@pytest.mark.parametrize("name", CHEAP)
def test_verdicts_hold_and_figures_draw(name):
    context = Context(quick=True)
    outcome = MINE[name].function(context)
    assert outcome.verdict == CHEAP[name]
    if outcome.figure is not None:
        figure = Figure()
        outcome.figure(figure)
        assert all(ax.has_data() for ax in figure.axes)


def test_a_flight_of_load_factor_and_roll_against_the_listing():
    seen = path("listing", 180)
    rows = {
        1: (319.56098, 1.43678, 0.07783, -0.24376),
        30: (172.92645, 3.78529, -0.35748, 1.5216),
        180: (392.69974, 5.94004, -0.1083, -0.76738),
    }
    for step, numbers in rows.items():
        ours = [getattr(seen, name)[step - 1] for name in ("airspeed", "heading", "pitch", "bank")]
        assert ours == pytest.approx(numbers, abs=1e-5)
    level = fly(np.ones(5), np.zeros(5), np.array([300.0, 0.0, 0.0]), gravity=study.GRAVITY_KT_S)
    assert level.airspeed == pytest.approx(299.81627, abs=1e-5)
    assert level.pitch == pytest.approx(0.035)


def test_one_step_of_the_estimator_from_a_cold_start():
    """Worked through by hand from the listings."""
    one = [np.array([value]) for value in (1.0, 0.1, 0.5, 350.0, 0.05, 0.02)]
    seen = AirSeen(*one, np.zeros((1, 3)))
    truth_row = np.array([0.002, -0.0015, 0.001, 0.0006, 0.0005, 1.05, 4.7, 10.0, -10.0, 2.0])
    truth = study.Truth.of(seen, truth_row[None], 0.1)
    assert truth.velocity[0] == pytest.approx([184.72575968, 301.31084096, -20.80147842], abs=1e-8)
    twice = AirSeen(*(np.repeat(column, 2) for column in one), np.zeros((2, 3)))
    both = study.Truth.of(twice, np.tile(truth_row, (2, 1)), 0.1)
    run = study.estimate(both, both.velocity, study.final_tuning())
    assert run.predicted[0] == pytest.approx([171.47512407, 304.83365166, -22.99181569], abs=1e-8)
    assert run.residual_variance[0] == pytest.approx([113.347099, 139.088537, 101.767688], abs=1e-5)  # 0.99336 for exp(-1/150)
    after = [1.733e-5, -2.011e-5, -1.3736e-4, -8.19e-6, 1.23e-6, 1.01084465, 0.54244399, 12.66894913, -4.44176855, 2.24862509]
    assert run.estimates[1] == pytest.approx(after, abs=1e-6)


@pytest.mark.parametrize(("kind", "step"), [("markov 1", 2.04), ("markov 2", 1.005), ("sinusoidal", 2.16), ("ramp", 2.16)])
def test_four_winds(kind, step):
    blows = study.wind(kind, 20_000, np.random.default_rng(2))
    assert np.sqrt(np.mean(np.diff(blows, axis=0) ** 2)) == pytest.approx(step, rel=0.02)


def test_straight_flight_observes_little():
    """What turns observe and straight flight does not: scale and bias of the airspeed apart from the wind."""
    n, tuning = 300, study.final_tuning()
    turning = study.Truth.of(path("slow sines", n), study.true_corrections(n, np.zeros((n, 3))), 0.1)
    level = study.Truth.of(path("straight", n), study.true_corrections(n, np.zeros((n, 3))), 0.1)
    assert study.observability(turning, tuning, (5,))[0] < 0.3
    assert study.observability(level, tuning, (5,))[0] > 0.9
