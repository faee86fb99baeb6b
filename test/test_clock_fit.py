"""The clock of a device against this computer's: jitter, outliers, drift, stalls and steps."""

import numpy as np
import pytest

from lowcostnav_ros.formats.clock_fit import ClockFit

BEGIN_NS, SINCE_NS = 10**18, 10**12


def errors(hertz, seconds=200.0, drift=50e-6, jitter_s=0.05, step_at=None, seed=1):
    """Errors of the mapped stamps, s, their times, and the fit, with delays up to ``jitter_s``, three of a second, and a stall of 3 s."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * hertz)) / hertz
    true = time * (1.0 + drift) + (7.0 * (time >= step_at) if step_at else 0.0)
    delay = rng.uniform(0.0, jitter_s, len(time))
    delay[rng.choice(len(time), 3)] += 1.0
    stall = (time > 100.0) & (time < 103.0)
    delay[stall] += 103.0 - time[stall]
    received = np.maximum.accumulate(true + delay)
    fit = ClockFit()
    pairs = zip(time, received, strict=True)
    mapped = np.array([fit.map(SINCE_NS + round(1e9 * t), BEGIN_NS + round(1e9 * r)) for t, r in pairs])
    return 1e-9 * (mapped - BEGIN_NS) - true, time, mapped, fit


@pytest.mark.parametrize(("hertz", "largest_s"), [(200.0, 0.008), (5.0, 0.012)])
def test_jitter_of_50_ms_leaves_a_few_milliseconds(hertz, largest_s):
    # a stream keeps its order: a message that is late holds up those behind it, so that few come without delay
    error, time, mapped, fit = errors(hertz)
    assert np.abs(error[time > 20.0]).max() < largest_s and np.abs(error).max() < 0.06
    assert np.all(np.diff(mapped) > 0) and fit.steps == 0
    assert abs(fit.drift_ppm - 50.0) < (60.0 if hertz > 100.0 else 200.0)


def test_a_clock_that_was_set_is_followed_within_seconds():
    error, time, _, fit = errors(20.0, step_at=150.0)
    assert fit.steps == 1 and np.abs(error[time > 157.0]).max() < 0.06 and np.abs(error[time < 149.0]).max() < 0.06


def test_a_device_that_starts_anew_is_followed_at_once():
    fit = ClockFit()
    fit.map(10**12, BEGIN_NS)
    assert fit.map(10**9, BEGIN_NS + 10**9) == BEGIN_NS + 10**9 and fit.steps == 1
