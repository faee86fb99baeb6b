"""What dead reckoning holds between measurements: the last attitude with its rate and the last air-relative velocity."""

import math
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude
from lowcostnav_ros.cores.reckoning_model import DEG, air_velocity_n
from lowcostnav_ros.cores.reckoning_settings import AirspeedSettings

LONGEST_TURN_S = 0.5
"""An attitude is turned on with its own rate for this long at most; after that it is held."""

LANDED = 0.8
"""Share of the minimum airspeed below which an aircraft that was flying counts as landed; the step keeps gusts from toggling it."""


@dataclass(slots=True)
class HeldInputs:
    """Last attitude and air data; ``vel_b`` (3,) m/s air-relative, FRD; ``speed`` true airspeed as measured, m/s."""

    q_nb: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    rate_b: np.ndarray = field(default_factory=lambda: np.zeros(3))
    force_b: np.ndarray | None = None
    cov_att: np.ndarray = field(default_factory=lambda: np.eye(3))
    attitude_ns: int | None = None
    vel_b: np.ndarray = field(default_factory=lambda: np.zeros(3))
    speed: float = 0.0
    air_ns: int | None = None
    airborne: bool = False
    fastest: float = 0.0  # while airborne and since GPS last saw the aircraft on the ground, m/s

    def take_attitude(self, attitude: Attitude) -> None:
        """Hold a new attitude."""
        self.q_nb, self.cov_att, self.attitude_ns = attitude.q_nb, attitude.cov_att, attitude.stamp_ns
        self.rate_b = np.zeros(3) if attitude.angular_rate_b is None else attitude.angular_rate_b
        self.force_b = attitude.specific_force_b

    def take_air(self, air: AirVelocity, settings: AirspeedSettings) -> None:
        """Hold a new air-relative velocity and decide whether the aircraft flies."""
        self.vel_b = body_velocity(air, settings)
        self.speed, self.air_ns = math.sqrt(self.vel_b @ self.vel_b), air.stamp_ns
        self.airborne = self.speed >= settings.minimum_mps * (LANDED if self.airborne else 1.0)
        if self.airborne:
            self.fastest = max(self.fastest, self.speed)

    def air_n(self, t_ns: int) -> np.ndarray:
        """Air-relative velocity (3,) in n at a time, the attitude turned on with its rate."""
        age_s = 0.0 if self.attitude_ns is None else 1e-9 * (t_ns - self.attitude_ns)
        return air_velocity_n(self.q_nb, self.rate_b, min(max(age_s, 0.0), LONGEST_TURN_S), self.vel_b)

    def timed_out(self, t_ns: int, attitude_s: float, air_s: float) -> str:
        """Which input is older than it may be at ``t_ns``, in words; empty when both are fresh."""
        for what, stamp_ns, limit_s in (("attitude", self.attitude_ns, attitude_s), ("airspeed", self.air_ns, air_s)):
            if stamp_ns is None:
                return f"no {what} yet"
            if t_ns - stamp_ns > 1e9 * limit_s:
                return f"no {what} for {1e-9 * (t_ns - stamp_ns):.0f} s"
        return ""


def body_velocity(air: AirVelocity, settings: AirspeedSettings) -> np.ndarray:
    """Air-relative velocity (3,) m/s in b: as measured with vanes, else true airspeed turned by the set incidence and slip."""
    tas = float(air.vel_b[0])
    out = np.array([tas, air.vel_b[1], air.vel_b[2]])
    incidence, slip = settings.incidence_deg * DEG, settings.slip_deg * DEG
    if air.cov_b[1, 1] >= UNKNOWN_VARIANCE:
        out[1] = tas * math.sin(slip)
        out[0] *= math.cos(slip)
    if air.cov_b[2, 2] >= UNKNOWN_VARIANCE:
        out[2] = out[0] * math.sin(incidence)
        out[0] *= math.cos(incidence)
    return out
