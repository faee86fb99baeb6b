"""The full attitude filter: the covariance of the whole error state is carried, and every aid is weighed by it.

Accelerometers show the vertical only once the acceleration is known.  It comes, in this order, from GPS velocity, from the velocity
through the air, or it is taken to be zero while a manoeuvre switch sees steady flight.  The error state is that of the inertial
core with gyro and accelerometer biases, a slow magnetic heading error, wind and flow angles; velocity is carried because it links
attitude to acceleration exactly.
"""

import numpy as np

from lowcostnav_ros.aids.airdata import AirDataAid
from lowcostnav_ros.aids.gps import VelocityAid
from lowcostnav_ros.aids.level import SteadyFlightAid
from lowcostnav_ros.base.measurements import AirVelocity, GpsVelocity, ImuBlock, Measurement
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.estimation.aiding import Aid
from lowcostnav_ros.navigators.ahrs.filter import IMU, LEVEL_TIMEOUT_S, Filter
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.starts.attitude_core import hold_velocity, restart_velocity, restart_velocity_from_air


class FullFilter(Filter):
    """Full covariance; see the module head."""

    is_full = True

    def __init__(self, host: Navigator) -> None:
        super().__init__(host)
        self.level = host.aids_of(SteadyFlightAid)[0]

    def begin(self, t_ns: int) -> None:
        """Begin with the velocity that was measured."""
        self.level.switch.restart(t_ns)
        self.level.since_ns = None

    def follow(self, block: ImuBlock, start: int, stop: int) -> None:
        """Low-pass the motion."""
        self.level.switch.follow(block, start, stop)

    def keep(self, now_ns: int) -> None:
        """Judge the motion; level by steady flight when nothing measures velocity."""
        core, level = self.host.core, self.level
        level.switch.decide(core.C_nb(), core.errors()[1])
        if self.gps_good(now_ns) or self.fresh("airdata", now_ns):
            level.since_ns = None
            return
        if level.since_ns is not None:
            if now_ns - level.since_ns < 1e9 * level.settings.period_s:
                return
            self.host.use_aid(level, Measurement(now_ns, IMU))
        hold_velocity(core)
        level.since_ns = now_ns

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """All but the level, which has its time in :meth:`keep`."""
        return aid is not self.level

    def before(self, aid: Aid, measurement: Measurement) -> None:
        """A velocity that was counted from zero is reset to a measured one."""
        if self.level.since_ns is None:
            return
        core, offsets = self.host.core, self.host.offsets
        if offsets is not None:
            offsets.restart()
        if isinstance(aid, VelocityAid) and isinstance(measurement, GpsVelocity):
            restart_velocity(core, measurement.vel_n, measurement.cov_n + np.eye(3) * aid.settings.velocity_floor_mps**2)
        elif isinstance(aid, AirDataAid) and isinstance(measurement, AirVelocity) and aid.fast_enough(measurement):
            restart_velocity_from_air(core, measurement, aid.wind_n(self.host), aid.doubt_mps(measurement))
        else:
            return
        self.level.since_ns = None

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether a GPS velocity was accepted within the time-out."""
        return self.fresh("gps", stamp_ns)

    def mode(self, now_ns: int, heading: str) -> tuple[str, str]:
        """By what shows the acceleration."""
        fresh = self.fresh
        if self.gps_good(now_ns):
            return Mode.CALIBRATING, "GPS velocity gives the acceleration" + heading
        if fresh("gps_attitude", now_ns):
            return Mode.CALIBRATING, "no GPS velocity, GPS attitude holds the attitude"
        if fresh("airdata", now_ns):
            return Mode.COASTING, "no GPS velocity, airspeed gives the acceleration" + heading
        if fresh("level", now_ns, LEVEL_TIMEOUT_S):
            return Mode.COASTING, "no GPS velocity or airspeed, levelled in steady flight" + heading
        if not heading:
            return Mode.COASTING, "magnetic heading only: roll and pitch run on the gyros while manoeuvring"
        return Mode.GYRO_ONLY, "manoeuvring without GPS velocity, airspeed and magnetic heading"
