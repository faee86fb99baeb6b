"""What GPS does to attitude and heading, watched for an inertial sensor that lies: what no gate sees (integrity page)."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.aids.gps import VelocityAid
from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import GpsVelocity, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import VEL
from lowcostnav_ros.estimation.aiding import Aid, Decision, reset_to
from lowcostnav_ros.estimation.cross_checks.heading import SLOWEST_MPS, MountingCheck, OwnHeadingCheck, crabs, heading_of
from lowcostnav_ros.estimation.one_way import OneWay
from lowcostnav_ros.physics.rotation import wrap

DOWN, VAGUE_HEADING, STEEPEST = slice(8, 9), 30.0 * DEGREE, 0.9
"""Row of the heading; a sigma of it beyond which the track knows it better; sine of the pitch beyond which there is no heading."""
RECENT_NS = 3_000_000_000
"""A magnetic heading this recent says where the nose is."""


class AttitudeWatch:
    """Watch a navigator that the IMU carries.

    Parameters
    ----------
    navigator : InertialNavigator or Ahrs
        With its aids, layout and core; it says what becomes of an attitude that GPS corrects one way (``led_one_way``) or whose heading was
        turned (``turned``), and whether it tries several headings (``tries_headings``, ``tries_any_heading``).

    Attributes
    ----------
    one_way : OneWay
    turned : OwnHeadingCheck
    mounted : MountingCheck
    """

    def __init__(self, navigator: Any) -> None:
        self.navigator = navigator
        velocity = next((aid.source for aid in navigator.aids_of(VelocityAid)), navigator.fix_word)
        self.one_way, self.turned = OneWay(navigator.layout, navigator.inertial, velocity), OwnHeadingCheck(navigator.inertial)
        self.mounted = MountingCheck(navigator.inertial)
        self._compass = next(iter(navigator.aids_of(MagneticAid)), None)
        self._moved = np.zeros(navigator.layout.size)

    @property
    def held(self) -> tuple[Contradiction | None, ...]:
        """Its contradictions, while they last."""
        return self.one_way.held, self.turned.held, self.mounted.held

    def clear(self) -> None:
        """Forget all."""
        self.one_way.clear()
        self.turned.clear()
        self.mounted.clear()

    def note(self, dx: np.ndarray) -> None:
        """Note a correction (n,) that is injected."""
        self._moved += dx

    def apart(self, now_ns: int) -> tuple[float, float]:
        """By how much, rad, the field contradicts tilt and heading while it is not used; 0 where it is, or is known to be wrong.

        A field that is not the earth's may be interference, or that of an attitude that is lost: where GPS does not show the attitude
        nobody knows.
        """
        compass = self._compass
        if compass is None or compass.turned.held is not None:
            return 0.0, 0.0
        tilt, heading, strength = 0.0, 0.0, compass.strength
        if compass.unresolved is not None and now_ns - compass.unresolved[0] <= RECENT_NS:
            heading = abs(float(compass.unresolved[1][0]))
        if strength is not None and strength.unresolved is not None and now_ns - strength.unresolved[0] <= RECENT_NS:
            seen, y = strength.status.observation, strength.unresolved[1]
            if seen is not None and not self.navigator.gps_good(now_ns):
                off = math.hypot(*y)
                tilt, heading = off / max(math.hypot(*seen), off), max(heading, off / max(abs(float(seen[0])), off))
        return tilt, heading

    def before(self, aid: Aid) -> bool:
        """Look at what an aid is about to change; return whether it is to be judged once it has been used: that of GPS is."""
        if not aid.is_fix and not aid.measures_velocity:
            return False
        self._moved[:] = 0.0
        self.one_way.before(self.navigator.P, self.navigator.offsets)
        return True

    def after(self, aid: Aid, measurement: Measurement, *, used: bool) -> None:
        """Judge what came of a measurement: attitude and sensors are less well known where GPS moves the attitude one way for long."""
        navigator = self.navigator
        if used and aid.decision is Decision.FUSE:
            named = self.one_way.held is not None
            least = self.one_way.take(measurement.stamp_ns, self._moved, navigator.P, navigator.offsets)
            if least is not None:
                navigator.widen(least)
            if self.one_way.held is not None and not named:
                navigator.led_one_way(measurement.stamp_ns)
        if navigator.tries_any_heading or not aid.measures_velocity:
            return  # with any heading at the start the track says nothing of it
        north, east, _ = measurement.vel_n if isinstance(measurement, GpsVelocity) else navigator.core.nav[VEL]  # as the satellites have it
        seen = used or (isinstance(measurement, GpsVelocity) and self._compass_agrees(measurement.stamp_ns, north, east))
        if seen and not navigator.excluded(aid):
            self._head_by_track(measurement.stamp_ns, north, east)

    def _compass_agrees(self, stamp_ns: int, north: float, east: float) -> bool:
        """Whether the magnetic heading, too, is such that wind explains the track of a velocity that is refused."""
        seen = None if self._compass is None else self._compass.status
        if seen is None or seen.observation is None or stamp_ns - seen.stamp_ns > RECENT_NS:
            return False
        return crabs(heading_of(self.navigator.core.C_nb()) + float(seen.observation[0]), north, east) is None

    def _head_by_track(self, stamp_ns: int, north: float, east: float) -> None:
        """Take the heading from the track where no wind explains how far they are apart, or where it is hardly known."""
        navigator = self.navigator
        C, variance = navigator.core.C_nb(), navigator.P[8, 8]
        if abs(C[2, 0]) > STEEPEST:
            return
        self.mounted.compare(stamp_ns, heading_of(C), math.sqrt(variance), north, east)
        if math.hypot(north, east) < SLOWEST_MPS:
            return
        track, sigma = math.atan2(east, north), navigator.settings.alignment.track_sigma_deg * DEGREE
        heading = heading_of(C)
        apart = self.turned.compare(stamp_ns, heading, math.sqrt(variance), north, east)
        is_vague = not navigator.tries_headings and variance > max(VAGUE_HEADING, 2.0 * sigma) ** 2
        if apart is not None or is_vague:
            reset_to(navigator, DOWN, np.array([wrap(track - heading)]), np.array([[sigma**2]]))
        if apart is not None:
            navigator.widen(navigator.turned(stamp_ns, abs(apart)))
