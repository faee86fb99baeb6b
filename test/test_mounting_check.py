"""An IMU mounted turned about the vertical, told from wind by the angle between nose and track on all headings."""

import math

import numpy as np
import pytest

from lowcostnav_ros.estimation.cross_checks.heading import MountingCheck


def flown(turned_deg: float, wind_mps: float, turn_deg_s: float, seconds: int = 200) -> MountingCheck:
    """A check after a flight at 20 m/s through the air, a unit that reads ``turned_deg`` more than the nose."""
    check = MountingCheck("imu/data_raw")
    for k in range(seconds):
        nose = math.radians(turn_deg_s * k)
        north, east = 20.0 * math.cos(nose) + wind_mps, 20.0 * math.sin(nose)
        check.compare(10**18 + 10**9 * k, nose + math.radians(turned_deg), 0.02, north, east)
    return check


@pytest.mark.parametrize("turned_deg", [90.0, -90.0, 180.0, 45.0])
def test_a_turned_unit_is_named_once_it_has_flown_all_ways(turned_deg):
    held = flown(turned_deg, 3.0, 3.0).held
    assert held is not None and held.size == pytest.approx(abs(turned_deg), abs=6.0)
    yaw = float(held.advice.rsplit(",", 1)[1])
    assert abs(np.angle(np.exp(1j * np.radians(yaw - turned_deg)), deg=True)) < 6.0


@pytest.mark.parametrize(
    ("turned_deg", "wind_mps", "turn_deg_s"), [(0.0, 3.0, 3.0), (0.0, 19.0, 3.0), (0.0, 30.0, 1.0), (90.0, 0.0, 0.0), (20.0, 5.0, 3.0)]
)
def test_wind_a_straight_flight_and_a_heading_that_is_off_are_no_mounting(turned_deg, wind_mps, turn_deg_s):
    assert flown(turned_deg, wind_mps, turn_deg_s).held is None


def test_a_heading_that_is_not_known_and_a_walk_tell_nothing():
    check = MountingCheck("imu/data_raw")
    for k in range(300):
        track = 0.05 * k
        check.compare(10**18 + 10**9 * k, track + 1.6, 0.3, 20.0 * math.cos(track), 20.0 * math.sin(track))
        check.compare(10**18 + 10**9 * k + 1, track + 1.6, 0.02, 1.5 * math.cos(track), 1.5 * math.sin(track))
    assert check.held is None
