"""Error states as chosen lists of blocks.

A block owns a slice of the error state, its dynamics (random constant, random walk or first-order Gauss-Markov) and its noise.
A navigator is a chosen list: 15, 27 or 29 states are three lists, not three filters.  What a state *does* to the core (an
accelerometer bias turns velocity, a wind moves position) is its ``kind``; the compiled dynamics of a navigator read the kinds,
so blocks come and go without new code.
"""

import copy
import dataclasses
import enum
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np


class Kind(enum.IntEnum):
    """What a state acts on; the compiled dynamics switch on these numbers."""

    CORE = 0
    ACCEL_BIAS = 1
    GYRO_BIAS = 2
    ACCEL_SCALE = 3
    GYRO_SCALE = 4
    WIND = 5
    AIRSPEED_SCALE = 6
    AIRSPEED_BIAS = 7
    HEADING_BIAS = 8
    FREE = 9  # acts only through measurements: baro bias, range bias, position bias
    CHAIN = 10  # acts only through measurements; each state is the integral of the next: receiver clock bias and drift
    HELD = 11  # as FREE, and a horizontal fix, range or bearing moves it no more than height: baro bias, a bias that is only considered
    HEADING_BANK = 12  # heading error per sine of bank


SLOWEST_MPS = 1.0
"""Speed at which an error that varies along the way still changes when the aircraft stands."""


@dataclass(frozen=True, slots=True)
class Block:
    """One block of an error state.

    Attributes
    ----------
    name : str
        How the rest of the code finds it (``layout["gyro_bias"]``).
    labels : tuple of str
        One name per state, with unit: ``gyro_bias_x_radps``.
    kind : Kind
    sigma0 : tuple of float
        Initial sigma per state.
    tau_s : float or tuple of float
        Correlation time of all states or of each; ``inf`` for a random constant or random walk.
    psd : tuple of float
        Driving noise per state, unit^2/s; a Gauss-Markov state of sigma s has 2 s^2 / tau.
    distance_m : float
        Where finite, the states decay along the way flown, too: Gauss-Markov, rate and noise follow the speed.
    """

    name: str
    labels: tuple[str, ...]
    kind: Kind
    sigma0: tuple[float, ...]
    tau_s: float | tuple[float, ...] = np.inf
    psd: tuple[float, ...] = ()
    distance_m: float = np.inf

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.labels)

    def __deepcopy__(self, memo: dict) -> "Block":
        """Return itself: it does not change."""
        return self


PerState = float | Sequence[float] | np.ndarray
"""One number for all states of a block, or one for each."""


def gauss_markov(
    name: str, labels: Iterable[str], kind: Kind, sigma: PerState, tau_s: PerState, sigma0: PerState | None = None
) -> Block:
    """Block of first-order Gauss-Markov states with steady sigma and correlation time (G11: q = 2 sigma^2 / tau).

    ``sigma0`` is the sigma at the start where it differs from the steady one (a turn-on bias on top of a drift).
    """
    names = tuple(labels)
    steady, tau = _each(sigma, names), _each(tau_s, names)
    first = steady if sigma0 is None else _each(sigma0, names)
    return Block(name, names, kind, first, tau, tuple(2.0 * s * s / t for s, t in zip(steady, tau, strict=True)))


def random_walk(name: str, labels: Iterable[str], kind: Kind, sigma0: PerState, density: PerState = 0.0) -> Block:
    """Block of random walks growing by ``density`` (unit per square root of second); density 0 is a random constant."""
    names = tuple(labels)
    return Block(name, names, kind, _each(sigma0, names), np.inf, tuple(d * d for d in _each(density, names)))


def along_way(name: str, labels: Iterable[str], kind: Kind, sigma: float, distance_m: float, tau_s: float = np.inf) -> Block:
    """Block of states that vary with the distance flown: Gauss-Markov of correlation distance ``distance_m`` (:meth:`Layout.pace`).

    Where ``tau_s`` is finite they vary in time as well; the rates add.
    """
    return dataclasses.replace(gauss_markov(name, labels, kind, sigma, tau_s), distance_m=distance_m)


def _each(value: PerState, names: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(float(v) for v in np.broadcast_to(value, len(names)))


def chain(name: str, labels: Iterable[str], sigma0: Iterable[float], psd: Iterable[float]) -> Block:
    """Block in which each state is the integral of the next, plus white noise of density ``psd`` (unit^2/s): a clock's bias and drift."""
    return Block(name, tuple(labels), Kind.CHAIN, tuple(sigma0), np.inf, tuple(psd))


class Layout:
    """The chosen list of blocks with the arrays the compiled dynamics read.

    Attributes
    ----------
    size : int
    kind, axis : ndarray of int64, shape (n,)
        Kind of each state and its index inside its block.
    rate : ndarray, shape (n,)
        Decay rate 1/tau, 0 for constants and walks.
    psd : ndarray, shape (n,)
        Driving noise.
    level : ndarray, shape (n,)
        Factor on each state's steady sigma, as learned in flight (:meth:`set_levels`).
    least : ndarray, shape (n,)
        What that factor is at least, where something is at fault (:meth:`widen`).
    labels : tuple of str
    """

    def __init__(self, blocks: Iterable[Block]) -> None:
        self.blocks = tuple(blocks)
        self._slices: dict[str, slice] = {}
        start = 0
        for block in self.blocks:
            if block.name in self._slices:
                raise ValueError(f"Two blocks are called '{block.name}'.")
            self._slices[block.name] = slice(start, start + block.size)
            start += block.size
        self.size = start
        self.labels = tuple(label for b in self.blocks for label in b.labels)
        self.kind = np.array([int(b.kind) for b in self.blocks for _ in b.labels], dtype=np.int64)
        self.axis = np.array([i for b in self.blocks for i in range(b.size)], dtype=np.int64)
        self._rate = np.array([1.0 / tau for b in self.blocks for tau in np.broadcast_to(b.tau_s, b.size)])
        self.rate = self._rate.copy()
        self._psd = np.array([q for b in self.blocks for q in (b.psd or (0.0,) * b.size)])
        self.psd, self.level, self.least = self._psd.copy(), np.ones(start), np.zeros(start)
        self.sigma0 = np.array([s for b in self.blocks for s in b.sigma0])
        self._speed_mps: float | None = None
        self._along_way = [block for block in self.blocks if np.isfinite(block.distance_m)]

    def __contains__(self, name: str) -> bool:
        return name in self._slices

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def get(self, name: str) -> slice | None:
        """Slice of a block, None when it was not chosen."""
        return self._slices.get(name)

    def initial_covariance(self) -> np.ndarray:
        """Diagonal covariance from the blocks' initial sigmas, shape (n, n)."""
        return np.diag(self.sigma0**2)

    @property
    def is_paced(self) -> bool:
        """Whether any state varies along the way flown."""
        return bool(self._along_way)

    def branch(self) -> "Layout":
        """A copy that may be paced alone."""
        twin = copy.copy(self)
        twin.rate, twin.psd = self.rate.copy(), self.psd.copy()
        return twin

    def __deepcopy__(self, memo: dict) -> "Layout":
        """Return a branch: nothing else of it changes in place."""
        return self.branch()

    def pace(self, speed_mps: float) -> None:
        """Give states that vary along the way flown the rate and the driving noise of a speed."""
        self._speed_mps = speed_mps
        for block in self._along_way:
            rows = self._slices[block.name]
            self.rate[rows] = max(speed_mps, SLOWEST_MPS) / block.distance_m + self._rate[rows]
            self.psd[rows] = 2.0 * (np.array(block.sigma0) * self.level[rows]) ** 2 * self.rate[rows]

    def set_levels(self, factors: Mapping[str, float | np.ndarray]) -> None:
        """Let the states of some blocks vary by ``factors`` times their declared sigma, one a block or one for each of its states."""
        self.level = np.ones(self.size)
        for name, factor in factors.items():
            self.level[self._slices[name]] = factor
        self._drive()

    def widen(self, least: np.ndarray) -> None:
        """Let the states vary by at least ``least`` (n,) times their declared sigma, whatever their level."""
        self.least = least
        self._drive()

    def _drive(self) -> None:
        self.psd[:] = self._psd * np.maximum(self.level, self.least) ** 2
        if self._speed_mps is not None:
            self.pace(self._speed_mps)

    def forget(self) -> None:
        """Be as declared: no speed, no levels."""
        self._speed_mps, self.least = None, np.zeros(self.size)
        self.rate[:] = self._rate
        self.set_levels({})

    def fill(self, H: np.ndarray, kind: Kind, columns: np.ndarray) -> None:
        """Give all states of one kind their columns (m, 3) of a Jacobian ``H`` (m, n), axis by axis, in place."""
        rows = self.kind == kind
        H[:, rows] = columns[:, self.axis[rows]]

    def components(self, kind: Kind, count: int) -> np.ndarray:
        """Rows (count, n) that sum the states of one kind, axis by axis."""
        return np.array([(self.kind == kind) & (self.axis == axis) for axis in range(count)], dtype=float)

    def mask(self, *free: str) -> np.ndarray:
        """1.0 for the states of the named blocks, 0.0 for all others: which states an update may move."""
        mask = np.zeros(self.size)
        for name in free:
            if name in self._slices:
                mask[self._slices[name]] = 1.0
        return mask
