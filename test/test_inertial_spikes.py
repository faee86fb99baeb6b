"""Spikes of inertial samples: recognised against their neighbours, replaced, counted; motions are left alone to the bit."""

import numpy as np
import pytest
from common import compare, fly, scenario

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.estimation.inertial_spikes import SATURATED, SPIKE, InertialSpikes
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs, AhrsSettings
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings

REST = np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])
IMU = "imu/data_raw"


def samples(values, rate_hz=100.0):
    stamps = 1_000_000_000 + np.round(1e9 / rate_hz * np.arange(1, len(values) + 1)).astype(np.int64)
    return ImuBlock.of(IMU, stamps, np.ascontiguousarray(values[:, :3]), np.ascontiguousarray(values[:, 3:]))


def noisy(count=300, seed=0):
    return REST + np.random.default_rng(seed).standard_normal((count, 6)) * [0.3, 0.3, 0.3, 0.02, 0.02, 0.02]


def screened(block, screen=None):
    """Values (n, 6) after the screen, the kicks and variances summed, the phrases."""
    values, kick, variance, phrases = [], np.zeros(6), np.zeros(6), []
    for jolt, part, phrase in (screen or InertialSpikes()).screen(block):
        values.append(np.hstack((part.specific_force_b, part.angular_rate_b)))
        phrases += [phrase] if phrase else []
        if jolt is not None:
            kick, variance = kick + jolt.kick, variance + jolt.variance
    return np.vstack(values), kick, variance, phrases


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 100.0, 400.0])
def test_manoeuvres_vibration_shocks_and_quantised_samples_pass_to_the_bit(rate_hz):
    t = np.arange(0.0, 20.0, 1.0 / rate_hz)
    snap = np.interp(t, [5.0, 5.4, 6.0, 6.3], [0.0, 7.0, 7.0, 0.0])  # 400 deg/s within 0.4 s
    pull = np.interp(t, [9.0, 9.25, 11.0, 11.4], [0.0, 40.0, 40.0, 0.0])  # five g within a quarter of a second
    gust = 6.0 * np.exp(-(((t - 13.0) / 0.08) ** 2))
    landing = np.where(t > 15.0, 20.0 * np.exp(-(t - 15.0) / 0.3) * np.sin(2 * np.pi * 4.0 * (t - 15.0)), 0.0)
    engine = np.where(t > 2.0, 8.0 * np.sin(2 * np.pi * 27.0 * t), 0.0)
    values = noisy(len(t))
    values[:, 0] += engine
    values[:, 2] -= pull + gust + landing
    values[:, 3] += snap
    values[:, :3], values[:, 3:] = np.round(values[:, :3] / 0.02) * 0.02, np.round(values[:, 3:] / 0.002) * 0.002
    block = samples(values, rate_hz)
    ((jolt, part, phrase),) = InertialSpikes().screen(block)
    assert (jolt, phrase) == (None, "")
    assert part is block


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("share", [1.0, -1.0, 0.3, 0.06])
def test_a_single_spike_is_replaced_and_the_covariance_grows(axis, share):
    values = noisy()
    values[150, axis] = share * (1000.0 if axis < 3 else 35.0)
    got, kick, variance, phrases = screened(samples(values))
    assert phrases == [SPIKE]
    assert not kick.any()
    assert np.flatnonzero(variance).tolist() == [axis]
    assert got[150, axis] == values[149, axis]
    values[150, axis] = got[150, axis]
    assert np.array_equal(got, values)


def test_a_real_step_loses_nothing_of_velocity_and_rotation():
    values = noisy()
    values[150:190, 0] += 60.0  # a catapult, at once
    values[200:204, 4] += [2.5, 4.0, 5.0, 2.0]
    got, kick, variance, phrases = screened(samples(values))
    assert not phrases
    assert not variance.any()
    assert 0.01 * got.sum(axis=0) + kick == pytest.approx(0.01 * values.sum(axis=0), abs=1e-9)
    assert kick[[0, 4]].all()


def test_vibration_that_begins_is_soon_taken_as_usual():
    values = noisy(1000)
    values[300:, 1] += 60.0 * np.where(np.arange(700) % 2, 1.0, -1.0)
    got, _, _, phrases = screened(samples(values))
    assert len(phrases) < 40
    assert np.array_equal(got[500:], values[500:])


def test_cuts_of_blocks_and_pieces_of_samples_change_nothing():
    values = noisy()
    values[[40, 90, 91, 200], [0, 4, 4, 2]] = [300.0, 9.0, -8.0, -500.0]
    block = samples(values)
    whole = screened(block)
    for cuts in (range(1, 300), [40, 41, 90, 92, 199]):
        screen = InertialSpikes()
        edges = [0, *cuts, 300]
        parts = [screened(block[a:b], screen) for a, b in zip(edges, edges[1:], strict=False)]
        assert np.array_equal(np.vstack([p[0] for p in parts]), whole[0])
        assert sum((p[3] for p in parts), []) == whole[3]
        assert np.array_equal(sum(p[2] for p in parts), whole[2])
    half = block.stamps_ns[40] - 5_000_000  # an aid splits the spike
    rows = np.insert(np.arange(300), 40, 40)
    stamps = np.insert(block.stamps_ns, 40, half)
    split = ImuBlock.of(IMU, stamps, block.specific_force_b[rows], block.angular_rate_b[rows])
    got = screened(split)
    assert np.array_equal(got[0][[40, 41]], whole[0][[40, 40]])
    assert got[3] == whole[3]


def test_the_newest_sample_is_held_back_in_the_low_latency_output_and_the_screen_stays():
    values = noisy(50)
    values[49, 3] = 20.0
    screen, block = InertialSpikes(), samples(values)
    list(screen.screen(block[:45]))
    ahead = screen.preview(block[45:])
    assert ahead.angular_rate_b[-1, 0] == values[48, 3]
    assert np.array_equal(ahead.stamps_ns, block.stamps_ns[45:])
    assert np.array_equal(ahead.specific_force_b, screen.preview(block[45:]).specific_force_b)


def test_a_sensor_at_its_limit_is_named():
    values = noisy()
    values[:, 5] = np.minimum(values[:, 5] + np.interp(np.arange(300), [80, 150, 220], [0.0, 5.0, 0.0]), 3.0)
    _, _, variance, phrases = screened(samples(values))
    assert set(phrases) == {SATURATED}
    assert len(phrases) > 20
    assert variance[5] > 0.0
    frozen = np.tile(np.array([0.0, 0.0, -25.0, 0.0, 0.0, 2.0]), (100, 1))  # every bit the same is another fault
    assert not screened(samples(frozen))[3]


@pytest.fixture(scope="module")
def flight():
    changes = {"truth.duration_s": 170.0, "imu.profile": "automotive", "sensors": ["imu", "magnetometer", "gps"], "gps.rate_hz": 5.0}
    return fly(scenario("turns", 5, **changes))


def spiked(heard, first_s=100.0, last_s=160.0):
    rng, out, start = np.random.default_rng(4), [], heard[0].stamp_ns
    for m in heard:
        if isinstance(m, ImuBlock):
            force, rate = m.specific_force_b.copy(), m.angular_rate_b.copy()
            for k in np.flatnonzero(rng.random(len(m)) < 1 / 500):
                if first_s < 1e-9 * (m.stamps_ns[k] - start) < last_s:
                    sensor, most = ((force, 1000.0), (rate, 35.0))[int(rng.integers(2))]
                    sensor[k, rng.integers(3)] = rng.choice([-1.0, 1.0]) * most * 10.0 ** rng.uniform(-1.5, 0.0)
            m = ImuBlock.of(m.source, m.stamps_ns, force, rate)
        out.append(m)
    return out


@pytest.mark.parametrize("make", [lambda: InsGps(InsGpsSettings()), lambda: Ahrs(AhrsSettings())])
def test_one_spike_in_five_hundred_for_a_minute_is_flown_through(flight, make):
    truth, heard = flight
    ratios = []
    for measurements in (heard, spiked(heard)):
        navigator = make()
        errors, _ = compare(truth, navigator.feed_all(measurements))
        late = errors[errors.stamps_ns - truth.stamps_ns[0] > 100e9]
        ratios.append(np.nanmax(np.abs(late.values[:, :9]) / late.sigmas[:, :9]))
    assert ratios[1] < max(1.2 * ratios[0], 4.0)
    assert next(record for record in navigator.status().inputs if record.source == IMU).rejected[SPIKE] > 5


def test_spikes_are_found_alike_whatever_the_order_of_arrival(flight):
    _, heard = flight
    early = [m for m in spiked(heard, 20.0, 60.0) if m.stamp_ns - heard[0].stamp_ns < 60e9]
    one_by_one = [part for m in early for part in ([m[k : k + 1] for k in range(len(m))] if isinstance(m, ImuBlock) else [m])]
    one_by_one.sort(key=lambda m: (m.stamp_ns, m.source))
    rng = np.random.default_rng(0)
    shuffled = sorted(one_by_one, key=lambda m: m.stamp_ns + rng.uniform(0.0, 40e6))
    first, second = InsGps(InsGpsSettings()).feed_all(one_by_one), InsGps(InsGpsSettings()).feed_all(shuffled)
    assert len(first) == len(second) > 100
    for a, b in zip(first, second, strict=True):
        assert (a.lat, a.lon, a.height) == (b.lat, b.lon, b.height)
        assert np.array_equal(a.cov_pos, b.cov_pos)
