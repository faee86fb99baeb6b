"""The attitude filters of the source: gains that are constant, or scheduled in closed form, and known before the flight.

    euler            GPS attitude as Euler angles, bias gains scheduled on roll and pitch
    quaternion       GPS attitude as a small rotation, one pair of gains everywhere
    vector_matching  GPS velocity and magnetic field as vectors, Kalman gain (its Jacobian changes with every measurement)
    wahba            the same two vectors, solved for the attitude by iterated least squares first, which the filter then takes
    switched         accelerometers and magnetometer alone

Without its GPS each goes on as ``switched``: level and magnetic heading in steady flight, gyros alone in manoeuvres
(Gebre-Egziabher 2004, sections 4.11 and 4.12).  Mean and covariance are carried by the inertial core of all navigators, so the horizon,
the low-latency output and the sigmas mean the same as in the full filter; for ``euler`` the angles are formed where they are compared.
"""

from typing import Any, ClassVar

from lowcostnav_ros.aids._constant_gain import (
    ConstantHeadingAid,
    ConstantLevelAid,
    ConstantQuaternionAid,
    FieldMatchAid,
    ForceMatchAid,
    HeldFieldAid,
    ScheduledEulerAid,
    WahbaAid,
    tunings,
)
from lowcostnav_ros.aids._hard_iron import HardIronAid
from lowcostnav_ros.aids.gps import VelocityAid
from lowcostnav_ros.aids.gps_attitude import GpsAttitudeAid
from lowcostnav_ros.aids.level import SteadyFlightAid
from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.cores.imu_errors import typical
from lowcostnav_ros.estimation.aiding import Aid
from lowcostnav_ros.navigators.ahrs.filter import IMU, LEVEL_TIMEOUT_S, Filter
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.starts.attitude_core import hold_velocity

HELD_NS = 1_000_000_000
"""The velocity, which nothing here uses, is put back to zero this often."""


class SwitchedFilter(Filter):
    """Accelerometers and magnetometer in steady flight, gyros alone in manoeuvres."""

    unused: ClassVar[tuple[str, ...]] = ("airdata", "gps_attitude")

    def __init__(self, host: Navigator) -> None:
        super().__init__(host)
        self.level = host.aids_of(ConstantLevelAid)[0]
        self._levelling = host.channel_of(self.level)
        self._paced = [host.channel_of(aid) for aid in host.aids if isinstance(aid, ConstantLevelAid | ConstantQuaternionAid)]

    @classmethod
    def forms(cls, aid: Aid, settings: Any) -> list[Aid]:
        """Constant gains; GPS velocity serves the first attitude alone."""
        level = tunings(settings.constant_gain)[1]
        if isinstance(aid, MagneticAid):
            return [ConstantHeadingAid(aid.settings, aid.key, level)]
        if isinstance(aid, SteadyFlightAid):
            return [ConstantLevelAid(aid.settings, aid.key, level, settings.rate_switch)]
        return [] if isinstance(aid, VelocityAid | HardIronAid) else [aid]

    def begin(self, t_ns: int) -> None:
        """Count the periods from here."""
        self.level.switch.restart(t_ns)
        self._held_ns: int | None = None
        for channel in self._paced:
            channel.begin(t_ns)

    def follow(self, block: ImuBlock, start: int, stop: int) -> None:
        """Watch for manoeuvres."""
        core = self.host.core
        self.level.switch.follow(block, start, stop, core.C_nb(), core.errors()[1])

    def keep(self, now_ns: int) -> None:
        """Level on the grid of outputs; hold the velocity that nothing here uses at zero."""
        if self._held_ns is None or now_ns - self._held_ns >= HELD_NS:
            hold_velocity(self.host.core)
            self._held_ns = now_ns
        if self._levelling.due(now_ns):
            if not self.gps_good(now_ns):
                self.host.use_aid(self.level, Measurement(now_ns, IMU))
            self.level.switch.begin_span()

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """Magnetic heading in steady flight without GPS; the level has its time in :meth:`keep`."""
        if isinstance(aid, ConstantHeadingAid):
            return not self.gps_good(measurement.stamp_ns) and self.level.switch.is_steady
        return aid is not self.level

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether GPS attitude was accepted within the time-out."""
        return self.fresh("gps_attitude", stamp_ns)

    def held(self, heading: str) -> str:
        """How GPS holds the attitude, for people."""
        return "GPS attitude holds the attitude"

    def mode(self, now_ns: int, heading: str) -> tuple[str, str]:
        """By GPS, by steady flight, or neither."""
        if self.gps_good(now_ns):
            return Mode.CALIBRATING, self.held(heading)
        if self.fresh("level", now_ns, LEVEL_TIMEOUT_S):
            return Mode.COASTING, "levelled in steady flight" + heading
        return Mode.GYRO_ONLY, "manoeuvring: gyros alone since the last steady flight"


class QuaternionFilter(SwitchedFilter):
    """GPS attitude as a small rotation."""

    needs = ("level", "gps_attitude")
    unused = ("airdata",)
    attitude: ClassVar[type[ConstantQuaternionAid]] = ConstantQuaternionAid

    @classmethod
    def forms(cls, aid: Aid, settings: Any) -> list[Aid]:
        """GPS attitude with the gain made for it."""
        if isinstance(aid, GpsAttitudeAid):
            return [cls.attitude(aid.settings, aid.key, tunings(settings.constant_gain)[0])]
        return super().forms(aid, settings)


class EulerFilter(QuaternionFilter):
    """GPS attitude as Euler angles."""

    attitude = ScheduledEulerAid


class VectorMatchingFilter(SwitchedFilter):
    """GPS velocity and magnetic field as vectors."""

    needs = ("level", "gps")

    def __init__(self, host: Navigator) -> None:
        super().__init__(host)
        self._forces = host.aids_of(ForceMatchAid)

    @classmethod
    def forms(cls, aid: Aid, settings: Any) -> list[Aid]:
        """The field as a vector beside its heading, GPS velocity as a specific force."""
        made = super().forms(aid, settings)
        if isinstance(aid, MagneticAid):
            return [*made, FieldMatchAid(aid.settings, aid.key)]
        if isinstance(aid, VelocityAid):
            return [ForceMatchAid(aid.settings, aid.key, typical(settings.imu.accel_noise_mg_rthz))]
        return made

    def begin(self, t_ns: int) -> None:
        """Begin a span with the next velocity."""
        super().begin(t_ns)
        for force in self._forces:
            force.begin(None)

    def follow(self, block: ImuBlock, start: int, stop: int) -> None:
        """Sum the specific force of the span."""
        super().follow(block, start, stop)
        for force in self._forces:
            force.follow(block, start, stop)

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """The field as a vector while GPS velocity gives the other one."""
        if isinstance(aid, FieldMatchAid):
            return self.gps_good(measurement.stamp_ns)
        return super().applies(aid, measurement)

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether a GPS velocity was used within the time-out."""
        return self.fresh("gps", stamp_ns)

    def held(self, heading: str) -> str:
        """How GPS holds the attitude, for people."""
        return "GPS velocity shows the acceleration" + heading


class WahbaFilter(VectorMatchingFilter):
    """GPS velocity and magnetic field solved for the attitude together."""

    def __init__(self, host: Navigator) -> None:
        super().__init__(host)
        self._fields = host.aids_of(HeldFieldAid)
        for solver in host.aids_of(WahbaAid):
            solver.field = self._fields[0] if self._fields else None

    @classmethod
    def forms(cls, aid: Aid, settings: Any) -> list[Aid]:
        """The field held for the solution, the solution in place of the specific force."""
        made = super().forms(aid, settings)
        if isinstance(aid, MagneticAid):
            return [*made[:-1], HeldFieldAid(aid.settings, aid.key)]
        if isinstance(aid, VelocityAid):
            return [WahbaAid(aid.settings, aid.key, typical(settings.imu.accel_noise_mg_rthz))]
        return made

    def begin(self, t_ns: int) -> None:
        """Wait for a field seen from the new attitude."""
        super().begin(t_ns)
        for field in self._fields:
            field.held = None
