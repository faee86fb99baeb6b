"""The registered results of position fixing: verdicts, and table D.1 computed a second way."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from lowcostnav_ros.reproduce.gebre import fixing as gebre_fixing
from lowcostnav_ros.reproduce.registry import BY_DEFINITION, FITTED, NOT_IN_NUMBERS, REPRODUCED, Context, all_results

MINE = {entry.id: entry for entry in all_results() if entry.function.__module__ == gebre_fixing.__name__}


def test_all_eight_results_are_registered():
    assert list(MINE) == ["GR37", "GR38", "GR39", "GR49", "GR50", "GR51", "GR52", "GR54"]


@pytest.mark.parametrize("name", list(MINE))
def test_verdicts_hold_and_figures_draw(name):
    outcome = MINE[name].function(Context(quick=True))
    expected = {"GR50": FITTED, "GR51": BY_DEFINITION, "GR52": BY_DEFINITION, "GR54": NOT_IN_NUMBERS}
    assert outcome.verdict == expected.get(name, REPRODUCED)
    figure = Figure()
    outcome.figure(figure)
    assert all(ax.has_data() for ax in figure.axes)


def test_table_of_error_ellipses_by_plain_algebra():
    north, east = gebre_fixing.BACK_SOLVED_GUESS
    rows = []
    for (s_n, s_e), measured in (((8.6, -1.5), 13.9), ((7.6, 14.9), 24.7)):
        rows.append([(north - s_n) / measured, (east - s_e) / measured])
    for s_n, s_e in ((8.6, -1.5), (7.6, 14.9)):
        square = (north - s_n) ** 2 + (east - s_e) ** 2
        rows.append([-(east - s_e) / square, (north - s_n) / square])
    H, sigma = np.array(rows), np.array([0.1, 0.1, math.radians(1.0), math.radians(1.0)])
    ours = gebre_fixing.table_d1()
    for name, chosen in zip(gebre_fixing.TABLE_D1, ([0, 1], [0, 2], [1, 3], [2, 3], [0, 1, 2, 3]), strict=True):
        A = np.linalg.inv(H[chosen].T @ H[chosen]) @ H[chosen].T
        axes = np.sqrt(np.linalg.eigvalsh(A @ np.diag(sigma[chosen] ** 2) @ A.T))
        assert (ours[name].minor, ours[name].major) == pytest.approx(axes, rel=1e-9)
        assert axes == pytest.approx(gebre_fixing.TABLE_D1[name], abs=1.5e-4)  # a unit of the last digit


def test_circles_of_the_example_cross_where_the_radials_with_variation_point():
    fix, _ = gebre_fixing.crossing()
    assert fix == pytest.approx((-4.265, -6.764), abs=1e-3)
    for station, radial in ((gebre_fixing.STATION_A, 187.0), (gebre_fixing.STATION_B, 226.0)):
        bearing = math.degrees(math.atan2(fix[1] - station[1], fix[0] - station[0])) % 360.0
        assert bearing - radial == pytest.approx(15.2, abs=0.2)  # about 15 deg of easterly variation, not printed
