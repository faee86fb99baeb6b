"""GPS simulator: error statistics, latency, outages, dropouts."""

import numpy as np
import pymap3d
import pytest
from sensors_truth import START_NS, cuts, steady_truth

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings


def split(measurements):
    return [m for m in measurements if isinstance(m, GpsPosition)], [m for m in measurements if isinstance(m, GpsVelocity)]


def test_errors_have_the_stated_covariance():
    truth = steady_truth(600.0, 10)
    fixes, velocities = split(GpsSimulator(GpsSimulatorSettings(rate_hz=10.0)).simulate(truth))
    enu = pymap3d.geodetic2enu(
        *(np.array([getattr(f, k) for f in fixes]) for k in ("lat", "lon", "height")), truth.lat, truth.lon, truth.height, deg=False
    )
    tolerance = 4.0 / np.sqrt(2 * len(fixes))
    assert [np.std(axis) for axis in enu] == pytest.approx([2.0, 2.0, 5.0], rel=tolerance)
    assert fixes[0].cov_n == pytest.approx(np.diag([4.0, 4.0, 25.0]))
    error = np.array([v.vel_n for v in velocities]) - truth.vel_n
    assert error.std(axis=0) == pytest.approx([0.1] * 3, rel=tolerance)


def test_correlated_error_is_in_the_stated_covariance():
    settings = [GpsSimulatorSettings(seed=seed, horizontal_drift_m=6.0, horizontal_noise_m=0.01) for seed in range(200)]
    fixes = [GpsSimulator(s).simulate(steady_truth(0.05))[0] for s in settings]
    assert np.std([f.lat for f in fixes]) * 6.361e6 == pytest.approx(6.0, rel=4.0 / np.sqrt(400))
    assert fixes[0].cov_n[0, 0] == pytest.approx(36.0, rel=1e-3)


def test_a_fix_comes_when_its_latency_has_passed_and_keeps_its_stamp():
    simulator = GpsSimulator(GpsSimulatorSettings(latency_s=0.13))
    for block in cuts(steady_truth(3.0), [1]):
        for m in simulator.simulate(block):
            assert block.stamps_ns[0] - m.stamp_ns == 130_000_000


def test_outages_count_from_the_first_truth_stamp():
    fixes, _ = split(GpsSimulator(GpsSimulatorSettings(outages_s=[2.0, 4.0, 6.0, 7.0])).simulate(steady_truth(10.0)))
    elapsed_s = np.array([f.stamp_ns - START_NS - 10_000_000 for f in fixes]) * 1e-9
    expected = [t for t in np.arange(0.0, 10.0, 0.2) if not (2.0 <= round(t, 6) < 4.0 or 6.0 <= round(t, 6) < 7.0)]
    assert elapsed_s == pytest.approx(expected)


def test_an_outage_changes_no_other_fix():
    truth = steady_truth(10.0)
    free, _ = split(GpsSimulator(GpsSimulatorSettings()).simulate(truth))
    cut, _ = split(GpsSimulator(GpsSimulatorSettings(outages_s=[2.0, 4.0])).simulate(truth))
    same = {f.stamp_ns: f.lat for f in free}
    assert len(cut) == len(free) - 10 and all(same[f.stamp_ns] == f.lat for f in cut)


def test_dropouts_have_their_share():
    fixes, _ = split(GpsSimulator(GpsSimulatorSettings(rate_hz=50.0, dropout_probability=0.3)).simulate(steady_truth(100.0, 50)))
    assert len(fixes) / 5000 == pytest.approx(0.7, abs=4.0 * np.sqrt(0.21 / 5000))


@pytest.mark.parametrize(
    ("outages_s", "sentence"), [([1.0], "needs pairs of start and end"), ([5.0, 3.0], "ends at 3 s, not after its start at 5 s")]
)
def test_nonsense_outages_are_refused(outages_s, sentence):
    with pytest.raises(SettingsError, match=sentence):
        GpsSimulatorSettings(outages_s=outages_s)
