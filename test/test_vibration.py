"""Vibration: what samples show of it, and what it does to a filter's noise, on drawn samples and a recorded drive."""

import numpy as np
import pytest
from test_convert_recorded import recorded
from test_imu_look import ACCEL, GYRO, samples, turning

from lowcostnav_ros.convert import convert
from lowcostnav_ros.estimation.vibration import SHARE, Vibration
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.studies.outages.result import statistics_of
from lowcostnav_ros.studies.outages.study import Plan, stream_outages

DECLARED = np.repeat([ACCEL, GYRO], 3)


def seen(block, cuts=()):
    vibration = Vibration(DECLARED)
    for part in np.split(np.arange(len(block)), cuts):
        vibration.take(block[part[0] : part[-1] + 1])
    vibration.look(block.stamp_ns)
    return vibration


def test_white_noise_is_its_density_and_a_turn_by_hand_hardly_more():
    np.testing.assert_allclose(seen(samples()).shaking() / DECLARED, 1.0, rtol=0.35)  # of forty means
    for angles in (None, turning()):
        vibration = seen(samples(angles=angles))
        assert (vibration.accel, vibration.gyro) == (1.0, 1.0) and vibration.words() == ""


def test_what_shakes_raises_the_noise_of_the_sensor_that_it_shakes():
    vibration = seen(samples(accel=30.0 * ACCEL))
    assert vibration.accel == pytest.approx(30.0 * SHARE, rel=0.35) and vibration.gyro == 1.0
    assert list(vibration.level()) == [1.0] * 3 + [vibration.accel] * 3 + [1.0] * 3
    assert vibration.words() == f"shaken: accelerometer noise {vibration.accel:.1f}, gyro noise 1.0 times the settings'"


def gusts(block, force, slope=2.0):
    """Forces whose power falls by f^-slope, of the density ``force`` at 1 Hz, on an axis of a copy."""
    rng, n = np.random.default_rng(5), len(block)
    hertz = np.fft.rfftfreq(n, 0.01)
    weight = force * np.maximum(hertz, 0.2) ** (-0.5 * slope) * np.sqrt(0.5 * n / 0.01)
    block.specific_force_b[:, 2] += np.fft.irfft(weight * (rng.standard_normal(len(hertz)) + 1j * rng.standard_normal(len(hertz))), n)
    return block


def test_gusts_are_motion_and_no_noise():
    shaken = seen(gusts(samples(4000), 60.0 * ACCEL))
    assert np.sqrt(shaken._power[0, 2]) > 5.0 * ACCEL  # between slow means they show
    assert shaken.accel == 1.0


def test_what_a_filter_in_the_unit_takes_away_is_judged_by_what_it_leaves():
    block = samples(4000, accel=40.0 * ACCEL)
    block.specific_force_b[:] = np.apply_along_axis(np.convolve, 0, block.specific_force_b, np.hanning(18)[1:-1] / 8.5, "same")
    shaken = seen(block)
    assert np.sqrt(shaken._power[1, :3]).max() < 2.0 * ACCEL and shaken.accel > 3.0


def test_samples_picked_out_of_faster_ones_hold_all_that_shakes_as_aliases():
    assert seen(samples(1000, accel=30.0 * ACCEL, rate_hz=25.0)).accel == pytest.approx(30.0, rel=0.35)


def test_it_comes_and_goes():
    block = samples(4000)
    block.angular_rate_b[: len(block) // 2] *= 40.0
    vibration = Vibration(DECLARED)
    vibration.take(block[: len(block) // 2])
    assert vibration.look(block.stamps_ns[len(block) // 2]) and vibration.gyro > 10.0
    assert not vibration.look(block.stamps_ns[len(block) // 2] + 1)  # once a second
    vibration.take(block[len(block) // 2 :])
    assert vibration.look(block.stamp_ns) and vibration.gyro == pytest.approx(1.0, abs=0.3)


def test_blocks_may_be_cut_anywhere_and_a_hole_is_no_shaking():
    block = samples(accel=20.0 * ACCEL)
    whole = seen(block).shaking()
    assert np.array_equal(whole, seen(block, [1, 2, 7, 333, 334, 1201]).shaking())
    still = samples()
    still.specific_force_b[1000:] += 5.0
    holed = still[np.r_[0:1000, 1040:2000]]
    assert seen(holed).accel == 1.0 < seen(still[np.r_[0:1010]]).accel


def test_a_car_s_unit_is_flown_with_the_noise_of_the_road(tmp_path):
    """With the settings as shipped no good fix is refused, and what outages cost is within what is stated."""
    convert(recorded("gnss_imu_road"), "convert/road_drive", tmp_path / "drive")
    with BagReader(tmp_path / "drive") as reader:
        stream = list(reader.measurements(("imu/data_raw", "gps/fix", "gps/vel")))
    first_ns = stream[0].stamp_ns
    stream = [m for m in stream if 40e9 < m.stamp_ns - first_ns < 200e9]
    navigator = InsGps(InsGpsSettings())
    plan = Plan((15.0,), 15.0, 65.0, 160.0)
    outages = stream_outages(stream, {"ins_gps": navigator}, plan, ("gps/fix", "gps/vel"))["ins_gps"]
    found = statistics_of(outages, 15.0)
    assert found.windows >= 5 and 0.5 < found.error_over_sigma_rms < 1.5 and found.max_m < 40.0
    assert all(sum(aid.rejected.values()) < 20 for aid in navigator.status().aids)  # 289 and 295 with a data sheet's noise
    assert "gyro noise" in navigator.status().details["vibration"]
