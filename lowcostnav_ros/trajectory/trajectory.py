"""A true flight as a stream of blocks, and the way from prescribed motion to such a stream.

Every source makes pieces of its own fixed length; a :class:`Trajectory` cuts them anew to the length asked for.  So the flight is
the same to the last bit whatever the block length, and memory does not grow with the length of the flight.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import radii
from lowcostnav_ros.physics.strapdown import ideal_increments

PIECE_S = 2.0
"""Length of the pieces a source makes; part of the flight's definition, not of its presentation."""
WARM_UP = 4
"""Rows before a piece that the inverse strapdown sees, so that its coning terms include the preceding intervals."""


class Motion(Protocol):
    """Prescribed motion: velocity, attitude and wind as functions of the time since the start."""

    lat: float
    lon: float
    height: float

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity over ground (n, 3), ``q_nb`` (n, 4) and wind (n, 3) at ``t_s`` (n,) seconds after the start."""


@dataclass(frozen=True)
class Trajectory:
    """One true flight.

    Attributes
    ----------
    rate_hz : int
        Rows per second; row k (from 1) is stamped ``start_ns + k / rate_hz`` and holds the interval that ends there.
    start_ns : int
        Time of the start, which has no row of its own.
    pieces : callable
        Makes the flight from its start, in pieces of any length.
    """

    rate_hz: int
    start_ns: int
    pieces: Callable[[], Iterator[TruthBlock]]

    def blocks(self, block_s: float = 1.0) -> Iterator[TruthBlock]:
        """The flight from its start in blocks of ``block_s`` seconds (the last one may be shorter)."""
        size = max(1, round(block_s * self.rate_hz))
        held: list[TruthBlock] = []
        for piece in self.pieces():
            held.append(piece)
            while sum(map(len, held)) >= size:
                joined = join(held)
                yield joined[:size]
                held = [joined[size:]]
        if sum(map(len, held)):
            yield join(held)

    def table(self) -> TruthBlock:
        """The whole flight as one block, for short flights."""
        return join(list(self.pieces()))


def join(blocks: list[TruthBlock]) -> TruthBlock:
    """One block of several consecutive ones."""
    if len(blocks) == 1:
        return blocks[0]
    return TruthBlock(*(np.concatenate([getattr(b, f.name) for b in blocks]) for f in fields(TruthBlock)))


def stamps(start_ns: int, rate_hz: int, rows: np.ndarray) -> np.ndarray:
    """Stamps of rows, integer nanoseconds: exact multiples of the period, rounded down once and never accumulated."""
    return start_ns + rows.astype(np.int64) * 1_000_000_000 // rate_hz


@kernel
def integrate_position(lat, lon, height, vel_n, step_s):
    """Positions (m, 3) at every second row of ``vel_n`` (2 m - 1, 3), from the first on: fourth-order Runge-Kutta over the ellipsoid.

    ``vel_n`` m/s is given at the ends and the middle of each step of ``step_s`` (m - 1,) seconds; columns are lat, lon rad, height m.
    """
    count = (vel_n.shape[0] + 1) // 2
    out = np.empty((count, 3))
    out[0, 0], out[0, 1], out[0, 2] = lat, lon, height
    for k in range(count - 1):
        out[k + 1] = _runge_kutta(out[k], vel_n[2 * k], vel_n[2 * k + 1], vel_n[2 * k + 2], step_s[k])
    return out


@kernel
def _runge_kutta(position, v0, v1, v2, dt):
    k1 = _position_rate(position, v0)
    k2 = _position_rate(position + 0.5 * dt * k1, v1)
    k3 = _position_rate(position + 0.5 * dt * k2, v1)
    k4 = _position_rate(position + dt * k3, v2)
    return position + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@kernel
def _position_rate(position, vel_n):
    meridian, normal = radii(position[0])
    out = np.empty(3)
    out[0] = vel_n[0] / (meridian + position[2])
    out[1] = vel_n[1] / ((normal + position[2]) * np.cos(position[0]))
    out[2] = -vel_n[2]
    return out


def pieces_of_motion(motion: Motion, start_ns: int, rate_hz: int, duration_s: float) -> Iterator[TruthBlock]:
    """Truth of prescribed motion: position by integration, the ideal IMU by inverse strapdown.

    Parameters
    ----------
    motion : Motion
        Velocity and attitude as functions of time; twice continuously differentiable for a finite, continuous IMU.
    start_ns, rate_hz : int
        Time of the start and rows per second.
    duration_s : float
        Length of the flight.
    """

    def states() -> Iterator[TruthBlock]:
        last, size = round(duration_s * rate_hz), piece_rows(rate_hz)
        position = np.array([[motion.lat, motion.lon, motion.height]])
        for first in range(0, last, size):
            rows = np.arange(first, min(first + size, last) + 1)
            block, position = _states(motion, stamps(start_ns, rate_hz, rows), start_ns, position[-1])
            yield block if first == 0 else block[1:]

    return with_ideal_imu(states())


def piece_rows(rate_hz: int) -> int:
    """Rows of the pieces a source makes."""
    return max(WARM_UP, round(PIECE_S * rate_hz))


def with_ideal_imu(states: Iterator[TruthBlock]) -> Iterator[TruthBlock]:
    """Add the ideal IMU to consecutive blocks of states; the row of the start, which no interval ends at, is dropped."""
    tail = None
    for block in states:
        seen = block if tail is None else join([tail, block])
        force, rate = ideal_increments(seen.stamps_ns, seen.lat, seen.lon, seen.height, seen.vel_n, seen.q_nb)
        new = slice(1 if tail is None else len(tail), None)
        yield replace(seen, specific_force_b=force, angular_rate_b=rate)[new]
        tail = seen[-WARM_UP:]


def _states(motion: Motion, stamps_ns: np.ndarray, start_ns: int, position: np.ndarray) -> tuple[TruthBlock, np.ndarray]:
    t = (stamps_ns - start_ns) * 1.0e-9
    halves = np.interp(np.arange(2 * len(t) - 1) * 0.5, np.arange(len(t)), t)
    vel_n, q_nb, wind_n = motion.at(halves)
    track = integrate_position(position[0], position[1], position[2], vel_n, np.diff(t))
    none = np.zeros((len(t), 3))
    lat, lon, height = track.T.copy()
    block = TruthBlock(stamps_ns, lat, lon, height, vel_n[::2].copy(), q_nb[::2].copy(), none, none, wind_n[::2].copy())
    return block, track
