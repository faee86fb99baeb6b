"""Chi-square thresholds, central and not, from the closed form of the upper tail.

scipy.stats would do it too, but costs every node tens of megabytes and a second of start-up for a few numbers.
"""

import math
from collections.abc import Callable
from functools import lru_cache

_PRECISION = 1e-12


@lru_cache(maxsize=1024)
def threshold(probability: float, dof: int) -> float:
    """Value that a chi-square variable with ``dof`` degrees of freedom stays below with ``probability``."""
    return exceeded_with(1.0 - probability, dof)


@lru_cache(maxsize=1024)
def exceeded_with(probability: float, dof: int) -> float:
    """Value that a chi-square variable with ``dof`` degrees of freedom exceeds with ``probability``, which may be tiny."""
    return _falling_root(lambda x: upper_tail(x, dof), probability, dof + 1500.0)


def upper_tail(x: float, dof: int) -> float:
    """Probability that a chi-square value exceeds ``x`` (Abramowitz and Stegun 26.4.4, 26.4.5)."""
    odd = dof % 2
    tail = math.erfc(math.sqrt(0.5 * x)) if odd else math.exp(-0.5 * x)
    term = math.sqrt(2.0 * x / math.pi) * math.exp(-0.5 * x) if odd else 0.5 * x * math.exp(-0.5 * x)
    for k in range(odd, dof - 1 if odd else dof - 2, 2):
        tail += term
        term *= x / (k + 2) if odd else x / (k + 4)
    return tail


def lower_tail_noncentral(x: float, dof: int, noncentrality: float) -> float:
    """Probability that a non-central chi-square value stays below ``x``: central ones in Poisson weights (A. and S. 26.4.25)."""
    half = 0.5 * noncentrality
    if half <= 0.0:
        return 1.0 - upper_tail(x, dof)
    total, tail = 0.0, upper_tail(x, dof)
    for j in range(int(half + 12.0 * math.sqrt(half)) + 20):
        total += math.exp(j * math.log(half) - half - math.lgamma(j + 1)) * (1.0 - tail)
        n = 0.5 * (dof + 2 * j)
        tail += math.exp(n * math.log(0.5 * x) - 0.5 * x - math.lgamma(n + 1.0))  # two degrees of freedom more
    return total


@lru_cache(maxsize=1024)
def noncentrality(false_alarm: float, missed: float, dof: int) -> float:
    """Noncentrality at which a test with this false-alarm probability misses with probability ``missed``."""
    limit = exceeded_with(false_alarm, dof)
    return _falling_root(lambda value: lower_tail_noncentral(limit, dof, value), missed, 10.0 * limit + 1000.0)


def _falling_root(function: Callable[[float], float], value: float, high: float) -> float:
    """Argument at which a falling function has a value, by bisection from zero to ``high``."""
    low = 0.0
    while high - low > _PRECISION * high:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        low, high = (middle, high) if function(middle) > value else (low, middle)
    return high
