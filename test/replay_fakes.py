"""A navigator that believes every fix, and a flight whose errors are known in closed form: for the tests of the replay."""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, ImuBlock, NavSolution
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.estimation.aiding import AidStatus
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.physics.earth import LocalFrame, displace
from lowcostnav_ros.physics.rotation import euler_to_quat

NS = 1_000_000_000
LAT, LON, HEIGHT = math.radians(37.69), math.radians(-121.82), 500.0
SPEED = 50.0


@dataclass(frozen=True)
class FakeSettings:
    """Settings of the fakes."""

    horizon: HorizonSettings = group(HorizonSettings)
    north_bias_m: float = setting(0.0, "Added to every fix.", unit="m")


class FixFollower(Navigator):
    """Believes the last fix, holds it between fixes, and reports 10 Hz off the inertial stamps; 5 m sigma, level, heading east."""

    name = "follower"
    Settings = FakeSettings
    inputs = {"imu/data_raw": True, "gps/fix": True}
    inertial = "imu/data_raw"

    def __init__(self, settings):
        super().__init__(settings)
        self.fix = None
        self.next_ns = None
        self.record = AidStatus("gps_position", ("north_m", "east_m", "down_m"))

    def _fuse(self, item):
        if isinstance(item, GpsPosition):
            self.fix = item
            self.set_origin(item.lat, item.lon, item.height)
            self._note(item)
            return
        for stamp in item.stamps_ns.tolist():
            if self.fix is not None and (self.next_ns is None or stamp >= self.next_ns):
                self.next_ns = stamp + self.output_period_ns
                self._out.append(self._solution(stamp))

    def _note(self, item):
        status = self.record
        status.stamp_ns, status.accepted, status.reason = item.stamp_ns, True, ""
        status.observation, status.innovation = np.zeros(3), np.array([3.0, -4.0, 0.0])
        status.innovation_variance, status.nis, status.test_ratio = np.full(3, 25.0), 1.0, 0.1
        if self.on_aid is not None:
            self.on_aid(status)

    def _solution(self, stamp):
        place = displace(self.fix.lat, self.fix.lon, self.fix.height, np.array([self.settings.north_bias_m, 0.0, 0.0]))
        return NavSolution(
            stamp, self.name, *place, np.array([0.0, SPEED, 0.0]), euler_to_quat(0.0, 0.0, math.pi / 2), np.zeros(3), np.zeros(3),
            np.eye(3) * 25.0, np.eye(3) * 0.04, np.eye(3) * 1e-4, mode="gps", states={"gyro_bias_x_radps": (0.001, 0.0005)},
        )  # fmt: skip

    def _predict(self):
        return None

    def _restart(self):
        self.fix = self.next_ns = None

    def _sigmas(self):
        return {}


class Listener(Navigator):
    """Hears an AHRS and a follower, and keeps what it heard."""

    name = "listener"
    Settings = FakeSettings
    inputs = {"imu/data_fused": True, "follower/odometry_fused": False}

    def __init__(self, settings):
        super().__init__(settings)
        self.heard = []

    def _fuse(self, item):
        self.heard.append(item)

    def _predict(self):
        return None

    def _restart(self):
        self.heard = []

    def _sigmas(self):
        return {}


class FakeAhrs(FixFollower):
    """An AHRS by name and output: attitude only."""

    name = "ahrs"
    inputs = {"imu/data_raw": True, "gps/fix": True}

    def _solution(self, stamp):
        q = euler_to_quat(0.1, 0.05, 2.0 + 1e-9 * (stamp % NS))
        return NavSolution(stamp, self.name, q_nb=q, angular_rate_b=np.full(3, 0.01), specific_force_b=np.array([0.0, 0.0, -9.8]),
                           cov_att=np.eye(3) * 1e-4, mode="gps")  # fmt: skip


REGISTRY = {"ahrs": FakeAhrs, "follower": FixFollower, "listener": Listener}


def truth(t_s, start_s=0.0):
    """Level flight due east along the parallel at 50 m/s; a fix is the truth itself."""
    t = np.atleast_1d(np.asarray(t_s, dtype=float))
    n = len(t)
    frame = LocalFrame(LAT, LON, HEIGHT)
    east_per_rad = frame.to_ned(LAT, LON + 1e-6, HEIGHT)[..., 1] / 1e-6
    q = np.tile(euler_to_quat(0.0, 0.0, math.pi / 2), (n, 1))
    return TruthBlock(
        np.round((t + start_s) * NS).astype(np.int64), np.full(n, LAT), LON + SPEED * t / east_per_rad, np.full(n, HEIGHT),
        np.tile([0.0, SPEED, 0.0], (n, 1)), q, np.tile([0.0, 0.0, -9.8], (n, 1)), np.zeros((n, 3)), np.tile([1.0, 2.0, 0.0], (n, 1)),
    )  # fmt: skip


def flight(seconds=20, start_s=100.0, rate_hz=20, with_truth=True):
    """Items of a stream: per second a truth block, a fix at its start (the truth itself, 1 Hz), velocity, and inertial samples."""
    for second in range(seconds):
        t = second + np.arange(1, rate_hz + 1) / rate_hz
        if with_truth:
            yield truth(np.concatenate([[second], t]) if second == 0 else t, start_s)
        fix = truth(float(second), start_s)
        stamp = int(fix.stamps_ns[0])
        yield GpsPosition(stamp, "gps/fix", float(fix.lat[0]), float(fix.lon[0]), HEIGHT, np.eye(3) * 4.0)
        yield GpsVelocity(stamp, "gps/vel", fix.vel_n[0], np.eye(3) * 0.01)
        block = truth(t, start_s)
        yield ImuBlock.of("imu/data_raw", block.stamps_ns, block.specific_force_b, block.angular_rate_b)


def write_bag(path, items, extra=(), storage="mcap"):
    """Record items as live nodes would; ``extra`` are (topic, stamp_ns, message) more, written in order of stamps."""
    origin = LocalFrame(LAT, LON, HEIGHT)
    rows = []
    for item in items:
        if isinstance(item, TruthBlock):
            for row, stamp in enumerate(item.stamps_ns.tolist()):
                rows.append((stamp, "truth/odometry", topics.ODOMETRY, to_cdr(encode.truth_odometry(item, row, origin))))
                rows.append((stamp, "truth/wind", topics.TWIST, to_cdr(encode.truth_wind(item, row))))
            if not any(topic == "truth/origin" for _, topic, _, _ in rows):
                stamp = int(item.stamps_ns[0])
                rows.insert(0, (stamp, "truth/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(stamp, origin))))
        elif isinstance(item, Attitude):
            rows.append((item.stamp_ns, item.source, topics.IMU, to_cdr(encode.imu_attitude(item))))
        else:
            rows += encode.encode_cdr(item)
    rows += [(stamp, topic, message.__msgtype__, to_cdr(message)) for topic, stamp, message in extra]
    with BagWriter(path, storage) as writer:
        for stamp, topic, msgtype, raw in sorted(rows, key=lambda r: r[0]):
            writer.write(topic, msgtype, stamp, raw)
    return path


def write_config(folder):
    """A configuration directory with a file for every fake."""
    for name in REGISTRY:
        (folder / f"{name}.yaml").write_text("/**:\n  ros__parameters:\n    horizon.lag_s: 0.05\n")
    return folder
