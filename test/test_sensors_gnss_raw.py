"""Simulated satellite observations: exact without errors, the stated errors with them, and what schedules, clocks and faults do."""

import math

import numpy as np
import pytest
from sensors_truth import cuts, flat, steady_truth

from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping
from lowcostnav_ros.gnss.canyon import Canyon, CanyonSettings
from lowcostnav_ros.gnss.constellation import galileo_27, gps_24
from lowcostnav_ros.gnss.error_budget import range_covariance
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight
from lowcostnav_ros.gnss.positioning import solve, solve_velocity
from lowcostnav_ros.gnss.raim import check
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef
from lowcostnav_ros.sensors.gnss_raw import MILLISECOND_M, GnssRawSimulator, GnssRawSimulatorSettings

QUIET = {"gps_sigma_m": 0.001, "galileo_sigma_m": 0.001, "doppler_sigma_mps": 0.001}
BUSY = {"constellation": "gps_galileo", "max_satellites": 9, "slow_sigma_m": 2.0, "noise": "elevation"}
BUSY["schedule"] = [0.0, 8, 4.0, 0, 6.0, 3]


def run(truth, **settings):
    return GnssRawSimulator(GnssRawSimulatorSettings(**settings)).simulate(truth)


def place(truth, stamp_ns):
    row = int(np.searchsorted(truth.stamps_ns, stamp_ns))
    return truth.lat[row], truth.lon[row], truth.height[row], truth.vel_n[row]


def test_cutting_changes_no_bit_and_seeds_do():
    truth = steady_truth(8.0)
    whole = flat(run(truth, **BUSY))
    for lengths in ([1], [7, 1, 13, 100], [0, 250]):
        simulator = GnssRawSimulator(GnssRawSimulatorSettings(**BUSY))
        assert flat([e for block in cuts(truth, lengths) for e in simulator.simulate(block)]) == whole
    assert flat(run(truth, seed=2, **BUSY)) != whole


@pytest.mark.parametrize("light_time", [False, True])
def test_without_errors_the_fix_is_the_truth(light_time):
    truth = steady_truth(2.0, heading=0.7)
    for epoch in run(truth, constellation="gps_galileo", light_time=light_time, **QUIET):
        lat, lon, height, vel_n = place(truth, epoch.stamp_ns)
        fix = solve(epoch)
        velocity = solve_velocity(epoch, fix.position_e)
        assert fix.position_e == pytest.approx(geodetic_to_ecef(lat, lon, height), abs=0.01)
        assert velocity.vel_n == pytest.approx(vel_n, abs=0.01)
        assert epoch.doppler_valid.all() and epoch.range_valid.all()


def test_range_rate_is_the_change_of_range():
    truth = steady_truth(1.0, speed=0.0)
    for light_time in (False, True):
        epochs = run(truth, light_time=light_time, clock="rubidium", clock_drift_mps=0.0, clock_bias_m=0.0, **QUIET)
        change = (epochs[9].pseudorange_m - epochs[0].pseudorange_m) / ((epochs[9].stamp_ns - epochs[0].stamp_ns) * 1e-9)
        assert change == pytest.approx((epochs[9].doppler_mps + epochs[0].doppler_mps) / 2.0, abs=0.02)


def test_errors_have_their_stated_sigma_and_the_noise_its_common_part():
    truth = steady_truth(200.0, rate_hz=10, speed=0.0)
    for noise in ("white", "elevation"):
        epochs = run(truth, noise=noise, mask_deg=15.0, gps_sigma_m=5.5, clock="rubidium", clock_bias_m=0.0, clock_drift_mps=0.0)
        n = min(len(e) for e in epochs)
        epochs = [e for e in epochs if len(e) == n and e.sat_id.tolist() == epochs[0].sat_id.tolist()]
        at = geodetic_to_ecef(truth.lat[0], truth.lon[0], truth.height[0])
        errors = np.array([e.pseudorange_m - line_of_sight(at, e.sat_pos_e)[0] for e in epochs])
        rates = np.array([e.doppler_mps - np.sum(line_of_sight(at, e.sat_pos_e)[1] * e.sat_vel_e, axis=1) for e in epochs])
        assert errors.std(axis=0) == pytest.approx(epochs[0].sigma_m, rel=0.08)
        assert rates.std() == pytest.approx(0.2, rel=0.05)
        _, elevation = azimuth_elevation(truth.lat[0], truth.lon[0], line_of_sight(at, epochs[0].sat_pos_e)[1])
        R = range_covariance(elevation, 5.5) if noise == "elevation" else 5.5**2 * np.eye(n)
        assert np.cov(errors.T) == pytest.approx(R, abs=0.12 * R.max())


def test_schedule_mask_and_channels():
    truth = steady_truth(9.0, rate_hz=10)
    epochs = run(truth, schedule=[0.0, 6, 2.0, 3, 4.0, 0, 6.0, 20], max_satellites=8, mask_deg=12.0)
    seconds = np.array([(e.stamp_ns - truth.stamps_ns[0]) * 1e-9 for e in epochs])
    counts = np.array([len(e) for e in epochs])
    assert set(counts[seconds < 1.99]) == {6}
    assert set(counts[(seconds > 1.99) & (seconds < 3.99)]) == {3}
    assert not np.any((seconds > 3.99) & (seconds < 5.99))
    assert counts[seconds > 5.99].max() <= 8
    for e in epochs:
        lat, lon, height, _ = place(truth, e.stamp_ns)
        los = line_of_sight(geodetic_to_ecef(lat, lon, height), e.sat_pos_e)[1]
        assert np.all(-(los @ dcm_ne(lat, lon).T)[:, 2] >= math.sin(math.radians(12.0)))


def test_what_is_out_of_view_changes_no_error():
    truth = steady_truth(2.0, rate_hz=10)
    full, few = run(truth), run(truth, schedule=[0.0, 4])
    for a, b in zip(full, few, strict=True):
        rows = [a.sat_id.tolist().index(k) for k in b.sat_id.tolist()]
        assert np.array_equal(a.pseudorange_m[rows], b.pseudorange_m)


def test_a_range_fault_is_found_by_raim():
    truth = steady_truth(3.0, rate_hz=10)
    used = run(truth)[0].sat_id
    epochs = run(truth, range_faults=[1.0, float(used[2]), 200.0])
    verdicts = [check(e) for e in epochs]
    before, after = verdicts[:9], verdicts[11:]
    assert {r.verdict for r in before} == {"healthy"}
    assert {r.excluded for r in after} == {f"G{used[2]:02d}"}


def test_the_clock_is_set_by_whole_milliseconds():
    truth = steady_truth(30.0, rate_hz=10)
    settings = {"clock_bias_m": 0.0, "clock_drift_mps": 3.0e4, "clock_reset_ms": 0.5, **QUIET}
    clocks = np.array([solve(e).clocks_m["G"] for e in run(truth, seed=3, **settings)])
    steps = np.diff(clocks)
    resets = np.abs(steps) > 0.5 * MILLISECOND_M
    assert resets.sum() >= 1
    assert np.abs(clocks).max() <= 0.5 * MILLISECOND_M + np.abs(np.median(steps))
    assert np.abs(np.abs(steps[resets] - np.median(steps)) - MILLISECOND_M).max() < 50.0


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"range_faults": [1.0, 3.0]}, "add what is missing"),
        ({"max_satellites": 3}, "use 'schedule' for fewer"),
        ({"schedule": [5.0, 4, 2.0, 3]}, "must increase"),
        ({"clock_reset_ms": 0.1}, "every reset causes the next"),
        ({"clock": "sundial"}, "must be one of"),
    ],
)
def test_settings_that_cannot_be(settings, match):
    with pytest.raises(SettingsError, match=match):
        from_mapping(GnssRawSimulatorSettings, settings)


def test_settings_there_and_back_and_no_truth_no_epoch():
    settings = GnssRawSimulatorSettings(**BUSY)
    assert from_mapping(GnssRawSimulatorSettings, to_mapping(settings)) == settings
    assert GnssRawSimulator(settings).simulate(steady_truth(0.0)) == []


def test_cliffs_decide_what_is_seen_by_azimuth_and_height():
    canyon = {"cliff_m": 1000.0, "width_m": 1000.0, "heading_deg": 150.0, "floor_m": 200.0}
    open_sky = run(steady_truth(1.0, rate_hz=10), constellation="gps_galileo")[0]
    for height, walls in ((1300.0, 0.0), (1000.0, 200.0), (300.0, 900.0)):
        truth = steady_truth(1.0, rate_hz=10)
        truth.height[:] = height
        for around in (False, True):
            epoch = run(truth, constellation="gps_galileo", canyon=CanyonSettings(**canyon, all_around=around))[0]
            lat, lon, _, _ = place(truth, epoch.stamp_ns)
            position = geodetic_to_ecef(lat, lon, height)
            states = np.concatenate([system.states(10800.0)[0] for system in (gps_24(), galileo_27())])
            azimuth, elevation = azimuth_elevation(lat, lon, line_of_sight(position, states)[1])
            across = 1.0 if around else np.abs(np.sin(azimuth - math.radians(150.0)))
            lowest = np.maximum(math.radians(5.0), np.arctan2(walls * across, 500.0))
            assert len(epoch) == np.count_nonzero(elevation >= lowest)
        assert len(epoch) == len(open_sky) or walls > 0.0


def test_a_canyon_of_the_thesis_is_a_cone():
    for height in (0.0, 400.0, 900.0, 1500.0):
        canyon = CanyonSettings(cliff_m=1000.0, all_around=True).canyon()
        assert canyon.lowest(height, np.linspace(0.0, 6.0, 7)).tolist() == [Canyon().mask(height)] * 7
    assert CanyonSettings().canyon() is None
