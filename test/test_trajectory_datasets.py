"""The closed-form datasets against the limits published for them, and the strapdown against their analytic IMU."""

import math

import numpy as np
import pymap3d
import pytest

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.physics.rotation import quats_to_euler
from lowcostnav_ros.physics.strapdown import strapdown_step
from lowcostnav_ros.trajectory import TruthSettings, build
from lowcostnav_ros.trajectory.datasets import PROFILES, attitude_of, velocity_of


def flight(name: str, **changes):
    return build(TruthSettings(kind="dataset", name=name, **changes)).table()


def limits(truth) -> dict[str, float]:
    level = np.hypot(truth.vel_n[:, 0], truth.vel_n[:, 1])
    acceleration = np.linalg.norm(np.diff(truth.vel_n, axis=0), axis=1) * 100.0
    return {
        "slowest": level.min(),
        "fastest": level.max(),
        "climb": np.abs(truth.vel_n[:, 2]).max(),
        "acceleration": acceleration.max(),
        "acceleration_rms": math.sqrt(np.mean(acceleration**2)),
        "rate_dps": math.degrees(np.abs(truth.angular_rate_b).max()),
        "bank_deg": math.degrees(np.abs(quats_to_euler(truth.q_nb)[:, 0]).max()),
        "lowest": truth.height.min(),
        "highest": truth.height.max(),
    }


def from_start(truth) -> np.ndarray:
    east, north, up = pymap3d.geodetic2enu(truth.lat, truth.lon, truth.height, math.radians(38.7), math.radians(-9.1), 500.0, deg=False)
    return np.column_stack((north, east, -up))


def test_low_dynamics_keeps_its_published_limits():
    truth = flight("LD")
    found = limits(truth)
    assert (found["slowest"], found["fastest"], found["climb"]) == pytest.approx((30.0, 55.0, 4.0), abs=1e-4)
    assert found["acceleration"] == pytest.approx(4.05, abs=0.01)
    assert found["rate_dps"] == pytest.approx(4.0, abs=0.05)
    assert found["bank_deg"] == pytest.approx(22.5, abs=0.1)
    assert (found["lowest"], found["highest"]) == pytest.approx((500.0, 691.0), abs=0.1)
    track = from_start(truth)[:, :2]
    assert np.linalg.norm(track[-1]) < 6.0
    assert np.ptp(track, axis=0).max() == pytest.approx(6700.0, abs=150.0)


def test_gentle_circle_keeps_its_published_limits():
    found = limits(flight("LD-gentle"))
    assert (found["slowest"], found["fastest"], found["climb"]) == pytest.approx((35.0, 55.0, 4.0), abs=1e-4)
    assert found["acceleration"] <= 0.6
    assert found["rate_dps"] == pytest.approx(0.61, abs=0.06)  # the earth's rate is a hundredth of a degree of it


def test_high_dynamics_keeps_its_published_limits():
    truth = flight("HD")
    found = limits(truth)
    assert (found["slowest"], found["fastest"]) == pytest.approx((30.0, 100.0), abs=1e-3)
    assert found["climb"] <= 6.0
    assert (found["lowest"], found["highest"]) == pytest.approx((500.0, 1158.0), abs=0.6)
    assert found["acceleration"] == pytest.approx(10.6, abs=0.05)
    assert found["acceleration_rms"] == pytest.approx(9.1, abs=0.05)
    assert found["rate_dps"] == pytest.approx(8.1, abs=0.05)
    assert found["bank_deg"] == pytest.approx(47.0, abs=0.2)
    level = np.hypot(truth.vel_n[:, 0], truth.vel_n[:, 1])
    turn_rate = np.diff(np.unwrap(quats_to_euler(truth.q_nb)[:, 2])) * 100.0
    assert (level[1:] / turn_rate)[[0, 29_999, -1]] == pytest.approx((191.0, 955.0, 191.0), abs=1.0)


def test_straight_dataset_is_uniform():
    truth = flight("STR", duration_s=60.0)
    course = np.arctan2(truth.vel_n[:, 1], truth.vel_n[:, 0])
    np.testing.assert_allclose(course, 0.3, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(truth.vel_n, axis=1), 50.0, rtol=1e-14)


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_profile_derivatives_match_differences(name):
    t = np.linspace(1.0, 599.0, 5000)
    h = 1e-4
    here, before, after = (PROFILES[name](x) for x in (t, t - h, t + h))
    angles_1 = (attitude_of(after)[0] - attitude_of(before)[0]) / (2 * h)
    np.testing.assert_allclose(attitude_of(here)[1], angles_1, atol=3e-7)
    np.testing.assert_allclose(velocity_of(here)[1], (velocity_of(after)[0] - velocity_of(before)[0]) / (2 * h), atol=3e-6)


@pytest.mark.parametrize(("name", "metres"), [("LD", 1e-3), ("LD-gentle", 5e-4), ("HD", 5e-3), ("STR", 1e-4)])
def test_strapdown_follows_the_analytic_imu(name, metres):
    """Ten minutes of ideal IMU: the published figures are 0.5 mm (gentle), 9.4 mm (HD), 56 mm (LD)."""
    truth = flight(name)
    nav = np.concatenate(([truth.lat[0], truth.lon[0], truth.height[0]], truth.vel_n[0], truth.q_nb[0]))
    dv, dtheta = truth.specific_force_b * 0.01, truth.angular_rate_b * 0.01
    for k in range(1, len(truth)):
        strapdown_step(nav, dv[k], dtheta[k], dv[k - 1], dtheta[k - 1], 0.01)
    missed = pymap3d.geodetic2enu(*nav[:3], truth.lat[-1], truth.lon[-1], truth.height[-1], deg=False)
    assert np.abs(missed).max() < metres
    assert np.abs(nav[3:6] - truth.vel_n[-1]).max() < 2e-4


def test_blocks_hold_the_same_bits_and_refusals_say_what_exists():
    trajectory = build(TruthSettings(kind="dataset", name="HD", duration_s=20.0))
    whole, parts = trajectory.table(), list(trajectory.blocks(0.7))
    np.testing.assert_array_equal(np.concatenate([p.specific_force_b for p in parts]), whole.specific_force_b)
    np.testing.assert_array_equal(np.concatenate([p.lat for p in parts]), whole.lat)
    with pytest.raises(SettingsError, match="There is no dataset 'ld-'"):
        flight("ld-")
    with pytest.raises(SettingsError, match="last 600 s"):
        flight("LD", duration_s=700.0)
