"""Errors of a navigator against a reference, and their statistics in memory that does not grow with the flight.

An error here is what an engineer reads off a plot: **estimate minus reference**, metres north, east, down, angles wrapped.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from lowcostnav_ros.gnss.accuracy import CATEGORIES_M, category
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.replay.columns import NavColumns, position_difference_n
from lowcostnav_ros.replay.result import Approach, ErrorSummary, PositionErrors
from lowcostnav_ros.replay.sketch import MagnitudeStatistics

AXES = (
    *("north_m", "east_m", "down_m", "vn_mps", "ve_mps", "vd_mps"),
    *("roll_deg", "pitch_deg", "heading_deg", "wind_north_mps", "wind_east_mps"),
)
"""The components of an error, in the order of the columns of :class:`Errors`."""

MAGNITUDES = {
    "horizontal_m": ("north_m", "east_m"),
    "vertical_m": ("down_m",),
    "position_m": ("north_m", "east_m", "down_m"),
    "velocity_mps": ("vn_mps", "ve_mps", "vd_mps"),
    "roll_deg": ("roll_deg",),
    "pitch_deg": ("pitch_deg",),
    "heading_deg": ("heading_deg",),
    "wind_mps": ("wind_north_mps", "wind_east_mps"),
}
"""The sizes that are judged, each the norm of these components."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors at n stamps.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    values, sigmas : ndarray, shape (n, 11)
        Error and the navigator's own one-sigma, columns as in :data:`AXES`; NaN where there is none.
    nees_horizontal : ndarray, shape (n,)
        Squared horizontal error weighed by the inverse of its covariance; 2 on average when the sigmas fit.
    sigma_horizontal : ndarray, shape (n,)
        The navigator's own sigma along the longer half-axis of its horizontal error ellipse, m.
    """

    stamps_ns: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    nees_horizontal: np.ndarray
    sigma_horizontal: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, rows: slice | np.ndarray) -> "Errors":
        columns = (self.stamps_ns, self.values, self.sigmas, self.nees_horizontal, self.sigma_horizontal)
        return Errors(*(column[rows] for column in columns))

    def axis(self, name: str) -> np.ndarray:
        """One component by its name in :data:`AXES`, shape (n,)."""
        return self.values[:, AXES.index(name)]


def errors_between(estimate: NavColumns, reference: NavColumns) -> Errors:
    """Estimate minus reference at common stamps; the covariances are the estimate's.

    Rows in which nothing can be compared are dropped.
    """
    position = position_difference_n(estimate.position, reference.position)
    angles = np.degrees(wrap(estimate.euler - reference.euler))
    values = np.hstack([position, estimate.vel_n - reference.vel_n, angles, estimate.wind_n - reference.wind_n])
    sigmas = np.hstack([_sigmas(estimate.cov_pos), _sigmas(estimate.cov_vel), np.degrees(estimate.sigma_euler), _sigmas(estimate.cov_wind)])
    errors = Errors(estimate.stamps_ns, values, sigmas, _nees(position, estimate.cov_pos), _longer_half_axis(estimate.cov_pos))
    return errors[np.isfinite(values).any(axis=1)]


def _sigmas(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


def _longer_half_axis(cov_pos: np.ndarray) -> np.ndarray:
    a, b, c = cov_pos[:, 0, 0], cov_pos[:, 0, 1], cov_pos[:, 1, 1]
    return np.sqrt(0.5 * (a + c) + np.hypot(0.5 * (a - c), b))


def _nees(position: np.ndarray, cov_pos: np.ndarray) -> np.ndarray:
    a, b, c = cov_pos[:, 0, 0], cov_pos[:, 0, 1], cov_pos[:, 1, 1]
    determinant = a * c - b * b
    north, east = position[:, 0], position[:, 1]
    weighed = c * north**2 - 2.0 * b * north * east + a * east**2
    return np.divide(weighed, determinant, out=np.full(len(position), np.nan), where=determinant > 0.0)


class CategoryShares:
    """Share of the errors that lie within each precision-approach category (Solimeno 2007, Table 7.4)."""

    def __init__(self) -> None:
        self._count = 0
        self._within = {name: np.zeros(3, dtype=np.int64) for name in CATEGORIES_M}

    def add(self, horizontal_m: np.ndarray, vertical_m: np.ndarray) -> None:
        """Count absolute errors, shape (n,), finite."""
        self._count += len(horizontal_m)
        for name, (horizontal, vertical) in CATEGORIES_M.items():
            h, v = horizontal_m <= horizontal, vertical_m <= vertical
            self._within[name] += [h.sum(), v.sum(), (h & v).sum()]

    def result(self, horizontal_95_m: float, vertical_95_m: float) -> Approach:
        """Shares by category, and the strictest category that the 95 % errors meet (empty for none)."""
        shares = {
            name: dict(zip(("horizontal", "vertical", "both"), (within / self._count).tolist(), strict=True))
            for name, within in reversed(self._within.items())
        }
        return Approach(category(horizontal_95_m, vertical_95_m), shares)


class ErrorStatistics:
    """Statistics of a stream of errors: sizes, error over sigma, horizontal NEES."""

    def __init__(self) -> None:
        self.samples = 0
        self.sizes = {name: MagnitudeStatistics() for name in MAGNITUDES}
        self._ratio_sum = np.zeros(len(AXES))
        self._ratio_count = np.zeros(len(AXES), dtype=np.int64)
        self._nees_sum = 0.0
        self._nees_count = 0
        self._sum, self._squares, self._places = np.zeros(3), np.zeros(3), 0
        self._categories = CategoryShares()

    def add(self, errors: Errors) -> None:
        """Add one chunk of errors."""
        if len(errors) == 0:
            return
        self.samples += len(errors)
        for name, axes in MAGNITUDES.items():
            columns = errors.values[:, [AXES.index(a) for a in axes]]
            self.sizes[name].add(np.sqrt(np.sum(columns * columns, axis=1)), errors.stamps_ns)
        usable = np.isfinite(errors.values) & (errors.sigmas > 0.0)
        ratio = np.divide(errors.values, errors.sigmas, out=np.zeros_like(errors.values), where=usable)
        self._ratio_sum += np.sum(ratio * ratio, axis=0)
        self._ratio_count += usable.sum(axis=0)
        nees = errors.nees_horizontal[np.isfinite(errors.nees_horizontal)]
        self._nees_sum += float(nees.sum())
        self._nees_count += len(nees)
        self._add_position(errors.values[:, :3])

    def _add_position(self, position: np.ndarray) -> None:
        position = position[np.isfinite(position).all(axis=1)]
        self._sum += position.sum(axis=0)
        self._squares += np.sum(position * position, axis=0)
        self._places += len(position)
        self._categories.add(np.hypot(position[:, 0], position[:, 1]), np.abs(position[:, 2]))

    @property
    def position(self) -> PositionErrors | None:
        """Mean and RMS of the position error north, east and up, RMS in the plane and in space (Solimeno 2007, chapter 7), m."""
        if not self._places:
            return None
        mean, rms = self._sum / self._places, np.sqrt(self._squares / self._places)
        named = {"mean_m": mean * (1.0, 1.0, -1.0), "rms_m": rms}
        axes = {name: dict(zip(("north", "east", "up"), values.tolist(), strict=True)) for name, values in named.items()}
        return PositionErrors(**axes, rms_2d_m=float(np.hypot(rms[0], rms[1])), rms_3d_m=float(np.linalg.norm(rms)))

    def error_over_sigma(self) -> dict[str, float]:
        """RMS of error over sigma per axis; 1 when the sigmas fit, above 1 when they are too small."""
        pairs = zip(AXES, self._ratio_sum, self._ratio_count, strict=True)
        return {axis: math.sqrt(total / count) for axis, total, count in pairs if count}

    @property
    def nees_horizontal(self) -> float | None:
        """Mean normalised squared horizontal error (2 expected), None without positions."""
        return self._nees_sum / self._nees_count if self._nees_count else None

    def result(self) -> ErrorSummary | None:
        """The statistics, None without samples."""
        if self.samples == 0:
            return None
        sizes: dict[str, Any] = {name: s.result() for name, s in self.sizes.items()}
        within = (self.sizes[name].quantile(0.95) for name in ("horizontal_m", "vertical_m"))
        approach = self._categories.result(*within) if self._places else None
        sizes |= {"error_over_sigma": self.error_over_sigma(), "nees_horizontal": self.nees_horizontal}
        return ErrorSummary(self.samples, **sizes, position=self.position, approach=approach)


def error_row(errors: Errors, row: int) -> dict[str, float]:
    """One row of errors as named numbers, with the horizontal size; what is absent is not in it."""
    named = {axis: float(v) for axis, v in zip(AXES, errors.values[row], strict=True) if math.isfinite(v)}
    if "north_m" in named:
        named["horizontal_m"] = math.hypot(named["north_m"], named["east_m"])
    return {"t_s": int(errors.stamps_ns[row]) / 1e9, **named}
