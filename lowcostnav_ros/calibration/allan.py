"""Allan deviation of a sensor at rest, plain or overlapping, with confidence intervals.

With L samples per cluster and cluster means m_k, sigma^2(tau) = 1/2 E (m_{k+1} - m_k)^2 (equation C.4 of Gebre-Egziabher 2004 with
the square it lacks in print); overlapping clusters start at every sample.  Means are differences of one running sum, so each
averaging time costs one pass over the record whatever its length.

Confidence: equivalent degrees of freedom for the noise that the local slope shows, W. J. Riley, NIST Special Publication 1065
(2008), table 5 (simple formulas).
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.calibration.record import CalibrationError, checked_record

ONE_SIGMA = 0.6826894921370859
PER_DECADE = 12
SURE_CLUSTERS = 100
"""Clusters in the record from which a slope steeper than white noise is accepted."""


@dataclass(frozen=True, slots=True, eq=False)
class AllanChart:
    """Allan deviation against averaging time; every array has shape (k,).

    Attributes
    ----------
    tau_s : ndarray
        Averaging time, s, increasing.
    deviation : ndarray
        Allan deviation, unit of the samples.
    low, high : ndarray
        Bounds of the confidence interval of the deviation.
    degrees : ndarray
        Equivalent degrees of freedom.
    duration_s : float
        Length of the record.
    """

    tau_s: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    degrees: np.ndarray
    duration_s: float


def allan_chart(
    values: np.ndarray, rate_hz: float, tau_s: np.ndarray | None = None, overlapping: bool = True, confidence: float = ONE_SIGMA
) -> AllanChart:
    """Compute the Allan deviation of one axis.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Rate-like samples (rad/s, m/s^2, ...) of a sensor at rest, evenly spaced.
    rate_hz : float
        Sampling rate, Hz.
    tau_s : ndarray, optional
        Averaging times, s, rounded to whole samples; by default spaced evenly on the logarithmic axis up to half the record.
    overlapping : bool
        Use every cluster; False uses adjacent clusters only, as the definition does.
    confidence : float
        Probability of the interval, one sigma by default.

    Raises
    ------
    CalibrationError
        For a record that :func:`checked_record` refuses, or averaging times beyond half of it.
    """
    values = checked_record(values, rate_hz)
    counts = cluster_sizes(len(values)) if tau_s is None else _given_sizes(tau_s, rate_hz, len(values))
    running = np.concatenate(([0.0], np.cumsum(values - values.mean())))
    variance = np.array([_allan_variance(running, size, 1 if overlapping else size) for size in counts])
    deviation = np.sqrt(variance)
    degrees = _degrees(counts, deviation, len(running), overlapping)
    low, high = _interval(deviation, degrees, confidence)
    return AllanChart(counts / rate_hz, deviation, low, high, degrees, len(values) / rate_hz)


def cluster_sizes(samples: int, per_decade: int = PER_DECADE) -> np.ndarray:
    """Cluster sizes from one sample to half the record, spaced evenly on the logarithmic axis, shape (k,), int."""
    longest = samples // 2
    points = max(2, int(np.log10(longest) * per_decade) + 1)
    return np.unique(np.round(np.geomspace(1, longest, points)).astype(np.int64))


def local_slopes(chart: AllanChart, decades: float = 0.5) -> np.ndarray:
    """Slope of the logarithmic chart about each point, from a line through the points within +- ``decades``/2, shape (k,)."""
    return _slopes(np.log10(chart.tau_s), np.log10(np.maximum(chart.deviation, 1e-300)), decades)


@kernel
def _allan_variance(running, size, stride):
    last = running.shape[0] - 2 * size
    total = 0.0
    count = 0
    for start in range(0, last, stride):
        step = running[start + 2 * size] - 2.0 * running[start + size] + running[start]
        total += step * step
        count += 1
    return total / (2.0 * count * size * size)


def _given_sizes(tau_s: np.ndarray, rate_hz: float, samples: int) -> np.ndarray:
    sizes = np.unique(np.round(np.asarray(tau_s, dtype=float) * rate_hz).astype(np.int64))
    if len(sizes) == 0 or sizes[0] < 1 or 2 * sizes[-1] > samples:
        raise CalibrationError(
            f"Averaging times must lie between one sample ({1.0 / rate_hz:g} s) and half the record ({samples / rate_hz / 2:g} s)."
        )
    return sizes


def _slopes(x: np.ndarray, y: np.ndarray, decades: float) -> np.ndarray:
    slopes = np.empty(len(x))
    for k in range(len(x)):
        near = np.abs(x - x[k]) <= 0.5 * decades
        if np.count_nonzero(near) < 2:
            near = np.argsort(np.abs(x - x[k]))[:2]
        slopes[k] = np.polyfit(x[near], y[near], 1)[0] if len(x) > 1 else 0.0
    return slopes


def _degrees(sizes: np.ndarray, deviation: np.ndarray, points: int, overlapping: bool) -> np.ndarray:
    """Equivalent degrees of freedom per point; ``points`` is the length of the running sum."""
    slopes = _slopes(np.log10(sizes), np.log10(np.maximum(deviation, 1e-300)), 0.5)
    degrees = np.empty(len(sizes))
    for k, size in enumerate(sizes):
        n, m = (points, int(size)) if overlapping else ((points - 1) // int(size) + 1, 1)
        # Few clusters can fall steeply by chance; calling that phase noise would trust the worst points of the chart most.
        slope = slopes[k] if size * SURE_CLUSTERS < points else max(slopes[k], -0.5)
        degrees[k] = max(1.0, equivalent_degrees(slope, n, m))
    return degrees


def equivalent_degrees(slope: float, points: int, size: int) -> float:
    """Equivalent degrees of freedom of an overlapping Allan variance (NIST SP 1065, table 5).

    Parameters
    ----------
    slope : float
        Local slope of the deviation: near -1 white phase noise, -1/2 white, 0 flicker, +1/2 random walk.
    points : int
        Length of the running sum, samples plus one.
    size : int
        Samples in a cluster.
    """
    n, m = float(points), float(size)
    if slope < -0.75:
        return (n + 1.0) * (n - 2.0 * m) / (2.0 * (n - m))
    if slope < -0.25:
        return (3.0 * (n - 1.0) / (2.0 * m) - 2.0 * (n - 2.0) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    if slope < 0.25:
        return 2.0 * (n - 2.0) ** 2 / (2.3 * n - 4.9) if size == 1 else 5.0 * n**2 / (4.0 * m * (n + 3.0 * m))
    return (n - 2.0) / m * ((n - 1.0) ** 2 - 3.0 * m * (n - 1.0) + 4.0 * m**2) / (n - 3.0) ** 2


def _interval(deviation: np.ndarray, degrees: np.ndarray, confidence: float) -> tuple[np.ndarray, np.ndarray]:
    from scipy.stats import chi2

    tail = 0.5 * (1.0 - confidence)
    low = deviation * np.sqrt(degrees / chi2.ppf(1.0 - tail, degrees))
    high = deviation * np.sqrt(degrees / chi2.ppf(tail, degrees))
    return low, high
