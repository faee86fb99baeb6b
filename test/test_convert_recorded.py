"""The shipped profiles on the real recordings: is what comes out physically what was driven and flown?"""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.convert import convert
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.physics.rotation import quats_to_euler

pytestmark = pytest.mark.data

DATA = Path(os.environ.get("LOWCOSTNAV_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


def streams(tmp_path, folder, profile):
    report = convert(folder, profile, tmp_path / profile)
    by_source = {}
    with BagReader(tmp_path / profile) as bag:
        for measurement in bag.measurements():
            by_source.setdefault(measurement.source, []).append(measurement)
        assert not bag.decoder.rejected
    assert not report.malformed
    return by_source


def recorded(name):
    if not (DATA / name).is_dir():
        pytest.skip(f"The recorded data {name} is not here; set LOWCOSTNAV_DATA to the folder that holds it.")
    return DATA / name


def a_minute_of(folder, tmp_path, start_s):
    """Copy the rows of one minute of every table, for speed."""
    short = tmp_path / "minute"
    short.mkdir()
    for path in folder.glob("*.csv*"):
        opener = gzip.open if path.suffix == ".gz" else open
        with opener(path, "rt") as file, opener(short / path.name, "wt") as out:
            out.write(next(file))
            out.writelines(line for line in file if start_s <= float(line.split(",")[0]) < start_s + 60.0)
    return short


def inertial(by_source):
    blocks = [b for b in by_source["imu/data_raw"] if isinstance(b, ImuBlock)]
    return (np.concatenate([getattr(b, name) for b in blocks]) for name in ("stamps_ns", "specific_force_b", "angular_rate_b"))


def gnss_velocity(by_source):
    stamps = np.array([v.stamp_ns for v in by_source["gps/vel"]])
    return stamps, np.array([v.vel_n for v in by_source["gps/vel"]])


def mean_between(stamps, column, at, half_s):
    """Mean of a column over ``at`` +- ``half_s`` by its integral; stamps and ``at`` in s."""
    total = np.concatenate([[0.0], np.cumsum(column[1:] * np.diff(stamps))])
    return (np.interp(at + half_s, stamps, total) - np.interp(at - half_s, stamps, total)) / (2 * half_s)


def test_drive_is_upright_and_turns_the_way_it_steers(tmp_path):
    by_source = streams(tmp_path, recorded("gnss_imu_road"), "road_drive")
    stamps, force, rate = inertial(by_source)
    at, vel_n = gnss_velocity(by_source)
    t, at = (stamps - stamps[0]) * 1e-9, (at - stamps[0]) * 1e-9
    assert len(t) == 54860
    assert np.all(np.diff(t) > 0)
    still = t < 8.0
    np.testing.assert_allclose(force[still].mean(axis=0), [0.0, 0.0, -9.81], atol=0.35)  # the sensor's own bias and the road's slope
    speed, course = np.hypot(vel_n[:, 0], vel_n[:, 1]), np.unwrap(np.arctan2(vel_n[:, 1], vel_n[:, 0]))
    moving = speed > 4.0
    course_rate, pull = np.gradient(course, at)[moving], np.gradient(speed, at)[moving]
    lags = np.arange(-0.3, 0.31, 0.025)
    seen = [mean_between(t + lag, rate[:, 2], at, 0.25)[moving] for lag in lags]
    fit = [np.corrcoef(s, course_rate)[0, 1] for s in seen]
    assert max(fit) > 0.995
    assert abs(lags[int(np.argmax(fit))]) < 0.03  # the stated latency of 125 ms leaves nothing
    assert np.polyfit(course_rate, seen[len(lags) // 2], 1)[0] == pytest.approx(1.0, abs=0.04)
    # forward force is acceleration, rightward force centripetal, and the mounting leaves no cross-talk
    basis = np.stack([pull, speed[moving] * course_rate, np.ones(moving.sum())], axis=1)
    forward, right = (np.linalg.lstsq(basis, mean_between(t, force[:, k], at, 0.25)[moving], rcond=None)[0] for k in (0, 1))
    np.testing.assert_allclose(forward[:2], [1.0, 0.0], atol=0.12)
    np.testing.assert_allclose(right[:2], [0.0, 1.0], atol=0.12)


def test_walk_is_upright_and_turns_the_way_it_goes(tmp_path):
    by_source = streams(tmp_path, recorded("gnss_imu_road"), "road_walk")
    stamps, force, rate = inertial(by_source)
    at, vel_n = gnss_velocity(by_source)
    t, at = (stamps - stamps[0]) * 1e-9, (at - stamps[0]) * 1e-9
    assert len(t) == 20455
    np.testing.assert_allclose(force[t < 5.0].mean(axis=0), [0.0, 0.0, -9.81], atol=0.35)
    walking = np.hypot(vel_n[:, 0], vel_n[:, 1]) > 0.6
    course = np.unwrap(np.arctan2(vel_n[:, 1], vel_n[:, 0]))
    course_rate = (np.interp(at + 1.0, at, course) - np.interp(at - 1.0, at, course)) / 2.0
    assert np.corrcoef(mean_between(t, rate[:, 2], at, 1.0)[walking], course_rate[walking])[0, 1] > 0.95


def test_flight_tables_agree_with_each_other(tmp_path):
    by_source = streams(tmp_path, a_minute_of(recorded("px4_proto_flt09"), tmp_path, 200.0), "px4_flight")
    assert set(by_source) == {"gps/fix", "gps/vel", "air/velocity", "imu/data", "imu/data_fused"}
    at, vel_n = gnss_velocity(by_source)
    attitude = by_source["imu/data_fused"]
    t = np.array([a.stamp_ns for a in attitude])
    heading = np.unwrap(quats_to_euler(np.array([a.q_nb for a in attitude]))[:, 2])
    course = np.arctan2(vel_n[:, 1], vel_n[:, 0])
    flying = np.hypot(vel_n[:, 0], vel_n[:, 1]) > 10.0
    off = np.angle(np.exp(1j * (np.interp(at, t, heading) - course)))[flying]
    assert abs(np.median(off)) < np.radians(10)  # drift angle plus the log's own 5 deg
    air = by_source["air/velocity"]
    tas = np.interp(at, [a.stamp_ns for a in air], [a.vel_b[0] for a in air])
    wind = (
        vel_n[flying, :2]
        - (tas[:, np.newaxis] * np.stack([np.cos(np.interp(at, t, heading)), np.sin(np.interp(at, t, heading))], axis=1))[flying]
    )
    np.testing.assert_allclose(np.median(wind, axis=0), [-1.0, 2.2], atol=1.5)
    rate = np.array([a.angular_rate_b for a in attitude])
    assert np.abs(np.corrcoef(rate[1:, 2], np.diff(heading) / np.diff(t))[0, 1]) > 0.5
    assert air[0].cov_b[1, 1] >= 1e6
