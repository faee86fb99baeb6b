"""DOPs, selection, schedules, error budget and accuracy against closed forms, brute force and Monte Carlo."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.gnss import GnssError, accuracy, error_budget, selection
from lowcostnav_ros.gnss.canyon import Canyon
from lowcostnav_ros.gnss.dop import design, dops, los_n
from lowcostnav_ros.gnss.observability import observability_matrix
from lowcostnav_ros.gnss.visibility import FOUR_GAPS, FULL_AVAILABILITY, Schedule, above, choose

SEEDS = st.integers(min_value=0, max_value=10_000)


def sky(seed, n):
    rng = np.random.default_rng(seed)
    return los_n(rng.uniform(0.0, 2.0 * math.pi, n), np.arcsin(rng.uniform(0.05, 1.0, n)))


def test_best_four_satellites_have_the_closed_form():
    los = los_n(np.radians([0.0, 0.0, 120.0, 240.0]), np.radians([90.0, 0.0, 0.0, 0.0]))
    d = dops(los)
    assert (d.gdop, d.pdop, d.hdop, d.tdop) == pytest.approx((math.sqrt(3.0), math.sqrt(8 / 3), math.sqrt(4 / 3), math.sqrt(1 / 3)))
    assert d.edop == pytest.approx(d.ndop)


@given(SEEDS)
def test_dops_add_up_and_one_more_satellite_never_harms(seed):
    los = sky(seed, 9)
    more, less = dops(los), dops(los[:8])
    assert more.gdop**2 == pytest.approx(more.pdop**2 + more.tdop**2)
    assert more.hdop**2 == pytest.approx(more.edop**2 + more.ndop**2)
    assert all(getattr(more, name) <= getattr(less, name) * (1 + 1e-9) for name in more.__dataclass_fields__)
    effective = dops(los, 2.25 * np.eye(9), sigma_m=1.5)
    assert effective.gdop == pytest.approx(more.gdop)


def test_no_solution_is_infinite_and_not_an_exception():
    cone = los_n(np.radians([0.0, 80.0, 150.0, 200.0, 300.0]), np.full(5, 0.5))  # one elevation: height and clock are one
    assert math.isinf(dops(cone).gdop)
    assert math.isinf(dops(sky(1, 3)).vdop)


@given(SEEDS, st.integers(min_value=5, max_value=9), st.integers(min_value=4, max_value=8))
def test_selection_is_the_best_of_all_combinations(seed, n, count):
    los = sky(seed, n)
    chosen = selection.select(los, count)
    if count >= n:
        assert chosen.tolist() == list(range(n))
        return
    best = min(np.trace(np.linalg.inv(design(los[list(k)]).T @ design(los[list(k)]))) for k in itertools.combinations(range(n), count))
    assert dops(los[chosen]).gdop == pytest.approx(math.sqrt(best), rel=1e-6)


def test_many_satellites_are_dropped_one_at_a_time_and_nearly_as_well():
    los = sky(7, 14)
    greedy = selection._drop_one_at_a_time(selection._outer_products(np.ascontiguousarray(los)), 9)
    exact = selection.select(los, 9)
    assert dops(los[exact]).gdop <= dops(los[greedy]).gdop <= 1.05 * dops(los[exact]).gdop
    assert len(set(selection.select(sky(7, 30), 9).tolist())) == 9


def test_selection_of_fewer_than_four_is_refused_and_the_schedule_takes_the_highest():
    with pytest.raises(GnssError, match="take the highest"):
        selection.select(sky(1, 6), 3)
    elevation = np.array([0.1, 0.9, 0.4, 1.2])
    los = los_n(np.arange(4.0), elevation)
    assert choose(los, elevation, 2).tolist() == [1, 3]
    assert choose(los, elevation, 0).tolist() == []
    assert choose(los, elevation, None).tolist() == [0, 1, 2, 3]
    assert above(elevation, 0.4).tolist() == [1, 2, 3]


def test_schedules():
    full, gaps = Schedule.of(FULL_AVAILABILITY), Schedule.of(FOUR_GAPS)
    assert np.mean([full.at(t) for t in range(600)]) == pytest.approx((8 * 600 + 60 - 2 * 66 - 3 * 60) / 600)
    assert [gaps.at(t) for t in (0, 119.9, 120, 160, 250, 370, 519, 521)] == [6, 6, 3, 6, 2, 1, 0, 6]
    assert Schedule.of([]).at(3.0) is None
    assert Schedule.of([10.0, 4]).at(3.0) is None
    for flat, match in (([0.0], "missing count"), ([5.0, 4, 5.0, 3], "must increase"), ([0.0, 1.5], "whole numbers")):
        with pytest.raises(GnssError, match=match):
            Schedule.of(flat)


def test_canyon_mask():
    canyon = Canyon()
    assert math.degrees(canyon.mask(500.0)) == pytest.approx(45.0)
    assert canyon.mask(1000.0) == canyon.mask(5000.0) == 0.0


def test_range_noise_has_its_covariance():
    rng, elevation = np.random.default_rng(3), np.radians([5.0, 20.0, 45.0, 90.0])
    draws = np.array([error_budget.range_noise(elevation, 5.5, rng.standard_normal(4), rng.standard_normal()) for _ in range(20_000)])
    R = error_budget.range_covariance(elevation, 5.5)
    assert np.cov(draws.T) == pytest.approx(R, abs=0.03 * R.max())
    f = 1.1 / (np.sin(elevation) + 0.1)
    assert np.diag(R) == pytest.approx((7.0 + f**2) * 5.5**2 / 8.0)
    assert R[3, 3] == pytest.approx(5.5**2)


def test_a_negative_elevation_is_refused():
    with pytest.raises(GnssError, match="elevation of -2.0 deg"):
        error_budget.range_covariance(np.radians([30.0, -2.0]), 1.0)
    with pytest.raises(GnssError, match="above the horizon"):
        error_budget.obliquity(np.array([math.nan]))


@pytest.mark.parametrize(
    ("band", "case", "printed"),
    [("8 MHz", "typical", 5.27), ("24 MHz", "typical", 4.71), ("8 MHz", "worst", 11.29), ("24 MHz", "worst", 8.86)],
)
def test_combined_error_of_both_systems(band, case, printed):
    gps, galileo = (error_budget.UERE_TABLE_M[system, band, case] for system in ("GPS", "Galileo"))
    assert error_budget.combined_error(gps, galileo, 1.12) == pytest.approx(printed, abs=6e-3)


def test_categories_relative_errors_and_protection_factors():
    assert [accuracy.category(h, v) for h, v in ((4.0, 0.5), (4.0, 1.5), (17.0, 4.0), (17.0, 4.2))] == ["III", "II", "I", ""]
    assert accuracy.relative_error(0.9, 1.0) == pytest.approx(0.1)
    assert accuracy.relative_error(0.2, 0.0) == pytest.approx(0.2)
    horizontal, vertical = accuracy.SERVICES["SOL"].protection_factors()
    assert math.exp(-0.5 * horizontal**2) == pytest.approx(1.75e-7)  # a circular Gaussian error beyond it
    assert math.erfc(vertical / math.sqrt(2.0)) == pytest.approx(1.75e-7)


def test_observability_of_position_velocity_and_an_unconnected_state():
    F = np.zeros((3, 3))
    F[0, 1] = 1.0
    position = np.array([[1.0, 0.0, 0.0]])
    assert observability_matrix(F, position).shape == (3, 3)
    assert np.linalg.matrix_rank(observability_matrix(F, position)) == 2
    assert np.linalg.matrix_rank(observability_matrix(F, np.array([[0.0, 1.0, 0.0]]))) == 1
