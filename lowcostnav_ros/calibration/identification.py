"""Error model of a sensor from one recording at rest: null shift, white noise, correlation time, long-term scatter.

The procedure of Gebre-Egziabher (2004), sections 3.2 and 3.3: the null shift is the mean; white noise is the scatter of the detrended
samples, which are much faster than the drift; the correlation time is where the normalised autocorrelation falls to 1/e; the
long-term sigma is the scatter of one-minute averages.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.calibration.record import CalibrationError, checked_record

AVERAGE_S = 60.0
FAST_S = 1.0
DETREND_S = 10.0
FEWEST_PER_STRETCH = 10
COLOUR_S = 0.1, 0.3, 1.0
SURE_PERIODS = 20.0
"""Correlation times that a record must hold for its autocorrelation to be trusted."""


@dataclass(frozen=True, slots=True)
class StaticIdentification:
    """What a recording at rest shows of a sensor, in the unit of the samples and seconds.

    Attributes
    ----------
    mean, mean_sigma : float
        Null shift and its standard error, drift included.
    white_sigma : float
        Scatter of one sample about a local trend.
    white_density : float
        The same as a density, unit/sqrt(Hz).
    drift_sigma : float
        Sigma of the slow part: the variance of one-second averages that white noise does not explain; 0 where it explains all.
    correlation_time_s : float or None
        Where the autocorrelation of the slow part falls to 1/e; None where there is no slow part.
    correlation_time_sure : bool
        The record holds at least :data:`SURE_PERIODS` correlation times.
    long_term_sigma : float or None
        Scatter of one-minute averages; None for less than three minutes.
    rate_hz, duration_s : float
    coloured : (float, float)
        By what factor the noise of means over some time, s, is not that of single samples: 1 where it is white.
    """

    mean: float
    mean_sigma: float
    white_sigma: float
    white_density: float
    drift_sigma: float
    correlation_time_s: float | None
    correlation_time_sure: bool
    long_term_sigma: float | None
    rate_hz: float
    duration_s: float
    coloured: tuple[float, float] = (1.0, 0.0)


def identify_static(values: np.ndarray, rate_hz: float) -> StaticIdentification:
    """Identify the error model of one axis at rest.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples at rest, evenly spaced, any unit.
    rate_hz : float
        Sampling rate, Hz.

    Raises
    ------
    CalibrationError
        For a record that :func:`checked_record` refuses.
    """
    values = checked_record(values, rate_hz)
    white_sigma = white_scatter(values, rate_hz)
    fast = _averages(values, max(1, round(FAST_S * rate_hz)))
    explained = white_sigma**2 / max(1, round(FAST_S * rate_hz))
    slow_variance = float(np.var(fast)) - explained
    present = slow_variance > 3.0 * explained * math.sqrt(2.0 / len(fast))
    crossing = _crossing_time(fast, slow_variance, max(FAST_S, 1.0 / rate_hz)) if present else None
    duration_s = len(values) / rate_hz
    drift_sigma = math.sqrt(slow_variance) if present else 0.0
    minutes = _averages(values, max(1, round(AVERAGE_S * rate_hz)))
    return StaticIdentification(
        mean=float(values.mean()),
        mean_sigma=_mean_sigma(white_sigma, len(values), drift_sigma, crossing, duration_s),
        white_sigma=white_sigma,
        white_density=white_sigma / math.sqrt(rate_hz),
        drift_sigma=drift_sigma,
        correlation_time_s=crossing,
        correlation_time_sure=crossing is not None and duration_s >= SURE_PERIODS * crossing,
        long_term_sigma=float(minutes.std(ddof=1)) if len(minutes) >= 3 else None,
        rate_hz=rate_hz,
        duration_s=duration_s,
        coloured=_coloured(values, rate_hz, white_sigma),
    )


def _coloured(values: np.ndarray, rate_hz: float, white_sigma: float) -> tuple[float, float]:
    """Compare single samples with means, by second differences, which a drift leaves alone; over a second it may be larger for it."""
    worst = 1.0, 0.0
    for span_s in COLOUR_S:
        count = max(2, round(rate_hz * span_s))
        means = _averages(values, count)
        if len(means) >= FEWEST_PER_STRETCH and white_sigma > 0.0:
            ratio = max(float(np.sqrt(np.mean(np.diff(means, 2) ** 2) / 6.0 * count)), 1e-12) / white_sigma
            factor = max(ratio, 1.0 / ratio) if span_s == COLOUR_S[0] else 1.0 / ratio
            worst = max(worst, (factor, count / rate_hz))
    return worst


def white_scatter(values: np.ndarray, rate_hz: float, stretch_s: float = DETREND_S) -> float:
    """Standard deviation of single samples about straight lines through stretches of ``stretch_s``, unit of the samples."""
    length = min(len(values), max(FEWEST_PER_STRETCH, round(stretch_s * rate_hz)))
    rows = values[: len(values) // length * length].reshape(-1, length)
    time = np.arange(length) - 0.5 * (length - 1)
    centred = rows - rows.mean(axis=1, keepdims=True)
    slope = centred @ time / (time @ time)
    squares = np.sum((centred - slope[:, None] * time) ** 2)
    return float(np.sqrt(squares / (rows.shape[0] * (length - 2))))


def autocorrelation(values: np.ndarray, longest: int) -> np.ndarray:
    """Autocovariance of a record about its mean at lags 0 to ``longest`` samples, shape (longest + 1,), unit squared.

    Divided by the number of products at each lag.

    Raises
    ------
    CalibrationError
        When the record is not longer than the lag.
    """
    n = len(values)
    if longest >= n:
        raise CalibrationError(f"A lag of {longest} samples needs a longer record than {n} samples.")
    size = 1 << (n + longest).bit_length()
    spectrum = np.fft.rfft(values - values.mean(), size)
    products = np.fft.irfft(spectrum * spectrum.conj(), size)[: longest + 1]
    return products / (n - np.arange(longest + 1))


def _averages(values: np.ndarray, count: int) -> np.ndarray:
    whole = len(values) // count
    return values[: whole * count].reshape(whole, count).mean(axis=1)


def _crossing_time(averages: np.ndarray, slow_variance: float, step_s: float) -> float | None:
    """Lag, s, where the autocorrelation, cleared of white noise at lag zero, first falls below 1/e; None where it never does."""
    normalised = autocorrelation(averages, len(averages) // 2) / slow_variance
    below = np.flatnonzero(normalised[1:] < math.exp(-1.0)) + 1
    if len(below) == 0:
        return None
    k = int(below[0])
    before = 1.0 if k == 1 else float(normalised[k - 1])
    return step_s * (k - 1 + (before - math.exp(-1.0)) / (before - float(normalised[k])))


def _mean_sigma(white_sigma: float, samples: int, drift_sigma: float, tau_s: float | None, duration_s: float) -> float:
    """Standard error of the mean of white noise plus a Gauss-Markov drift over the record."""
    variance = white_sigma**2 / samples
    if tau_s:
        x = duration_s / tau_s
        variance += drift_sigma**2 * 2.0 / x * (1.0 + math.expm1(-x) / x)
    return math.sqrt(variance)
