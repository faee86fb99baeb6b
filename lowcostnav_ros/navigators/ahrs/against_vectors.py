"""An attitude against the vectors that show it: what is published while gyros contradict compass, airspeed or GPS velocity.

Gyros that are wrong carry the attitude away, and the gates then refuse the witnesses one after the other, or let them be followed by what
is calibrated beside them.  So what a refused witness has shown the attitude to be off by is kept, goes on as it went, and is published:

    compass           heading off by y, and by dy/dt more each second; without GPS the gyros or the field are wrong, half covers both
    velocity          off by y after T: an acceleration y / T, of gravity; along the flight it may be the airspeed, across it is the tilt
    heading turning   at a rate r that the compass does not see tilts by V r / g what airspeed holds level in turns
    air data          corrects the tilt one way without GPS (:mod:`.one_way`): an accelerometer is wrong, the tilt has followed it
    compass           is followed one way, by heading and slow error together: half covers both, gyros that drift and a compass

Of the compass y of variance S, R of it noise, is followed by c = sum (1 - R / S) y of variance sum (S - R)^2 / S.

Once GPS velocity is used again, all this is given to the covariance, so that it teaches attitude and gyro biases.
"""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.aids._hard_iron import INTERFERENCE, UT
from lowcostnav_ros.aids.airdata import AirDataAid
from lowcostnav_ros.aids.gps import VelocityAid
from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import MagneticField, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.held import ANY_WAY
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.navigators.against_air import SLOWEST_MPS, strays
from lowcostnav_ros.navigators.attitude_watch import DOWN
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import wrap

LASTING_NS = 1_000_000_000
"""What is refused for so long is no gust and no iron passed by."""
AGREED_NS = 5_000_000_000
"""A witness that is used again for so long agrees: a tilt would have shown in a velocity, a rate in a heading."""
UNNOTICED_S = 1.0
"""An error works so long before it shows."""
SILENT_NS = 10_000_000_000
"""A velocity of GPS after so long shows the heading, too: by it the velocity was carried."""
COVERED = math.sqrt(0.5)
"""Sigma of a heading as a share of what compass and gyros are apart: one as likely wrong as the other."""
NOISE = 2.0 * DEGREE
"""Of a magnetic heading: what changes by less is no rate."""
STRENGTH = 0.1
"""A field is the earth's whose strength is within this share of the model's; a tilt that is off changes the direction alone."""
STRANGE = 3.0
"""Sigmas of its setting that a slow error of the compass does not reach."""
FOLLOWED_S, FOLLOWED_SIGMAS, FOLLOWED_CALM = 30.0, 3.0, 1.5 * DEGREE
"""The compass is followed over so long; one way beyond so many sigmas, of which iron and the scale of the gyros make as much in turns."""
SEEN = (0.5 * DEGREE, 5.0 * DEGREE)
"""Rate, rad/s, and tilt, rad, of the attitude against two witnesses beyond which it is the gyros that are wrong."""


class Refused:
    """A witness that is refused: since when, until when it was used before, and when it was used again first."""

    def __init__(self) -> None:
        self.since_ns: int | None = None
        self.used_ns: int | None = None
        self._again_ns: int | None = None

    def take(self, stamp_ns: int, *, refused: bool) -> bool:
        """Take what became of a measurement; return whether the witness agrees again for good."""
        if refused:
            self.since_ns, self._again_ns = stamp_ns if self.since_ns is None else self.since_ns, None
            return False
        self.used_ns = stamp_ns
        if self.since_ns is None:
            return False
        self._again_ns = stamp_ns if self._again_ns is None else self._again_ns
        if stamp_ns - self._again_ns < AGREED_NS:
            return False
        self.since_ns = None
        return True

    def lasts(self, stamp_ns: int) -> bool:
        """Whether it has been refused for longer than a moment."""
        return self.since_ns is not None and self._again_ns is None and stamp_ns - self.since_ns >= LASTING_NS

    def lasted_s(self, stamp_ns: int) -> float:
        """Since when the error may have worked, s."""
        before_ns = self.since_ns if self.used_ns is None else self.used_ns
        return UNNOTICED_S + (0.0 if before_ns is None else 1e-9 * max(stamp_ns - before_ns, 0))


class AgainstVectors:
    """What refused witnesses have shown an attitude to be off by.

    Parameters
    ----------
    host : Navigator
        An attitude reference with its core.
    """

    def __init__(self, host: Any) -> None:
        self.host = host
        self._latch = Latch("gyros disagree with compass and velocity", (host.inertial, "compass and velocity"), "deg", begin_s=2.0)
        self.clear()

    def clear(self) -> None:
        """Forget all: the attitude begins anew."""
        self._latch.clear()
        self._compass, self._velocities = Refused(), dict[str, Refused]()
        self._heading = self._turning = self._tilt = self._first = 0.0
        self._seen_ns = self._agreeing_ns = 0
        self._drift = self._sum = self._variance = 0.0
        self._sum_ns = 0
        self._followed = False  # what the compass says now says nothing of what it contradicted

    @property
    def held(self) -> Contradiction | None:
        """The contradiction of the gyros with two witnesses, while it lasts."""
        return self._latch.held

    def take(self, aid: Aid, measurement: Measurement) -> None:
        """Take what became of a measurement."""
        status = aid.status
        if self.host.excluded(aid):
            return
        if aid.decision is Decision.FUSE and not self.host.gps_good(measurement.stamp_ns):
            self._keep()
        if isinstance(aid, MagneticAid) and isinstance(measurement, MagneticField):
            self._take_field(aid, measurement)
        elif isinstance(aid, VelocityAid | AirDataAid) and aid.decision is not None and status.innovation is not None:
            self._take_velocity(aid, status.stamp_ns, status.innovation, status.innovation_covariance)
        else:
            return
        rate, tilt = SEEN
        both = self._heading > 0.0 and self._turning > rate and self._tilt > tilt
        if both or self._latch.held is not None:
            self._latch.judge(status.stamp_ns, both, max(self.heading(status.stamp_ns), self._tilt) / DEGREE, self.host.inertial)

    def _keep(self) -> None:
        """Keep what tilt and heading were moved by without GPS: an error that is there to stay moves nothing any more."""
        watch = self.host.attitude_watch
        if watch is not None:
            tilt, heading, _ = watch.moved().tolist()
            self._tilt, self._drift = max(self._tilt, tilt), max(self._drift, heading / COVERED)

    def _follow_compass(self, aid: MagneticAid) -> None:
        """Doubt a heading while what was followed of the compass goes one way; without GPS for good."""
        y, S, stamp_ns = aid.status.innovation, aid.status.innovation_variance, aid.status.stamp_ns
        if y is None or S is None or aid.applied is None:
            return
        dt_s, self._sum_ns = 1e-9 * (stamp_ns - self._sum_ns), stamp_ns
        keep, known = math.exp(-dt_s / FOLLOWED_S), max(1.0 - float(aid.applied.R[0, 0]) / float(S[0]), 0.0)
        self._sum, self._variance = keep * self._sum + known * float(y[0]), keep**2 * self._variance + known**2 * float(S[0])
        far = abs(self._sum) > FOLLOWED_SIGMAS * math.hypot(math.sqrt(self._variance), FOLLOWED_CALM)
        drift = abs(self._sum) if far else 0.0
        self._drift = drift if self.host.gps_good(stamp_ns) else max(drift, self._drift)

    def _take_field(self, aid: MagneticAid, measurement: MagneticField) -> None:
        """Take a field; one as strong as the earth's in another direction speaks against the attitude, though no heading is taken of it."""
        y, stamp_ns, refused = aid.status.innovation, measurement.stamp_ns, aid.decision in (Decision.REJECT, Decision.RECOVER)
        if aid.decision is Decision.FUSE:
            self._follow_compass(aid)
        if aid.decision is not None and y is not None:
            own, sigma = self._slow_error(aid)
            strange = abs(own) > STRANGE * sigma  # it has followed the gyros
            self._take_heading(aid, stamp_ns, abs(float(y[0]) + (own if strange else 0.0)), refused=refused or strange)
        elif aid.status.reason == INTERFERENCE:
            off = self._direction(aid, measurement)
            if off is not None:
                self._take_heading(aid, stamp_ns, abs(off[0]), refused=True)
                if self._compass.lasts(stamp_ns) and self._heading > 0.0:
                    self._tilt = max(self._tilt, abs(off[1]))

    def _slow_error(self, aid: MagneticAid) -> tuple[float, float]:
        """The slow error that the compass is believed to have, and the sigma of its setting, rad."""
        row = self.host.layout.get(aid.own("heading_bias"))
        return (0.0, 1.0) if row is None else (float(self.host.core.estimate[row.start]), aid.settings.bias_deg * DEGREE)

    def _direction(self, aid: MagneticAid, measurement: MagneticField) -> tuple[float, float] | None:
        """By what a field is off the model's in heading and in dip, rad; None where it is another field, or there is no model."""
        model = aid.reference.field_n(*self.host.core.nav[:3].tolist())
        if model is None:
            return None
        seen_ut = self.host.core.C_nb() @ aid.calibration.field_ut(measurement.field_b, self.host)
        if abs(float(np.linalg.norm(seen_ut)) / (UT * float(np.linalg.norm(model))) - 1.0) > STRENGTH:
            return None
        (north, east, down), (to_north, to_east, to_down) = seen_ut.tolist(), model.tolist()
        dip = math.atan2(down, math.hypot(north, east)) - math.atan2(to_down, math.hypot(to_north, to_east))
        return wrap(math.atan2(east, north) - math.atan2(to_east, to_north)), dip

    def _take_heading(self, aid: MagneticAid, stamp_ns: int, off: float, *, refused: bool) -> None:
        if self._is_shown_wrong(aid, stamp_ns):
            if not self._followed:
                self._heading = self._turning = 0.0
            return
        if refused and self._compass.since_ns is None:
            self._first = off
        agrees, since_ns = self._compass.take(stamp_ns, refused=refused), self._compass.since_ns
        if since_ns is not None:
            begun_ns = aid.calibration.forgotten_ns
            self._followed |= aid.decision is Decision.RECOVER or (begun_ns is not None and begun_ns >= since_ns)
        if agrees and not self._followed:
            self._heading = self._turning = 0.0
        elif refused and since_ns is not None and not (self._followed and off < self.heading(stamp_ns)):
            self._heading, self._seen_ns = max(self._heading, off), stamp_ns
            if stamp_ns - since_ns >= LASTING_NS:
                self._turning = max(self._turning, (off - self._first - NOISE) / (1e-9 * (stamp_ns - since_ns)))

    def _is_shown_wrong(self, aid: MagneticAid, stamp_ns: int) -> bool:
        """Whether it is the compass that is wrong: GPS shows the heading, and contradicts the attitude in nothing."""
        against = aid.turned.held is not None or aid.against_motion.held is not None
        return against and self.host.gps_good(stamp_ns) and self._tilt == 0.0 and not self.host.trust.suspects_gps

    def _take_velocity(self, aid: Aid, stamp_ns: int, y: np.ndarray, S: np.ndarray | None) -> None:
        is_gps, refused = isinstance(aid, VelocityAid), aid.decision in (Decision.REJECT, Decision.RECOVER)
        if not is_gps and refused and (S is None or not strays(y, S)):
            return  # along the flight the airspeed may be wrong
        seen = self._velocities.setdefault(aid.source, Refused())
        gap_s = seen.lasted_s(stamp_ns)
        agrees = seen.take(stamp_ns, refused=refused)
        if seen.lasts(stamp_ns):
            off = float(np.linalg.norm(y if is_gps else y[1:]))
            self._tilt = max(self._tilt, off / (gap_s * STANDARD_GRAVITY))
            if is_gps and gap_s > 1e-9 * SILENT_NS:
                self._heading, self._seen_ns = max(self._heading, off / max(self.host.core.speed_mps, SLOWEST_MPS)), stamp_ns
                self._followed = True
        if is_gps:
            self._give(stamp_ns, used=not refused, fused=aid.decision is Decision.FUSE)
        if agrees and (is_gps or self._heading == 0.0):
            self._tilt = 0.0

    def _give(self, stamp_ns: int, *, used: bool, fused: bool) -> None:
        """Give what is doubted to the covariance once GPS is there to teach what is right: tilt and rates at once, then the heading.

        While the tilt is wrong GPS shows a wrong heading, and what the compass was calibrated by was wrong.
        """
        host = self.host
        self._agreeing_ns = (self._agreeing_ns or stamp_ns) if fused else 0
        if used and self._tilt > 0.0:
            least = np.zeros(host.layout.size)
            least[host.core.attitude_rows] = [*self.sigmas(stamp_ns)[:2], 0.0]
            least[host.layout["gyro_bias"]] = self._turning
            host.widen(least)
            self._tilt = 0.0
        if self._agreeing_ns and stamp_ns - self._agreeing_ns >= AGREED_NS and self._heading > 0.0 and self._followed:
            kalman.reset_block(host.P, DOWN, np.array([[self.sigmas(stamp_ns)[2] ** 2]]), host.core.history)
            for compass in host.aids_of(MagneticAid):
                compass.calibration.forget(stamp_ns, host)
            self._heading = self._turning = 0.0
            self._followed, self._compass = False, Refused()

    def heading(self, t_ns: int) -> float:
        """By how much the heading is off at a time as it goes on, rad."""
        return 0.0 if self._heading == 0.0 else self._heading + self._turning * (UNNOTICED_S + 1e-9 * max(t_ns - self._seen_ns, 0))

    def sigmas(self, t_ns: int) -> np.ndarray:
        """What is added to the sigmas (3,) of the attitude, NED, rad."""
        swing = max(self.host.core.speed_mps, SLOWEST_MPS) * self._turning / STANDARD_GRAVITY
        tilt, heading = min(math.hypot(self._tilt, COVERED * swing), ANY_WAY), min(COVERED * max(self.heading(t_ns), self._drift), ANY_WAY)
        return np.array([tilt, tilt, math.hypot(heading, 0.5 * tilt)])
