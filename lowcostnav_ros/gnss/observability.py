"""How many states of a filter are observable: rank of the observability matrix (Solimeno 2007, section 7.4.3).

    K_o = [H', F'H', (F')^2 H', ..., (F')^(n-1) H']      with the continuous F; rank n means completely observable

The rank depends on units and tolerance: the thesis's ranks belong to radians, metres and seconds and the default tolerance of a
singular-value decomposition, and so is it here.
"""

import numpy as np


def observability_matrix(F: np.ndarray, H: np.ndarray) -> np.ndarray:
    """K_o, shape (n, n m), of continuous dynamics ``F`` (n, n) and measurement rows ``H`` (m, n)."""
    blocks = [np.asarray(H, float).T]
    for _ in range(len(F) - 1):
        blocks.append(np.asarray(F, float).T @ blocks[-1])
    return np.hstack(blocks)
