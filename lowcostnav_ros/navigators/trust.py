"""What a navigator believes: which of its sources contradict each other or its own prediction, and what that adds to its covariance.

Where nobody can tell who is wrong the published covariance covers both.  A recovery to GPS resolves nothing by itself: a slow spoofer is
followed in the end.  So a :class:`~.witness.Witness` from before the suspicion is flown on, and what it and the navigator are apart stays
in the covariance until GPS comes back to the witness (then the navigator does, too), a fault of the inertial sensors is found to explain
it, or :data:`LASTS_NS` have passed.
"""

from itertools import chain
from typing import Any

import numpy as np

from lowcostnav_ros.aids.gps import ReceiverAid, VelocityAid
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import GpsPosition, Measurement
from lowcostnav_ros.cores.views import Motion
from lowcostnav_ros.estimation.aiding import BACK, Aid
from lowcostnav_ros.estimation.cross_checks.receiver import DISAGREE, FROZEN, ReceiverCheck
from lowcostnav_ros.estimation.cross_checks.sources import SourceChecks
from lowcostnav_ros.navigators.witness import Witness
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat

FIX, AIR, STATIC, EPOCHS = "gps/fix", "air/velocity", "air/static_pressure", "gnss/raw"
COVERED = 0.5
"""Sigma of a solution that GPS contradicts, as a share of what the two are apart: whichever is right is within two sigmas."""
ACROSS = 0.5
LAG_S, LONGEST_S = 1.0, 60.0
"""A velocity that is off has been so, unnoticed, for a while, and moves the position for as long as nothing else does, within reason."""
DISAGREES_NS = 3_000_000_000
GPS_DISAGREES, LED_AWAY = "GPS and prediction disagree", "GPS has led the solution away from its prediction"
SETTLED_NS = 30_000_000_000
"""A state that has agreed with GPS for so long is worth being a witness."""
PENDING_NS = 30_000_000_000
"""Copies are kept so long while GPS is refused and it is known why."""
SLOW_NS = 6_000_000_000
"""What shows in innovations over some seconds began so long before."""
FAR = 1.6
"""Size of watched innovations that is no chance: that of one in a hundred thousand sound ones."""
APART = 25.0
"""Squared distance of witness and solution over both covariances, of position or velocity, above which they disagree."""
LOOKS_NS, LASTS_NS, RETURNS_NS = 20_000_000_000, 120_000_000_000, 2_000_000_000
"""A witness that agrees is heard so long; one that does not, so long after the last suspicion; GPS is back after so long."""
BEYOND_SPOOFING_MPS = 50.0
"""Nobody is led away at such a speed unnoticed: a prediction that is off by so much is a fault of what it is made of."""
NEARER = 0.6
"""GPS that is so much nearer to the witness than the state is is back."""
ROWS, FLOORS = {"m": slice(0, 3), "m/s": slice(3, 6)}, {"m": 3.0, "m/s": 0.3}
"""Rows of a motion; and sigma of fixes and velocities as far as the witness is concerned."""


class Trust:
    """Cross-checks of one navigator's sources, its doubts of GPS, and the witness.

    Parameters
    ----------
    host : Navigator
        Of no stated type: its module imports this one.

    Attributes
    ----------
    receivers : dict of Aid to ReceiverCheck
        The check of each aid that a GPS receiver feeds.
    checks : SourceChecks
        Of its sources among each other.
    of_receivers : frozenset of str
        Sources that a check of a receiver takes.
    witness : Witness
    led_away : Contradiction or None
        Of the solution with the witness.
    told : bool
        Whether a navigator that can tell better says that GPS leads away.
    away : (int, ndarray (3,), ndarray (3,)) or None
        Stamp, position and velocity of satellites that agree among themselves less those of the state, m and m/s NED.
    """

    def __init__(self, host: Any) -> None:
        self.host = host
        self.receivers: dict[Aid, ReceiverCheck] = {}
        self._latches = [latch for aid in host.aids for latch in aid.latches]
        self._watched = [aid for aid in host.aids if isinstance(aid, ReceiverAid)]
        for velocity in host.aids_of(VelocityAid):
            fix = next((aid for aid in host.aids if aid.measurement is GpsPosition and aid.key == velocity.key), None)
            source = FIX if fix is None and FIX in host.inputs else fix.source if fix is not None else ""
            if source:
                check = ReceiverCheck(source, velocity.source, velocity.settings.memory_s)
                self.receivers |= {aid: check for aid in (velocity, fix) if aid is not None}
        topics = (topic if topic in host.inputs else "" for topic in (AIR, STATIC, EPOCHS))
        self.checks = SourceChecks(list(dict.fromkeys(self.receivers.values())), *topics)
        self.of_receivers = frozenset(source for check in self.checks.receivers for source in check.sources)
        self.witness, self.told = Witness(host.output_period_ns), False
        self.forget_state()

    def clear(self) -> None:
        """Forget what was received."""
        self.checks.clear()
        self.forget_state()

    def forget_state(self) -> None:
        """Forget the witness: the state begins anew from what is measured."""
        self.witness.clear()
        self.away: tuple[int, np.ndarray, np.ndarray] | None = None
        self.led_away: Contradiction | None = None
        self._good_since_ns: int | None = None
        self._good_ns = self._heard_ns = self._recoveries = 0
        self._back_since_ns: int | None = None
        self._unit, self._largest, self._far = "m", 0.0, FAR
        self._apart, self._added = np.zeros(9), np.zeros((9, 9))

    def take(self, item: Measurement) -> str:
        """Check a measurement against the other sources; return why it is none.

        A velocity that contradicts the fixes and never agreed with them has spoilt what was begun with it.
        """
        if item.source not in self.of_receivers:
            return self.checks.take(item, self.agreement)
        before = [check.disagreement.held for check in self.checks.receivers]
        refusal = self.checks.take(item, self.agreement)
        for check, held in zip(self.checks.receivers, before, strict=True):
            if held is None and check.never_agreed:
                self.host.realign("begun with a velocity that contradicts the fixes")
        return refusal

    def excludes(self, item: Measurement) -> str:
        """Why a measurement of GPS is not to be begun with."""
        reasons = (check.excluded(type(item)) for check in self.checks.receivers if item.source in check.sources)
        return next(filter(None, reasons), "")

    # of one source -----------------------------------------------------------------------------------------------------------

    def excluded(self, aid: Aid) -> str:
        """Why what an aid measures contradicts other sources and is not to be used; empty for nothing."""
        receiver = self.receivers.get(aid)
        return "" if receiver is None else receiver.excluded(aid.measurement)

    def agrees_again(self, aid: Aid) -> None:
        """Believe an excluded receiver again: it has strayed and come back to the prediction."""
        receiver = self.receivers.get(aid)
        if receiver is not None:
            receiver.forget()

    def noise_factor(self, aid: Aid) -> float:
        """By what the stated variance of an aid's measurements is to be multiplied: they scatter more than they state."""
        receiver = self.receivers.get(aid)
        return 1.0 if receiver is None else receiver.scatter.noise_factor

    def is_frozen(self, aid: Aid) -> str:
        """Why what contradicts the prediction is no measurement: it repeats old values; empty for nothing."""
        receiver = self.receivers.get(aid)
        return FROZEN if receiver is not None and receiver.contradicted(aid.measurement) else ""

    def agreement(self) -> dict[type, bool]:
        """Whether the state agrees with GPS position and velocity, where it has been compared."""
        return {aid.measurement: aid.status.test_ratio <= 1.0 for aid in self.receivers if aid.status.innovation is not None}

    # contradictions ----------------------------------------------------------------------------------------------------------

    def contradictions(self) -> tuple[Contradiction, ...]:
        """What contradicts what, for longer than a moment."""
        latched = [latch.held for latch in self._latches if latch.held is not None]
        own = latched if self.led_away is None else [*latched, self.led_away]
        clocks, checked, unresolved = self.host.horizon.clocks.contradictions(), self.checks.held(), self._unresolved()
        return (*clocks, *checked, *unresolved, *own) if checked or unresolved or own else clocks  # nearly always nothing

    def _is_contradicted(self) -> bool:
        """Whether what a receiver said last contradicted the state."""
        return any(aid.unresolved is not None for aid in self.receivers)

    def _unresolved(self) -> list[Contradiction]:
        """GPS that the state contradicts, and no check can tell which of them is wrong."""
        found: list[Contradiction] = []
        if not self._is_contradicted():
            return found
        for aid in self.receivers:
            since_ns = aid.rejecting_since_ns
            if aid.unresolved is None or since_ns is None or aid.unresolved[0] - since_ns < DISAGREES_NS or self.host.excluded(aid):
                continue
            size = float(np.linalg.norm(aid.unresolved[1]))
            found.append(Contradiction(GPS_DISAGREES, (aid.source, self.host.inertial or self.host.name), size, unit_of(aid), since_ns))
        return found

    @property
    def suspects_gps(self) -> bool:
        """Whether the prediction contradicts GPS, and no check can tell which of them is wrong."""
        return self.led_away is not None or bool(self._unresolved())

    def suspicion(self) -> str:
        """What speaks against the position of GPS or of the solution, in words; a frozen receiver is merely lost."""
        of_gps = (held for check in self.checks.receivers for held in check.held() if held.name == DISAGREE)
        own = () if self.led_away is None else (self.led_away,)
        found = next(chain(of_gps, own, self._unresolved()), None)
        return "" if found is None else found.words(max(self.host.core.t_ns, found.since_ns))

    def doubt(self, stamp_ns: int) -> np.ndarray:
        """What contradictions add to the covariance (9, 9) of position, velocity and attitude NED: m, m/s, rad.

        A frozen receiver adds nothing: it is known to be wrong.
        """
        added = self._added
        late = None if self.host.offsets is None else self.host.offsets.doubt()
        if late is None and self.away is None and not self._is_contradicted():
            return added
        added = added.copy()
        if late is not None:
            added[0:3, 0:3] += late[0:3, 0:3]
            if self.host.core.velocity_rows is not None:
                added[3:6, 3:6] += late[self.host.core.velocity_rows, self.host.core.velocity_rows]
        if self.away is not None:
            seen_ns, offset, drift = self.away
            added[0:3, 0:3] += covering(offset + drift * lasting_s(stamp_ns - seen_ns))
            added[3:6, 3:6] += covering(drift)
        for key in dict.fromkeys(aid.key for aid in self.receivers):
            offset, noise = np.zeros(3), np.zeros((3, 3))
            for aid, check in self.receivers.items():
                S = aid.status.innovation_covariance
                if aid.key != key or aid.unresolved is None or S is None or check.is_frozen(aid.measurement):
                    continue
                seen_ns, y = aid.unresolved
                if aid.measurement is GpsPosition:
                    offset, noise = offset + y, noise + S
                    continue
                seen_ns = next((a.unresolved[0] for a in self.receivers if a is not aid and a.key == key and a.unresolved), seen_ns)
                added[3:6, 3:6] += covering(y) + S
                lasting = lasting_s(stamp_ns - seen_ns)
                offset, noise = offset + y * lasting, noise + S * lasting**2
            added[0:3, 0:3] += covering(offset) + noise  # what they are apart is known no better than it was measured
        return added

    # the witness -------------------------------------------------------------------------------------------------------------

    def look(self, now_ns: int) -> None:
        """Look at GPS and the state, at every output: keep copies, call the witness, hear it."""
        if self.witness.core is not None:
            self._hear(now_ns)
            return
        host, since_ns = self.host, self._suspected_since(now_ns)
        if since_ns is not None and self.witness.call(since_ns, now_ns):
            self._heard_ns, self._recoveries = now_ns, host.recoveries()
            self._far = FAR if self._drift() > 1.0 else 1.0  # what was refused at first is not taken after all
            self._hear(now_ns)
        elif since_ns is None and not host.inertial_is_suspect and host.gps_good(now_ns) and not host.gps_alarm():
            self._good_ns, self._good_since_ns = now_ns, now_ns if self._good_since_ns is None else self._good_since_ns
            if now_ns - self._good_since_ns >= SETTLED_NS and all(aid.rejecting_since_ns is None for aid in self.receivers):
                self.witness.keep(host.core)
        elif now_ns - self._good_ns > PENDING_NS or all(aid.rejecting_since_ns is None for aid in self.receivers):
            self._good_since_ns = None
            self.witness.clear()

    def _suspected_since(self, now_ns: int) -> int | None:
        """Since when GPS is under suspicion, None where it is not."""
        is_slow = bool(self.told or self.host.gps_alarm() or self._drift() > 1.0)
        return min([found.since_ns for found in self._unresolved()] + [now_ns - SLOW_NS] * is_slow, default=None)

    def _drift(self) -> float:
        """By how much what is taken from GPS differs from the prediction over some seconds, 1: as it rarely does."""
        most = 0.0
        for aid in self._watched:
            most = max(most, aid.drift)
        return most

    def _hear(self, now_ns: int) -> None:
        """Compare the navigator's state with the witness."""
        witness, host = self.witness, self.host
        witness.follow(now_ns)
        if witness.core is None:
            self.forget_state()
            return
        suspected = self._suspected_since(now_ns) is not None
        if suspected:
            self._heard_ns = now_ns
        own, other = host.core.motion(), witness.core.motion()
        apart = self._apart = distance(own, other)
        ratio, unit = max((normalised(apart[rows], own.P[rows, rows] + other.P[rows, rows]), unit) for unit, rows in ROWS.items())
        if self.led_away is None:
            self._unit = unit
        size = float(np.linalg.norm(apart[ROWS[self._unit]]))
        shown = (suspected and ratio > APART) or self._drift() > self._far or host.recoveries() > self._recoveries
        if self.led_away is not None or self.told or shown:
            self._largest = max(self._largest, size)
            since_ns = now_ns if self.led_away is None else self.led_away.since_ns
            self.led_away = Contradiction(LED_AWAY, (self._gps(), host.inertial or host.name), size, self._unit, since_ns)
            self._added = alone(other.P, apart)
        if self._is_back(now_ns, other):
            host.return_to(witness.core)
            for aid, check in self.receivers.items():
                check.forget()
                aid.rejecting_since_ns = aid.unresolved = None
            self.forget_state()
        elif self._is_settled(now_ns, ratio, size):
            self.forget_state()

    def _gps(self) -> str:
        return next((aid.source for aid in self.receivers), EPOCHS)

    def _is_settled(self, now_ns: int, ratio: float, size: float) -> bool:
        """Whether the witness need not be heard any longer."""
        quiet_ns = now_ns - self._heard_ns
        together = self.led_away is None or (ratio < APART and size < BACK * self._largest)
        return (together and quiet_ns > LOOKS_NS) or self._is_explained() or quiet_ns > LASTS_NS

    def _is_explained(self) -> bool:
        """Whether a fault of what carries the state explains what witness and state are apart.

        What is learnt of a sensor is learnt of GPS, and a spoofer that speeds up teaches a bias of any size for as long as it does:
        it must have moved the witness further than a spoofer could have moved the state.
        """
        return float(np.linalg.norm(self._apart[ROWS["m/s"]])) > BEYOND_SPOOFING_MPS and self.host.explains()

    def _is_back(self, now_ns: int, other: Motion) -> bool:
        """Whether GPS, refused, has agreed with the witness for a while where it disagrees with the state."""
        refused = [(aid, aid.unresolved) for aid in self.receivers if aid.unresolved and now_ns - aid.unresolved[0] < RETURNS_NS]
        agrees, nearer = bool(refused) and self.led_away is not None, {}
        for aid, (_, y) in refused:
            rows, floor = ROWS[unit_of(aid)], FLOORS[unit_of(aid)]
            rest = y - self._apart[rows]
            agrees &= normalised(rest, other.P[rows, rows] + floor**2 * np.eye(3)) < APART
            nearer[unit_of(aid)] = np.linalg.norm(rest) < NEARER * np.linalg.norm(self._apart[rows])
        agrees &= bool(nearer.get("m", nearer.get("m/s", False)))
        if not agrees:
            self._back_since_ns = None
            return False
        self._back_since_ns = self._back_since_ns or now_ns
        return now_ns - self._back_since_ns >= RETURNS_NS


def unit_of(aid: Aid) -> str:
    """Of the innovations of an aid that a GPS receiver feeds."""
    return "m" if aid.measurement is GpsPosition else "m/s"


def lasting_s(age_ns: int) -> float:
    """For how long a velocity that is off moves the position, s."""
    return min(1e-9 * max(age_ns, 0) + LAG_S, LONGEST_S)


def covering(offset: np.ndarray) -> np.ndarray:
    """What an offset (m,) that may be an error adds to a covariance (m, m): across it half as much, for both may be wrong."""
    return COVERED**2 * (np.outer(offset, offset) + ACROSS**2 * float(offset @ offset) * np.eye(len(offset)))


def alone(P: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Position, velocity and attitude of a covariance (9, 9) without their correlations, and what covers an offset (9,) of each."""
    out = np.zeros((9, 9))
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        out[rows, rows] = P[rows, rows] + covering(apart[rows])
    return out


def normalised(offset: np.ndarray, covariance: np.ndarray) -> float:
    """Squared length of an offset (m,) over a covariance (m, m)."""
    return float(offset @ np.linalg.solve(covariance, offset))


def distance(own: Motion, other: Motion) -> np.ndarray:
    """Position, velocity and attitude (9,) of one motion less those of another, m, m/s, rad NED: ``other - own``."""
    turned = rotvec_from_quat(quat_multiply(other.q_nb, quat_conjugate(own.q_nb)))
    return np.concatenate((difference_n(*other.place, *own.place), other.vel_n - own.vel_n, turned))
