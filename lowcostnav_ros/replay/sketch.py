"""Quantiles of a stream in fixed memory: a histogram with logarithmic bins.

Every value falls in a bin whose edges differ by one per cent, so a quantile is right to half a per cent of itself, however long
the flight (the idea of Masson, Rim and Lee, DDSketch, VLDB 2019, with a fixed range).  RMS and maximum are kept exactly.
"""

import math

import numpy as np

from lowcostnav_ros.replay.result import Size

_RATIO = 1.01
_LOWEST = 1.0e-9
_BINS = 4200  # 1e-9 to above 1e9 in steps of one per cent


class MagnitudeStatistics:
    """Count, RMS, median, 95 % and maximum of the magnitude of one error, with the stamp of the maximum."""

    def __init__(self) -> None:
        self.count = 0
        self.maximum = 0.0
        self.maximum_stamp_ns = 0
        self._sum_of_squares = 0.0
        self._bins = np.zeros(_BINS, dtype=np.int64)

    def add(self, values: np.ndarray, stamps_ns: np.ndarray) -> None:
        """Add values of one chunk, shape (n,), with their stamps; values that are not finite are skipped.

        Parameters
        ----------
        values : ndarray, shape (n,)
        stamps_ns : ndarray of int64, shape (n,)
        """
        finite = np.isfinite(values)
        size = np.abs(values[finite])
        if size.size == 0:
            return
        top = int(np.argmax(size))
        if self.count == 0 or size[top] > self.maximum:
            self.maximum, self.maximum_stamp_ns = float(size[top]), int(stamps_ns[finite][top])
        self.count += size.size
        self._sum_of_squares += float(size @ size)
        index = np.log(np.maximum(size, _LOWEST) / _LOWEST) / math.log(_RATIO)
        self._bins += np.bincount(np.minimum(index.astype(np.int64), _BINS - 1), minlength=_BINS)

    @property
    def rms(self) -> float:
        """Root mean square, NaN without samples."""
        return math.sqrt(self._sum_of_squares / self.count) if self.count else math.nan

    def quantile(self, probability: float) -> float:
        """Quantile to half a per cent of its value, NaN without samples.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        """
        rank = max(1, math.ceil(probability * self.count))
        index = int(np.searchsorted(np.cumsum(self._bins), rank))
        return min(_LOWEST * _RATIO ** (index + 0.5), self.maximum) if self.count else math.nan

    def result(self) -> Size | None:
        """The statistics, None without samples."""
        values = self.rms, self.quantile(0.5), self.quantile(0.95), self.maximum, self.maximum_stamp_ns / 1e9
        return Size(*values) if self.count else None
