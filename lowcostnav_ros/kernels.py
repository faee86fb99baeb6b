"""The one way this package compiles its hot paths.

``@kernel`` marks a small function on float64 arrays in the subset numba compiles.  The compiled code is cached on disk so a
node starts warm; with ``NUMBA_DISABLE_JIT=1`` the same source runs as plain Python for debugging and coverage.  IEEE rules are
kept (no fast-math): a replay must equal the flight to the last bit.
"""

from collections.abc import Callable
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable)


def kernel(function: F) -> F:
    """Compile ``function`` with numba: cached, IEEE arithmetic, numpy division rules."""
    return numba.njit(cache=True, fastmath=False, error_model="numpy")(function)
