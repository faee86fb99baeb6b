"""Encoding: bytes of the column path, solutions, truth, diagnostics and the topic table against rclpy-independent message objects."""

import numpy as np
import pytest

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.messages import encode as e
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.decode import Decoder, decode
from lowcostnav_ros.messages.store import STORE, from_cdr, to_cdr
from lowcostnav_ros.physics.earth import LocalFrame


def test_columns_write_the_bytes_of_single_messages():
    rng = np.random.default_rng(1)
    block = m.ImuBlock.of("imu/data_raw", np.arange(1, 8) * 999_999_937, rng.normal(size=(7, 3)), rng.normal(size=(7, 3)))
    one_by_one = [to_cdr(e.imu_raw(*row)) for row in zip(block.stamps_ns, block.specific_force_b, block.angular_rate_b, strict=True)]
    assert e.imu_raw_cdr(block) == one_by_one
    message = from_cdr(one_by_one[2], topics.IMU)
    assert message.orientation_covariance[0] == -1.0
    assert message.linear_acceleration.z == -block.specific_force_b[2, 2]  # level and still reads +9.81 upwards in ROS


def test_solution_becomes_an_imu_message_and_comes_back():
    q = np.array([0.5, -0.5, 0.5, 0.5])
    sent = m.NavSolution(
        5, "ahrs", q_nb=q, angular_rate_b=np.ones(3), specific_force_b=np.array([0, 0, -9.8]), cov_att=np.diag([1e-4, 2e-4, 3e-3])
    )
    back = decode("imu/data", topics.IMU, to_cdr(e.imu_from_solution(sent)))
    np.testing.assert_allclose(back.q_nb, q, atol=1e-15)
    np.testing.assert_array_equal(back.cov_att, sent.cov_att)
    np.testing.assert_array_equal(back.specific_force_b, sent.specific_force_b)
    with pytest.raises(ValueError, match="no attitude and rate"):
        e.imu_from_solution(m.NavSolution(5, "gps", 0.1, 0.2, 3.0))


def test_truth_survives_its_messages():
    rng = np.random.default_rng(2)
    n = 3
    q = rng.normal(size=(n, 4))
    q /= np.linalg.norm(q, axis=1)[:, np.newaxis]
    vectors = [rng.normal(size=(n, 3)) for _ in range(4)]
    truth = TruthBlock(np.arange(1, n + 1) * 10**9, np.full(n, 0.65), np.full(n, -2.1), np.full(n, 700.0), vectors[0], q, *vectors[1:])
    origin = LocalFrame(0.64, -2.11, 0.0)
    decoder = Decoder()
    decoder.rules.origins["truth"] = origin
    for k in range(n):
        imu = decoder.decode("truth/imu", topics.IMU, to_cdr(e.truth_imu(truth, k)))
        np.testing.assert_allclose(np.abs(imu.q_nb @ q[k]), 1.0, atol=1e-15)
        np.testing.assert_array_equal(imu.specific_force_b, truth.specific_force_b[k])
        np.testing.assert_array_equal(imu.cov_att, np.zeros((3, 3)))
        pose = decoder.decode("truth/odometry", topics.ODOMETRY, to_cdr(e.truth_odometry(truth, k, origin)))
        np.testing.assert_allclose([pose.lat, pose.lon], [0.65, -2.1], rtol=0, atol=1e-14)
        np.testing.assert_allclose(pose.vel_n, truth.vel_n[k], atol=1e-14)
        wind = decoder.decode("truth/wind", topics.TWIST, to_cdr(e.truth_wind(truth, k)))
        np.testing.assert_array_equal([*wind.wind_n, wind.states["wind_down_mps"][0]], truth.wind_n[k])
    assert not decoder.rejected


def test_no_position_is_no_fix():
    fix = e.fix_from_solution(m.NavSolution(5, "dead_reckoning"))
    assert fix.status.status == -1
    assert e.wind_from_solution(m.NavSolution(5, "dead_reckoning")) is None


def test_diagnostics_are_plain_text():
    array = e.diagnostics(7, [("ins_gps", 1, "coasting", {"sigma_north_m": 12.3456789, "mode": "coast", "count": 3})])
    back = from_cdr(to_cdr(array), topics.DIAGNOSTICS)
    assert (back.status[0].name, back.status[0].level, back.status[0].message) == ("ins_gps", 1, "coasting")
    assert [(v.key, v.value) for v in back.status[0].values] == [("sigma_north_m", "12.3457"), ("mode", "coast"), ("count", "3")]


def test_encode_refuses_what_has_no_message():
    with pytest.raises(TypeError, match="no message of its own"):
        e.encode(m.NavSolution(5, "x"))


def test_topic_table():
    assert topics.spec("/imu/data_raw").msgtype == topics.IMU
    assert topics.spec("ins_gps/origin").latched
    assert topics.spec("nav/odometry").msgtype == topics.ODOMETRY
    assert all(topic.msgtype in STORE.types for topic in [*topics.TOPICS.values(), *topics.NAVIGATOR_TOPICS.values()])
    with pytest.raises(ValueError, match="did you mean 'gps/fix'"):
        topics.spec("gps/fx")
    with pytest.raises(ValueError, match="Unknown topic 'imu/odometry'"):
        topics.spec("imu/odometry")
