"""What an IMU shows of itself: noise, timing, units, axes; filters set by it; fits that come with a verdict."""

from dataclasses import replace

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock, MagneticField
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.base.units import DEGREE, MILLI_G
from lowcostnav_ros.calibration.imu_look import look_at
from lowcostnav_ros.calibration.record import CalibrationError, regular_rate
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.cores.imu_errors import ImuSettings, as_seen, times_the_profile
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import euler_to_dcm

RATE_HZ, GYRO, ACCEL = 100.0, 0.02 * DEGREE, 0.4 * MILLI_G
"""Noise densities, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz)."""
DOWN = np.array([0.0, 0.0, -STANDARD_GRAVITY])


def samples(n=2000, angles=None, gyro=GYRO, accel=ACCEL, seed=1, rate_hz=RATE_HZ) -> ImuBlock:
    """Samples of a unit turned to ``angles`` (n, 3), roll, pitch and yaw, rad; at rest where None."""
    rng, dt = np.random.default_rng(seed), 1.0 / rate_hz
    angles = np.zeros((n, 3)) if angles is None else angles
    attitudes = [euler_to_dcm(*a) for a in angles]
    force = np.array([C.T @ DOWN for C in attitudes])
    turns = [C.T @ D for C, D in zip(attitudes, attitudes[1:], strict=False)]
    rate = np.array([[D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]] for D in turns]) / (2.0 * dt)
    rate = np.vstack([rate[:1], rate])
    noise = [density * np.sqrt(rate_hz) * rng.normal(size=(n, 3)) for density in (accel, gyro)]
    stamps = 10**18 + np.round(1e9 * dt * np.arange(1, n + 1)).astype(np.int64)
    return ImuBlock.of("imu/data_raw", stamps, force + noise[0], rate + noise[1])


def turning(n=2000):
    """Turned by hand about all axes, half a radian and half a hertz."""
    t = np.arange(n) / RATE_HZ
    return np.column_stack([0.5 * np.sin(3.0 * t), 0.4 * np.sin(2.1 * t + 1.0), 0.3 * np.sin(1.3 * t)])


@pytest.mark.parametrize("angles", [None, turning()])
def test_rate_and_noise_are_seen_at_rest_and_in_motion(angles):
    look = look_at(samples(angles=angles))
    assert look.is_at_rest == (angles is None) and look.rate_hz == pytest.approx(100.0) and look.findings == () and not look.holes
    np.testing.assert_allclose(look.gyro_noise, GYRO, rtol=0.25 if angles is None else 1.0)
    np.testing.assert_allclose(look.accel_noise, ACCEL, rtol=0.25 if angles is None else 14.0)  # motion is an upper bound
    assert (look.turns_by is None) == (angles is None) and (angles is None or look.turns_by == pytest.approx(1.0, abs=0.03))


def test_jitter_and_holes_are_seen():
    block, rng = samples(), np.random.default_rng(4)
    stamps = block.stamps_ns + np.round(1e6 * rng.normal(size=len(block))).astype(np.int64)
    look = look_at(ImuBlock.of("imu/data_raw", stamps, block.specific_force_b, block.angular_rate_b)[np.r_[0:700, 760:2000]])
    assert look.jitter_s == pytest.approx(1e-3 * np.sqrt(2.0), rel=0.1)
    assert look.holes == 1 and look.longest_hole_s == pytest.approx(0.61, abs=0.01)
    assert look_at(samples(30)) is None


@pytest.mark.parametrize(
    ("force_factor", "rate_factor", "says"),
    [
        (1.0 / STANDARD_GRAVITY, 1.0, ["specific force is in g"]),
        (1.0 / MILLI_G, 1.0, ["specific force is in mg"]),
        (1.0, 1.0 / DEGREE, ["angular rate is in deg/s"]),
        (1.0, -1.0, ["gravity turns against the gyros"]),
        (0.3, 1.0, ["specific force 2.94 is one g in no unit"]),
        (-1.0, 1.0, ["gravity points up"]),
    ],
)
def test_wrong_units_and_axes_are_named(force_factor, rate_factor, says):
    block = samples(angles=turning())
    look = look_at(ImuBlock.of("imu/data_raw", block.stamps_ns, block.specific_force_b * force_factor, block.angular_rate_b * rate_factor))
    assert [finding.startswith(word) for finding, word in zip(look.findings, says, strict=True)] == [True]
    if rate_factor == 1.0 / DEGREE:
        np.testing.assert_allclose(look.gyro_noise, GYRO, rtol=1.0)


@pytest.mark.parametrize("turn", [(90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0)])
def test_a_mounting_that_levels_the_unit_is_proposed(turn):
    block, C = samples(), euler_to_dcm(*np.radians(np.array(turn, dtype=float)))
    look = look_at(replace(block, specific_force_b=block.specific_force_b @ C))
    assert f"imu.mounting_deg {list(turn)} levels it" in look.findings[0]


def test_settings_follow_what_is_seen_and_what_is_given_stays():
    loud = look_at(samples(gyro=30.0 * GYRO, accel=10.0 * ACCEL))
    seen = as_seen(ImuSettings(profile="auto", accel_bias_mg=7.0), loud)
    assert seen.gyro_noise_dps_rthz == pytest.approx(1.5 * 0.6, rel=0.3) and seen.accel_noise_mg_rthz == pytest.approx(1.5 * 4.0, rel=0.3)
    assert seen.gyro_bias_dps == pytest.approx(0.05 * 30.0) and seen.accel_bias_mg == 7.0
    assert as_seen(seen, loud) == seen
    quiet = as_seen(ImuSettings(), look_at(samples(gyro=1e-3 * GYRO, accel=1e-3 * ACCEL)))
    assert quiet.gyro_bias_dps == pytest.approx(0.05 / 3.0), "a quiet unit may have a bias all the same"
    biased = samples()
    shown = as_seen(ImuSettings(), look_at(replace(biased, angular_rate_b=biased.angular_rate_b + 2.0 * DEGREE)))
    assert shown.gyro_turn_on_dps == pytest.approx(3.0, rel=0.05)
    assert times_the_profile(ImuSettings(), loud)["gyro"] == pytest.approx(50.0, rel=0.3)


@pytest.mark.parametrize("kind", [InsGps, Ahrs])
@pytest.mark.parametrize("profile", ["auto", ""])
def test_a_navigator_flies_on_what_it_sees_and_names_a_wrong_profile(kind, profile):
    flown = [_stand(kind(from_mapping(kind.Settings, {"imu.profile": profile})), cut) for cut in (1, 20)]
    (first, one), (second, other) = flown
    assert [s.stamp_ns for s in one] == [s.stamp_ns for s in other] and len(one) > 20
    assert all(np.array_equal(a.q_nb, b.q_nb) and np.array_equal(a.cov_att, b.cov_att) for a, b in zip(one, other, strict=True))
    if profile:
        assert first.settings.imu.gyro_noise_dps_rthz == pytest.approx(1.5 * 0.4, rel=0.35) == second.settings.imu.gyro_noise_dps_rthz
        assert "at rest 100 Hz" in first.status().details["imu"] and "set by it" in first.imu_words
    else:
        assert first.settings.imu == ImuSettings() and "gyro noise 3" in first.imu_words and "times the settings'" in first.imu_words


def _stand(navigator, cut: int):
    """Stand for eight seconds, the samples fed ``cut`` at a time."""
    block, solutions, place = samples(800, gyro=20.0 * GYRO), [], (0.65, -2.1, 100.0)
    for k in range(0, 800, cut):
        solutions += navigator.feed(block[k : k + cut])
        stamp = int(block.stamps_ns[k + cut - 1])
        if (k + cut) % 20 == 0:
            solutions += navigator.feed(GpsPosition(stamp, "gps/fix", *place, 4.0 * np.eye(3)))
            solutions += navigator.feed(GpsVelocity(stamp, "gps/vel", np.zeros(3), 0.01 * np.eye(3)))
            solutions += navigator.feed(MagneticField(stamp, "imu/mag", np.array([2.2e-5, 0.5e-5, 4.2e-5]), 1e-14 * np.eye(3)))
    return navigator, solutions


def test_holes_count_by_their_length():
    stamps = np.arange(100_000) * 0.01
    stamps[50_000:] += 600.0
    with pytest.raises(CalibrationError, match="1 holes of 600 s together, the longest of 600 s after 499.99 s"):
        regular_rate(stamps)
    stamps = np.arange(100_000) * 0.01
    stamps[50_000:] += 0.5
    assert regular_rate(stamps) == pytest.approx(100.0, rel=1e-9), "a short one is no slower rate"


@pytest.mark.parametrize("job", ["allan", "identify"])
def test_a_fit_comes_with_a_verdict(tmp_path, capsys, job):
    rng, t = np.random.default_rng(8), np.arange(60_000) / 100.0
    white = rng.normal(size=len(t)) * 1e-3
    records = {"white": white, "shaken": white + 5e-3 * np.sin(2.0 * np.pi * 7.3 * t), "moved": white + 0.2 * np.sin(0.05 * t)}
    status, said = {}, {}
    for name, values in records.items():
        path = tmp_path / f"{name}.csv"
        np.savetxt(path, np.column_stack([t, values]), delimiter=",", header="t,gyro_x", comments="", fmt="%.9g")
        status[name] = main([job, str(path), "--unit", "rad/s"])
        said[name] = "".join(capsys.readouterr())
    assert status == {"white": 0, "shaken": 1, "moved": 2}
    assert "verdict: the model holds within" in said["white"] and "verdict: NOT TO BE USED" in said["shaken"]
    assert "is not at rest: one-second means of gyro_x range over" in said["moved"]
