"""Multiplications and additions of one Kalman filter cycle (Solimeno 2007, section 5.4.2, Tables 5.3 and 5.4).

Counted are a dense prediction and update of n states with m measurements, without the evaluation of Jacobians.  The thesis sets m to
the number of satellites, though its filters use a pseudorange and a Doppler of each.
"""

from fractions import Fraction


def operations(n: int, m: int) -> int:
    """Multiplications and additions of a cycle with ``n`` states and ``m`` measurements."""
    multiplications = n**2 + 3 * n**3 + n * m + n * m**2 + m * n**2 + m * n**2 + n * m**2 + m * n**2
    products = (n - 1) * n + 3 * (n - 1) * n**2 + (m - 1) * n + (m - 1) * n * m + (m - 1) * n**2
    products += (n - 1) * n * m + (n - 1) * m**2 + (n - 1) * n * m
    sums = 2 * n**2 + n + m + m**2
    inverse = Fraction(5, 6) * m**3 + m**2 - Fraction(5, 6) * m + Fraction(4, 3) * m**3 - Fraction(3, 2) * m**2 + Fraction(1, 6) * m
    # the inverse has a half operation for odd m; the table rounds it up
    return int(multiplications + products + sums + inverse + Fraction(1, 2))
