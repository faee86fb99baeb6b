"""A flight that dead reckoning can be held against: motion through a known air mass, with chosen sensor errors."""

import math
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude, GpsPosition, GpsVelocity, SlantRange
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.radionav.geometry import range_and_direction
from lowcostnav_ros.radionav.stations import Station, StationTable

ORIGIN = LocalFrame(math.radians(37.7), math.radians(-121.8), 600.0)
START_NS = 1_000_000_000_000
NM = 1852.0


@dataclass
class Flight:
    """Truth on a regular grid: NED position (n, 3) in ``ORIGIN``, heading (n,), airspeed (n,), wind (n, 2)."""

    dt: float
    heading: np.ndarray
    speed: np.ndarray
    wind: np.ndarray
    start: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        n = len(self.heading)
        self.stamps_ns = START_NS + np.round(1e9 * self.dt * np.arange(n)).astype(np.int64)
        air = np.column_stack((self.speed * np.cos(self.heading), self.speed * np.sin(self.heading)))
        self.vel = air + self.wind
        steps = 0.5 * (self.vel[1:] + self.vel[:-1]) * self.dt
        self.ned = np.zeros((n, 3))
        self.ned[1:, 0:2] = np.cumsum(steps, axis=0)
        self.ned += self.start
        self.lat, self.lon, self.height = ORIGIN.from_ned(self.ned)

    def __len__(self) -> int:
        return len(self.heading)

    def attitudes(self, error=0.0, every=1):
        error = np.broadcast_to(error, len(self))
        rate = np.gradient(np.unwrap(self.heading), self.dt)
        for k in range(0, len(self), every):
            q = euler_to_quat(0.0, 0.0, self.heading[k] - error[k])
            yield Attitude(int(self.stamps_ns[k]), "imu/data_fused", q, 1e-4 * np.eye(3), np.array([0.0, 0.0, rate[k]]), None)

    def airspeeds(self, scale=0.0, bias=0.0, every=1):
        """Measured so that the true airspeed is measured * (1 + scale) + bias."""
        bias = np.broadcast_to(bias, len(self))
        cov = np.diag([0.25, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
        for k in range(0, len(self), every):
            measured = (self.speed[k] - bias[k]) / (1.0 + scale)
            yield AirVelocity(int(self.stamps_ns[k]), "air/velocity", np.array([measured, 0.0, 0.0]), cov)

    def gps(self, rng, every=1, sigma=2.0, sigma_v=0.1):
        for k in range(0, len(self), every):
            where = ORIGIN.from_ned(self.ned[k] + rng.normal(0.0, sigma, 3))
            yield GpsPosition(int(self.stamps_ns[k]), "gps/fix", *where, sigma**2 * np.eye(3))
            vel = np.append(self.vel[k], 0.0) + rng.normal(0.0, sigma_v, 3)
            yield GpsVelocity(int(self.stamps_ns[k]), "gps/vel", vel, sigma_v**2 * np.eye(3))

    def ranges(self, stations, errors, every):
        """One receiver, stations in turn; ``errors``: ident to (n,) metres."""
        idents = [s.ident for s in stations]
        for turn, k in enumerate(range(every, len(self), every)):
            station = stations[idents[turn % len(idents)]]
            true_m, _ = range_and_direction(self.lat[k], self.lon[k], self.height[k], station.lat, station.lon, station.height)
            yield SlantRange(int(self.stamps_ns[k]), "dme/range", station.ident, true_m + errors[station.ident][k], (0.004 * NM) ** 2)


def station(ident, north_m, east_m, height=0.0):
    lat, lon, _ = ORIGIN.from_ned(np.array([north_m, east_m, 0.0]))
    return Station(ident, ident, lat, lon, height, height, "120X", "H")


def table(*stations):
    return StationTable(stations)


def in_order(*streams):
    """All measurements by stamp, as the horizon would hand them over."""
    return sorted((m for stream in streams for m in stream), key=lambda m: (m.stamp_ns, m.source))


def turning(seconds, dt=0.1, speed=50.0, wind=(5.0, -3.0), rate_deg=3.0, leg_s=60.0):
    """Straight legs with turns between them, constant wind."""
    t = np.arange(0.0, seconds, dt)
    turns = np.where((t % (2.0 * leg_s)) > leg_s, math.radians(rate_deg), 0.0)
    heading = np.cumsum(turns) * dt
    return Flight(dt, heading, np.full(len(t), speed), np.tile(np.asarray(wind, float), (len(t), 1)))


def straight(seconds, dt=0.1, speed=50.0, wind=(5.0, -3.0), heading=0.0):
    n = round(seconds / dt)
    return Flight(dt, np.full(n, heading), np.full(n, speed), np.tile(np.asarray(wind, float), (n, 1)))
