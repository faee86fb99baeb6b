"""The approach category on /diagnostics: what a navigator's own sigmas allow, in flight and without a truth."""

import pytest

pytest.importorskip("rclpy")

from lowcostnav_ros.navigators.base import NavigatorStatus
from lowcostnav_ros.ros.diagnostics import navigator_rows


@pytest.mark.parametrize(
    ("horizontal_m", "down_m", "expected"), [(2.0, 0.3, "III"), (2.5, 0.8, "II"), (8.5, 2.0, "I"), (8.6, 2.0, "none"), (2.0, 2.1, "none")]
)
def test_twice_the_sigmas_decide(horizontal_m, down_m, expected):
    status = NavigatorStatus("nav", "gps", "", 0, 0, {"position_horizontal_m": horizontal_m, "position_down_m": down_m}, [], [])
    assert navigator_rows("nav", status)[0].values["approach_category"] == expected


def test_who_has_no_position_claims_no_category():
    status = NavigatorStatus("ahrs", "gps", "", 0, 0, {"tilt_deg": 0.2}, [], [])
    assert "approach_category" not in navigator_rows("ahrs", status)[0].values


def test_what_a_navigator_says_of_itself_by_key_stands_beside_mode_and_reason():
    status = NavigatorStatus("supervisor", "gps", "", 0, 0, {}, [], [], details={"flying_on": "ins_gps"})
    assert navigator_rows("supervisor", status)[0].values == {"mode": "gps", "reason": "", "flying_on": "ins_gps"}
