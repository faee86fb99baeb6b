"""A network of ground transmitters: dilution of precision, positions from code alone, and where the next transmitter helps most.

Row of a transmitter: [-(p - u)/r, 1] in north, east, down and clock; D = (H'H)^-1 (Kawecki 2015, equations (4.3), (4.4)).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.stations import Station

ENOUGH = 4
"""Transmitters from which position and clock follow."""
SINGULAR = 1e10
CLOSE_M = 1e-4
MOST_STEPS = 20


class NoFix(ValueError):
    """Code ranges that give no position; the message says why."""


@dataclass(frozen=True, slots=True)
class Dilution:
    """Dilutions of precision: position, horizontal, vertical, time; ``inf`` where there is no solution."""

    pdop: float = math.inf
    hdop: float = math.inf
    vdop: float = math.inf
    tdop: float = math.inf


def places_of(stations: Sequence[Station], frame: LocalFrame) -> np.ndarray:
    """Places (n, 3) of stations, m NED of a local frame."""
    return np.array([frame.to_ned(s.lat, s.lon, s.height) for s in stations])


def dilution(place: np.ndarray, transmitters: np.ndarray, clock: bool = True) -> Dilution:
    """Dilution at a place (3,) of transmitters (n, 3), m NED; two-way ranges need no ``clock``."""
    away = transmitters - place
    rows = -away / np.linalg.norm(away, axis=1, keepdims=True)
    H = np.column_stack([rows, np.ones(len(rows))]) if clock else rows
    normal = H.T @ H
    if len(H) < H.shape[1] or np.linalg.cond(normal) > SINGULAR:
        return Dilution()
    d = np.linalg.inv(normal).diagonal()
    return Dilution(math.sqrt(d[:3].sum()), math.sqrt(d[0] + d[1]), math.sqrt(d[2]), math.sqrt(d[3]) if clock else 0.0)


def dilutions(places: np.ndarray, transmitters: np.ndarray, reach_m: np.ndarray | None = None, clock: bool = True) -> list[Dilution]:
    """Dilution at each place (k, 3), of the transmitters (n, 3) received there: within ``reach_m`` (n, 2)."""
    out = []
    for place in places:
        received = np.ones(len(transmitters), bool)
        if reach_m is not None:
            ranges = np.linalg.norm(transmitters - place, axis=1)
            received = (ranges >= reach_m[:, 0]) & (ranges <= reach_m[:, 1])
        out.append(dilution(place, transmitters[received], clock) if received.any() else Dilution())
    return out


def best_next(places: np.ndarray, transmitters: np.ndarray, sites: np.ndarray, clock: bool = True) -> tuple[int, float]:
    """Index of the site (m, 3) whose transmitter lowers the root mean square PDOP over places (k, 3) most, and that PDOP.

    Where the network gives no position at some place, fewest such places count first.
    """

    def worth(site: np.ndarray) -> tuple[int, float]:
        found = np.array([d.pdop for d in dilutions(places, np.vstack([transmitters, site]), clock=clock)])
        solved = np.isfinite(found)
        return int(np.count_nonzero(~solved)), float(np.sqrt(np.mean(found[solved] ** 2))) if solved.any() else math.inf

    scores = [worth(site) for site in sites]
    best = min(range(len(sites)), key=scores.__getitem__)
    return best, scores[best][1]


@dataclass(frozen=True, slots=True, eq=False)
class CodeFix:
    """Position (3,) m NED of the frame, clock m, and the covariance (4, 4) of both for a code sigma of 1 m; residuals (n,) m."""

    place: np.ndarray
    clock_m: float
    covariance: np.ndarray
    residuals: np.ndarray


def fix_from_code(transmitters: np.ndarray, code_m: np.ndarray, first: np.ndarray) -> CodeFix:
    """Batch least squares on code alone: position and clock by Gauss and Newton until the step is below 0.1 mm.

    Parameters
    ----------
    transmitters : ndarray, shape (n, 3)
        M, in a Cartesian frame.
    code_m : ndarray, shape (n,)
        Code, troposphere taken off, m.
    first : ndarray, shape (3,)
        Where to begin.  A network on the ground has a mirror image of every place; begin above it.

    Raises
    ------
    NoFix
        For fewer than four transmitters, a geometry without a solution, or steps that do not end.
    """
    if len(code_m) < ENOUGH:
        raise NoFix(f"{len(code_m)} transmitters; a position takes {ENOUGH}")
    x = np.append(np.asarray(first, float), 0.0)
    for _ in range(MOST_STEPS):
        away = transmitters - x[:3]
        ranges = np.linalg.norm(away, axis=1)
        H = np.column_stack([-away / ranges[:, None], np.ones(len(ranges))])
        residuals = code_m - ranges - x[3]
        normal = H.T @ H
        if np.linalg.cond(normal) > SINGULAR:
            raise NoFix("the transmitters give no position from here")
        step = np.linalg.solve(normal, H.T @ residuals)
        x = x + step
        if np.linalg.norm(step[:3]) < CLOSE_M:
            return CodeFix(x[:3], float(x[3]), np.linalg.inv(normal), residuals)
    raise NoFix("the code does not lead to a position")


def thesis_network(radius_m: float = 12_000.0) -> np.ndarray:
    """The fourteen transmitters of the synthetic network, (14, 3) m NED of its centre: ten and three on rings, one in the middle.

    Fitted to the thesis's dilutions of precision at the centre and over its fringes (Table 4.3), which print no coordinates.
    """
    outer = radius_m * np.array([[math.cos(a), math.sin(a), 0.0] for a in np.radians(36.0 * np.arange(10))])
    inner = 0.367 * radius_m * np.array([[math.cos(a), math.sin(a), 0.0] for a in np.radians([60.0, 180.0, 300.0])])
    return np.vstack([outer, inner, np.zeros((1, 3))])
