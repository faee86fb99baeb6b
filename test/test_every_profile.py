"""Every shipped IMU profile flies; of each set of errors that data sheets state, one flies in every inertial navigator and coupling.

An error that is not stated leaves a block out.
"""

import numpy as np
import pytest
from common import scenario
from mutated_messages import VARIANTS, build

from lowcostnav_ros.catalogue.equipment import imu_profile_names, load_imu_profile
from lowcostnav_ros.navigators.inertial import InertialNavigator
from lowcostnav_ros.replay.session import simulated
from lowcostnav_ros.simulation.simulator import Simulation

INERTIAL = [name for name in VARIANTS if name.startswith(("ahrs", "ins")) and "gnss_only" not in name]


def stated(name):
    """Which errors a profile has."""
    noise = load_imu_profile(name).filter_noise()
    return tuple(bool((np.isfinite(part) & (part > 0.0)).any()) for part in (getattr(noise, key) for key in noise.__dataclass_fields__))


def chosen():
    """(profile, navigators): all of them for the first with its set of errors, for each other one of them in turn."""
    seen, pairs = set(), []
    for k, name in enumerate(imu_profile_names()):
        pairs.append((name, INERTIAL[k % len(INERTIAL) :][:1] if stated(name) in seen else INERTIAL))
        seen.add(stated(name))
    return pairs


@pytest.fixture(scope="module")
def heard():
    changes = {"truth.duration_s": 25.0, "sensors": ["imu", "magnetometer", "air_data", "gps", "gps_attitude", "gnss"]}
    return [item for item in simulated(Simulation(scenario("turns", 3, **changes)).blocks()) if hasattr(item, "source")]


@pytest.mark.parametrize(("profile", "variants"), chosen(), ids=lambda value: value if isinstance(value, str) else str(len(value)))
def test_a_profile_flies_in_every_inertial_navigator(heard, profile, variants):
    for variant in variants:
        navigator = build(variant, {"imu": {"profile": profile}, "gps": {"lever_arm_b_m": [1.0, 0.2, -1.5]}})
        solutions = navigator.feed_all(heard)
        assert len(solutions) > 20, variant
        assert not navigator.restarts, variant
        if isinstance(navigator, InertialNavigator):
            assert any(aid.fused for aid in navigator.status().aids if "velocity" in aid.name or "rate" in aid.name), variant
