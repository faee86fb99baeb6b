"""The truth of a simulation: odometry, ideal inertial samples, wind, and the origin of its map frame."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.messages.kind import BODY_FRAMES, TopicSpec, describe
from lowcostnav_ros.messages.kinds.imu import attitude_sample, decode_attitude, imu_attitude, imu_message
from lowcostnav_ros.messages.kinds.navigator import OF_ODOMETRY, OF_ORIGIN, OF_WIND, odometry_from_solution, wind_message
from lowcostnav_ros.messages.parts import UNKNOWN
from lowcostnav_ros.messages.topics import IMU, NAV_SAT_FIX, ODOMETRY, TWIST
from lowcostnav_ros.physics.earth import LocalFrame


def truth_imu(block: TruthBlock, row: int) -> Any:
    """Build a ``truth/imu`` message: ideal inertial sample with the true attitude, covariances exactly zero."""
    zero = np.zeros((3, 3))
    return imu_message(block.stamps_ns[row], block.q_nb[row], zero, block.angular_rate_b[row], block.specific_force_b[row], UNKNOWN)


def truth_odometry(block: TruthBlock, row: int, origin: LocalFrame) -> Any:
    """Build a ``truth/odometry`` message in the map frame of ``origin``, covariances exactly zero."""
    zero = np.zeros((3, 3))
    solution = NavSolution(
        int(block.stamps_ns[row]),
        "truth",
        float(block.lat[row]),
        float(block.lon[row]),
        float(block.height[row]),
        np.ascontiguousarray(block.vel_n[row]),
        np.ascontiguousarray(block.q_nb[row]),
        block.angular_rate_b[row],
        cov_pos=zero,
        cov_vel=zero,
        cov_att=zero,
    )
    message = odometry_from_solution(solution, origin)
    message.twist.covariance[:] = 0.0
    return message


def truth_wind(block: TruthBlock, row: int) -> Any:
    """Build a ``truth/wind`` message, covariance exactly zero."""
    return wind_message(block.stamps_ns[row], block.wind_n[row], np.zeros((3, 3)))


describe(__name__, TopicSpec("truth/odometry", ODOMETRY, "True pose and velocity, simulators only.", "map", "m, m/s"), **OF_ODOMETRY)
describe(__name__, TopicSpec("truth/wind", TWIST, "True velocity of the air mass, east north up at the aircraft.", "map", "m/s"), **OF_WIND)
_ORIGIN = "Geodetic origin of the map frame of truth/odometry."
describe(__name__, TopicSpec("truth/origin", NAV_SAT_FIX, _ORIGIN, "map", "deg, m", True), **OF_ORIGIN)
describe(
    __name__,
    TopicSpec("truth/imu", IMU, "Ideal inertial sample with the true attitude, simulators only.", "base_link", "m/s^2, rad/s"),
    measurement=Attitude,
    decode=decode_attitude,
    encode=imu_attitude,
    frames=BODY_FRAMES,
    sample=attitude_sample,
    recorded=False,
)
