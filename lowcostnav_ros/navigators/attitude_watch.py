"""What GPS does to attitude and heading, watched for an inertial sensor that is wrong: what no gate sees (integrity page)."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.aids.airdata import AirDataAid
from lowcostnav_ros.aids.gps import VelocityAid
from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import GpsVelocity, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, VEL
from lowcostnav_ros.estimation.aiding import Aid, Decision, reset_to
from lowcostnav_ros.estimation.cross_checks.flow import FlowWatch
from lowcostnav_ros.estimation.cross_checks.heading import SLOWEST_MPS, MountingCheck, OwnHeadingCheck, crabs, heading_of
from lowcostnav_ros.estimation.one_way import OneWay
from lowcostnav_ros.navigators.silent_axes import RATE
from lowcostnav_ros.navigators.trust import COVERED
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat, wrap

DOWN, VAGUE_HEADING, STEEPEST = slice(8, 9), 30.0 * DEGREE, 0.9
"""Row of the heading; a sigma of it beyond which the track knows it better; sine of the pitch beyond which there is no heading."""
RECENT_NS = 3_000_000_000
"""A magnetic heading this recent says where the nose is."""
MEMORY_S = 60.0
"""For so long is not forgotten what a compass showed that has been calibrated anew since."""
AGREES_S = 5.0
"""A nose that points along the way again, and GPS to show it, are believed after so long."""
BEFORE = 2.0
"""What led wind and heading one way has led them as far before it stood out."""
TURNS_S, WRONG, MOST = 10.0, 0.5, 60.0 * DEGREE
"""A unit that is known to be wrong is so by this share of what it has turned lately, or since GPS was lost, up to so much."""


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
    led_m : float
        How far what moved wind and heading may have led the place away since GPS last held it, m.
    """

    def __init__(self, navigator: Any) -> None:
        self.navigator = navigator
        velocity = next((aid.source for aid in navigator.aids_of(VelocityAid)), navigator.fix_word)
        self.one_way, self.turned = OneWay(navigator.layout, navigator.inertial, velocity), OwnHeadingCheck(navigator.inertial)
        self.mounted = MountingCheck(navigator.inertial)
        self._compass = next(iter(navigator.aids_of(MagneticAid)), None)
        others: list[Aid] = [*navigator.aids_of(MagneticAid), *navigator.aids_of(AirDataAid)]
        self._others = {aid: OneWay(navigator.layout, navigator.inertial, aid.source, with_wind=True) for aid in others}
        self._moved = np.zeros(navigator.layout.size)
        self._shown, self._seen_ns, self._turned = 0.0, 0, 0.0
        self._q_nb: np.ndarray | None = None
        self.flow, self._astray, self.led_m = FlowWatch(), np.zeros(3), 0.0

    @property
    def held(self) -> tuple[Contradiction | None, ...]:
        """Its contradictions, while they last."""
        return self.one_way.held, self.turned.held, self.mounted.held

    def clear(self) -> None:
        """Forget all."""
        self.one_way.clear()
        for other in self._others.values():
            other.clear()
        self.turned.clear()
        self.mounted.clear()
        self._shown, self._turned, self._q_nb = 0.0, 0.0, None
        self.flow.clear()
        self._astray, self.led_m = np.zeros(3), 0.0

    def begin_anew(self) -> None:
        """Forget what is of an attitude that was lost."""
        self.one_way.clear()
        self.flow.clear()

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
        heading = max(heading, self._remembered(compass, heading, now_ns))
        if strength is not None and strength.unresolved is not None and now_ns - strength.unresolved[0] <= RECENT_NS:
            seen, y = strength.status.observation, strength.unresolved[1]
            if seen is not None and not self.navigator.gps_good(now_ns):
                off = math.hypot(*y)
                tilt, heading = off / max(math.hypot(*seen), off), max(heading, off / max(abs(float(seen[0])), off))
        return tilt, heading

    def _remembered(self, compass: MagneticAid, heading: float, now_ns: int) -> float:
        """What the compass showed before it was calibrated anew: it has followed the gyros since."""
        if heading > 0.0:
            self._shown, self._seen_ns = heading, now_ns
        forgotten_ns = compass.calibration.forgotten_ns
        if forgotten_ns is None or forgotten_ns < self._seen_ns:
            return heading
        return self._shown * math.exp(-1e-9 * (now_ns - self._seen_ns) / MEMORY_S)

    def moved(self) -> np.ndarray:
        """By how much tilt, heading and wind (3,) may be off, rad and m/s: by what moved them lately, and turns of a unit that is wrong."""
        squares = self.one_way.moved**2 + sum(other.moved**2 for other in self._others.values())
        squares[:2] += self._turned**2
        squares += self._astray**2
        return np.sqrt(squares)

    def is_quiet(self, *, held: bool) -> bool:
        """Whether a look before ``flow.due_ns`` changes nothing, as long as nothing is measured."""
        is_still = self._q_nb is None and self.led_m == 0.0 and not self.flow.off.any() and not self._astray.any() and not self._turned
        return is_still and (held or not self.moved().any())

    def slip_mps(self, moved: np.ndarray) -> float:
        """By how much a velocity that air and compass hold is off, m/s, where wind and heading are by ``moved`` (3,)."""
        return BEFORE * math.hypot(float(moved[2]), self.navigator.core.speed_mps * float(moved[1]))

    def look(self, dt_s: float, *, held: bool, is_wrong: bool, blind_s: float = 0.0) -> None:
        """Note whether it flies where it points, how far it slips and how the unit turns, at every output.

        ``held``: GPS holds the solution; ``is_wrong``: the unit contradicts its settings; ``blind_s``: since when no
        gyro has said anything, s.
        """
        core = self.navigator.core
        if core.t_ns >= self.flow.due_ns:
            self.flow.take(core.t_ns, core.C_nb(), core.nav[VEL], self.navigator.P[VEL.start : ATT.stop, VEL.start : ATT.stop])
        crab, before = float(COVERED * self.flow.off[0]), self._astray * (math.exp(-dt_s / AGREES_S) if held else 1.0)
        either = 0.0  # GPS shows an incidence as a velocity
        if not held:
            either = max(COVERED * math.hypot(*self.flow.off), min(COVERED * RATE * blind_s, MOST))
        self._astray = np.maximum(before, [either, max(crab, either), core.speed_mps * either])
        is_wrong = is_wrong or (not held and bool(self._astray.any()))
        moved = self.moved()
        self.led_m = 0.0 if held else self.led_m + self.slip_mps(moved) * dt_s if moved.any() else self.led_m
        if not is_wrong:
            self._turned, self._q_nb = 0.0, None
            return
        q_nb, old = core.nav[6:10].copy(), self._q_nb
        by = 0.0 if old is None else float(np.linalg.norm(rotvec_from_quat(quat_multiply(q_nb, quat_conjugate(old)))))
        self._turned, self._q_nb = min(self._turned * (math.exp(-dt_s / TURNS_S) if held else 1.0) + WRONG * by, MOST), q_nb

    def before(self, aid: Aid) -> bool:
        """Look at what an aid is about to change; return whether it is to be judged once it has been used."""
        is_gps = aid.is_fix or aid.measures_velocity
        one_way = self.one_way if is_gps else self._others.get(aid)
        if one_way is None:
            return False
        self._moved[:] = 0.0
        one_way.before(self.navigator.P, self.navigator.offsets)
        return True

    def after(self, aid: Aid, measurement: Measurement, *, used: bool) -> None:
        """Judge what came of a measurement: attitude and sensors are less well known where GPS moves the attitude one way for long."""
        navigator = self.navigator
        if aid in self._others:
            if used and aid.decision is Decision.FUSE:
                self._others[aid].follow(measurement.stamp_ns, self._moved, navigator.P, navigator.offsets)
            return
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
            self._shown = 0.0
            self.flow.clear()
            reset_to(navigator, DOWN, np.array([wrap(track - heading)]), np.array([[sigma**2]]))
        if apart is not None:
            navigator.widen(navigator.turned(stamp_ns, abs(apart)))
