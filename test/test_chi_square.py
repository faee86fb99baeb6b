"""Chi-square thresholds against scipy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from lowcostnav_ros.base import chi_square


@given(st.floats(1e-10, 0.99), st.integers(1, 60))
def test_thresholds_equal_scipys(probability, dof):
    assert chi_square.exceeded_with(probability, dof) == pytest.approx(chi2.isf(probability, dof), rel=1e-7, abs=1e-9)
    assert chi_square.threshold(0.999, dof) == pytest.approx(chi2.ppf(0.999, dof), rel=1e-9)


@given(st.floats(0.01, 200.0), st.integers(1, 40), st.floats(0.0, 300.0))
def test_the_noncentral_distribution_equals_scipys(x, dof, noncentrality):
    assert chi_square.lower_tail_noncentral(x, dof, noncentrality) == pytest.approx(ncx2.cdf(x, dof, max(noncentrality, 1e-12)), abs=1e-9)


@pytest.mark.parametrize(("false_alarm", "missed", "dof"), [(6.67e-5, 1e-3, 1), (1e-8, 1e-3, 5), (1e-8, 1e-5, 12), (0.05, 0.2, 4)])
def test_the_noncentrality_makes_the_test_miss_as_often_as_asked(false_alarm, missed, dof):
    limit = chi2.isf(false_alarm, dof)
    expected = brentq(lambda value: ncx2.cdf(limit, dof, value) - missed, 1e-6, 1000.0, xtol=1e-10)
    assert chi_square.noncentrality(false_alarm, missed, dof) == pytest.approx(expected, rel=1e-7)
