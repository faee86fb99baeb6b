"""A recording of a sensor at rest: what makes it fit for identification, and the sentences that refuse the rest."""

import numpy as np

SHORTEST = 50
"""Samples below which a noise cannot be estimated."""
UNEVEN = 0.5
"""Share of the median interval by which an interval may differ before it counts as a gap or a repeat."""
UNEVEN_SHARE = 1e-3
HOLE, MISSING_SHARE = 1.5, 0.002
"""Share of uneven intervals that is tolerated."""


class CalibrationError(ValueError):
    """Data that cannot carry the result asked for; the message is one sentence that says what to do."""


def checked_record(values: np.ndarray, rate_hz: float, name: str = "the record") -> np.ndarray:
    """Return the samples as float64, or refuse them.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples of one sensor axis at rest, any unit.
    rate_hz : float
        Sampling rate, Hz.
    name : str
        What to call the record in a refusal.

    Raises
    ------
    CalibrationError
        When it is empty, too short, not one axis, not finite or constant, or the rate is not a positive number.
    """
    values = np.asarray(values, dtype=float)
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise CalibrationError(f"The sampling rate of {name} must be a positive number of hertz, got {rate_hz!r}.")
    if values.ndim != 1:
        raise CalibrationError(f"Give the samples of {name} as one column, got an array of shape {values.shape}.")
    if len(values) == 0:
        raise CalibrationError(f"There are no samples in {name}; check the topic or column.")
    if len(values) < SHORTEST:
        raise CalibrationError(f"There are only {len(values)} samples in {name}; record at least {SHORTEST}, better an hour.")
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise CalibrationError(f"{bad} of {len(values)} samples of {name} are not finite; remove those rows.")
    if np.ptp(values) == 0.0:
        raise CalibrationError(f"All samples of {name} are {values[0]:g}; the sensor is frozen, or the wrong column was chosen.")
    return values


def regular_rate(stamps_s: np.ndarray, name: str = "the record") -> float:
    """Sampling rate, Hz, of evenly spaced stamps.

    Stamps may jitter, as arrival times do; what is refused are gaps, repeats and steps backwards, which a noise analysis would
    read as noise.

    Parameters
    ----------
    stamps_s : ndarray, shape (n,)
        Time of each sample, s.

    Raises
    ------
    CalibrationError
        For fewer than two stamps, stamps that are not finite or not increasing, or too many uneven intervals.
    """
    stamps_s = np.asarray(stamps_s, dtype=float)
    if len(stamps_s) < 2:
        raise CalibrationError(f"There are fewer than two stamps in {name}; give a longer record.")
    if not np.all(np.isfinite(stamps_s)):
        raise CalibrationError(f"Some stamps of {name} are not finite; remove those rows.")
    intervals = np.diff(stamps_s)
    if np.any(intervals < 0.0):
        raise CalibrationError(f"The stamps of {name} run backwards at row {int(np.argmax(intervals < 0.0)) + 1}; sort or cut the record.")
    usual = float(np.median(intervals))
    uneven = int(np.count_nonzero(np.abs(intervals - usual) > UNEVEN * usual))
    if usual <= 0.0 or uneven > UNEVEN_SHARE * len(intervals):
        raise CalibrationError(
            f"{uneven} of {len(intervals)} intervals of {name} are not the usual {usual:g} s; cut out an even stretch or resample."
        )
    holes = intervals > HOLE * usual
    missing_s, span_s = float(np.sum(intervals[holes] - usual)), float(stamps_s[-1] - stamps_s[0])
    if missing_s > MISSING_SHARE * span_s:
        longest = int(np.argmax(intervals))
        where = f"the longest of {intervals[longest]:.3g} s after {stamps_s[longest] - stamps_s[0]:.6g} s"
        raise CalibrationError(f"{name} has {int(holes.sum())} holes of {missing_s:.3g} s together, {where}; cut out an even stretch.")
    return float(len(intervals) / (span_s - missing_s))
