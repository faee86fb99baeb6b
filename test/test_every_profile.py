"""Every shipped IMU profile flies in every inertial navigator and coupling: a data sheet without one error leaves a block out."""

import pytest
from common import scenario
from mutated_messages import VARIANTS, build

from lowcostnav_ros.catalogue.equipment import imu_profile_names
from lowcostnav_ros.navigators.inertial import InertialNavigator
from lowcostnav_ros.replay.session import simulated
from lowcostnav_ros.simulation.simulator import Simulation

INERTIAL = [name for name in VARIANTS if name.startswith(("ahrs", "ins")) and "gnss_only" not in name]


@pytest.fixture(scope="module")
def heard():
    changes = {"truth.duration_s": 25.0, "sensors": ["imu", "magnetometer", "air_data", "gps", "gps_attitude", "gnss"]}
    return [item for item in simulated(Simulation(scenario("turns", 3, **changes)).blocks()) if hasattr(item, "source")]


@pytest.mark.parametrize("profile", imu_profile_names())
def test_a_profile_flies_in_every_inertial_navigator(heard, profile):
    for variant in INERTIAL:
        navigator = build(variant, {"imu": {"profile": profile}, "gps": {"lever_arm_b_m": [1.0, 0.2, -1.5]}})
        solutions = navigator.feed_all(heard)
        assert len(solutions) > 20, variant
        assert not navigator.restarts, variant
        if isinstance(navigator, InertialNavigator):
            assert any(aid.fused for aid in navigator.status().aids if "velocity" in aid.name or "rate" in aid.name), variant
