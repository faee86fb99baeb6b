"""An inertial core whose heading is not known, as a mixture of cores that each know theirs: splitting, moments, merging.

A filter linear in the heading error describes an error of some 30 deg.  A wider distribution is cut into cells of :data:`WIDTH`; each cell
is a core of its own with the mean and the covariance that the others' states have given a heading there (Alspach and Sorenson, "Nonlinear
Bayesian estimation using Gaussian sum approximations", IEEE TAC 17, 1972).  Headings are counted from a reference attitude, round the
vertical, so that cores which differ by a turn about it are of one tilt; what hangs together in the body turns with them
(:func:`.inertial.turn_covariance`).
"""

import math
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.cores.inertial import ATT, POS, VEL, InertialCore, turn_covariance
from lowcostnav_ros.physics.earth import difference_n, displace
from lowcostnav_ros.physics.rotation import TWO_PI, quat_apply_phi_n, quat_conjugate, quat_multiply, rotvec_from_quat, wrap

CELLS = 12
WIDTH = TWO_PI / CELLS
NEGLIGIBLE = 1e-5
"""Share of the whole below which a core is not worth its cost."""
UNKNOWN = 1.5
"""Sigma, rad, from which on a heading is any heading: a wrapped normal distribution of twice the sigma is flat."""
FLAT = 0.05
"""Resultant length of directions below which they have no mean."""
REACH = 4.0
HEADING = 8


def about_down(angle: float) -> np.ndarray:
    """Quaternion (4,) of a turn about the vertical, rad."""
    return np.array([math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)])


def turned_from(q_nb: np.ndarray, reference: np.ndarray) -> tuple[float, np.ndarray]:
    """Turn about the vertical, rad, that follows the small tilt (3,), rad in n, on the way from a reference attitude to ``q_nb``."""
    between = quat_multiply(q_nb, quat_conjugate(reference))
    turn = float(wrap(2.0 * math.atan2(between[3], between[0])))
    return turn, rotvec_from_quat(quat_multiply(quat_conjugate(about_down(turn)), between))


def apart(core: InertialCore, nav: np.ndarray, estimate: np.ndarray) -> np.ndarray:
    """How far the state of a core is from another (n,), in the coordinates of its error state; tilt as seen before the turn."""
    out = core.estimate - estimate
    out[POS] = difference_n(core.nav[0], core.nav[1], core.nav[2], nav[0], nav[1], nav[2])
    out[VEL] = core.nav[VEL] - nav[VEL]
    turn, out[ATT] = turned_from(core.nav[6:10], nav[6:10])
    out[HEADING] += turn
    return out


def mean_turn(shares: np.ndarray, turns: np.ndarray) -> float:
    """Mean of directions, rad; of such as point everywhere the reference itself."""
    north, east = float(shares @ np.cos(turns)), float(shares @ np.sin(turns))
    centre = math.atan2(east, north) if math.hypot(north, east) > FLAT else 0.0
    return centre + float(shares @ wrap(turns - centre))


def merged(shares: np.ndarray, cores: Sequence[InertialCore], into: InertialCore) -> np.ndarray:
    """Give ``into`` mean and covariance of a mixture of cores of its time; return by how much it moved (n,).  Shares (k,) add up to 1."""
    turn = mean_turn(shares, np.array([turned_from(core.nav[6:10], into.nav[6:10])[0] for core in cores]))
    middle = into.nav.copy()
    middle[6:10] = quat_multiply(about_down(turn), middle[6:10])
    offsets = np.array([apart(core, middle, into.estimate) for core in cores])
    moved = shares @ offsets
    offsets -= moved
    P = np.zeros_like(into.P)
    for share, offset, core in zip(shares, offsets, cores, strict=True):
        own = core.P.copy()
        turn_covariance(own, -offset[HEADING])
        P += share * (own + np.outer(offset, offset))
    into.nav[0:3] = displace(middle[0], middle[1], middle[2], moved[POS])
    into.nav[VEL] = middle[VEL] + moved[VEL]
    into.nav[6:10] = quat_apply_phi_n(middle[6:10], moved[ATT])
    into.estimate += np.where(np.arange(len(moved)) < ATT.stop, 0.0, moved)
    into.P[:] = P
    moved[HEADING] += turn
    return moved


def normal(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distribution and density of the standard normal at edges in sigmas."""
    return np.array([0.5 * math.erfc(-x / math.sqrt(2.0)) for x in edges]), np.exp(-0.5 * edges**2) / math.sqrt(TWO_PI)


def cut(core: InertialCore, reference: np.ndarray) -> list[tuple[int, float, InertialCore]]:
    """The core in pieces, each of one cell: the cell's number, counted from a reference attitude, its share and the piece."""
    P = core.P.copy()
    if P[HEADING, HEADING] > UNKNOWN**2:
        P[HEADING, HEADING] = max(P[HEADING, HEADING], math.pi**2)
    sigma, at = math.sqrt(P[HEADING, HEADING]), turned_from(core.nav[6:10], reference)[0]
    first, last = math.floor((at - REACH * sigma) / WIDTH), math.ceil((at + REACH * sigma) / WIDTH)
    below, density = normal((np.arange(first, last + 1) * WIDTH - at) / sigma)
    gain, pieces = P[:, HEADING] / P[HEADING, HEADING], []
    for k in range(last - first):
        share = below[k + 1] - below[k]
        if share < NEGLIGIBLE:
            continue
        mean = (density[k] - density[k + 1]) / share
        a, b = ((first + k + i) * WIDTH - at for i in (0, 1))
        variance = 1.0 + (a / sigma * density[k] - b / sigma * density[k + 1]) / share - mean**2
        piece = core.branch()
        piece.P = P + np.outer(gain, gain) * sigma**2 * (max(variance, 0.0) - 1.0)
        piece.correct(gain * sigma * mean)
        pieces.append(((first + k) % CELLS, float(share), piece))
    return pieces


def spread(shares: np.ndarray, cores: Sequence[InertialCore], reference: np.ndarray) -> tuple[np.ndarray, list[InertialCore]]:
    """The same mixture with one core a cell: each cut by cells, and what comes to lie in one cell merged."""
    cells: dict[int, list[tuple[float, InertialCore]]] = {}
    for share, core in zip(shares, cores, strict=True):
        for cell, part, piece in cut(core, reference):
            cells.setdefault(cell, []).append((float(share) * part, piece))
    found = []
    for _, pieces in sorted(cells.items()):
        whole = sum(share for share, _ in pieces)
        if whole >= NEGLIGIBLE:
            one = pieces[0][1]
            if len(pieces) > 1:
                twin = one.branch()
                merged(np.array([share / whole for share, _ in pieces]), [piece for _, piece in pieces], twin)
                one = twin
            found.append((whole, one))
    total = sum(whole for whole, _ in found)
    return np.array([whole / total for whole, _ in found]), [one for _, one in found]
