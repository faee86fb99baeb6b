"""Grades of Table 3.4, gaps included, and where a user meets them."""

import math

import numpy as np
import pytest

from lowcostnav_ros.catalogue.equipment import imu_profile_names, load_imu_profile
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.physics.stochastic import GaussMarkov, initial_state, simulate
from lowcostnav_ros.sensors.imu_grade import GRADES_DEG_PER_H, grade, grade_of, gyro_bias_deg_per_h
from lowcostnav_ros.sensors.imu_profile import imu_profile_from_text


@pytest.mark.parametrize(
    ("bias_deg_per_h", "expected"),
    [
        *((0.0, "strategic"), (1e-4, "strategic"), (0.005, "navigation"), (0.01, "navigation")),
        *((0.1, "tactical"), (10.0, "tactical"), (100.1, "automotive"), (4230.0, "automotive")),
        *((6e-4, "strategic"), (8e-4, "navigation")),  # geometric middle of 1e-4 and 0.005 at 7.07e-4
        *((0.03, "navigation"), (0.033, "tactical"), (31.0, "tactical"), (32.0, "automotive")),
    ],
)
def test_grades_of_the_table_and_the_nearest_in_its_gaps(bias_deg_per_h, expected):
    assert grade(bias_deg_per_h) == expected


def test_a_worse_gyro_is_never_of_a_better_grade():
    order = list(GRADES_DEG_PER_H)
    found = [order.index(grade(10.0 ** (0.02 * k - 6.0))) for k in range(600)]
    assert found == sorted(found) and set(found) == {0, 1, 2, 3}


@pytest.mark.parametrize("bias", [-1.0, math.nan, math.inf])
def test_what_is_no_bias_is_refused(bias):
    with pytest.raises(ValueError, match="must be a finite number of deg/h"):
        grade(bias)


def test_the_worst_gyro_of_a_profile_counts_with_turn_on_and_drift():
    assert gyro_bias_deg_per_h(load_imu_profile("crista")) == pytest.approx(math.hypot(4230.0, 211.0))
    found = {name: grade_of(load_imu_profile(name)) for name in imu_profile_names()}
    assert (found["crista"], found["fog"], found["tactical"], found["dmu_fog"]) == ("automotive", "tactical", "tactical", "")
    assert grade_of(imu_profile_from_text("gyro: {turn_on_bias_deg_per_h: [0.001, 0.008, 0.001]}")) == "navigation"


def test_a_recording_at_rest_says_of_which_grade_its_worst_gyro_is(tmp_path, capsys):
    rng, process = np.random.default_rng(1), GaussMarkov(0.05, 100.0)  # 180 deg/h
    drift = simulate(process, 0.1, 20_000, rng, initial_state(process, rng))[0][:, 0]
    quiet, loud = 0.001 * rng.standard_normal(20_000), drift + 0.01 * rng.standard_normal(20_000)
    np.savetxt(tmp_path / "still.csv", np.column_stack((quiet, loud)), header="gx,gy", delimiter=",", comments="")
    assert cli.main(["identify", str(tmp_path / "still.csv"), "--rate", "10", "--unit", "deg/s"]) == 0
    assert "deg/h (gy): automotive grade at best" in capsys.readouterr().out


def test_the_listing_shows_the_grade_and_one_profile_its_filter_numbers(capsys):
    assert cli.main(["profiles"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in imu_profile_names()) and "tactical" in listed
    assert cli.main(["profiles", "fog"]) == 0
    assert "imu.gyro_turn_on_dps: 0.00138889" in capsys.readouterr().out
    assert cli.main(["profiles", "fogg"]) == 2
    assert "did you mean 'fog'" in capsys.readouterr().err
