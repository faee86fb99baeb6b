"""Hard iron as states, and what shows it beside the heading: strength and dip of the field.

    measured = (1 + s) B_b + h,        B_b = C_nb' B_n,        B_n by the magnetic model

In straight flight an error of the heading and h across the field are the same thing, and their covariance says so; a turn tells them
apart.  The two rows here, along the horizontal field and down, never move the attitude: what iron makes of the dip would become tilt.  A
field that contradicts them for long is another field: a load that was switched on, or a sensor that was never calibrated.  Then the
calibration is forgotten, not the attitude, and begins anew.
"""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import MagneticField
from lowcostnav_ros.cores.views import Attitude
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, Host, Innovation, Reason
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Block, Kind, random_walk
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace, MagneticReference
from lowcostnav_ros.physics.rotation import skew
from lowcostnav_ros.physics.stochastic import correlation_factor

UT = 1e6
"""Microtesla of a tesla: states of a size near one keep the covariance well conditioned."""
UNKNOWN_UT = 5.0
"""Sigma of the hard iron beyond which the field shows no heading by its direction, and its strength is no test of it."""
PROVEN_S, REMEMBERED_S = 60.0, 1800.0
"""A calibration that was contradicted by the one after it is no hard iron (a sensor mounted turned, a load that comes and goes): no heading
is taken for twice as long each time."""
INTERFERENCE = "magnetic interference"
UNPROVEN = "magnetic calibration contradicted itself"
ADVICE = "look for iron or currents near it, or a sensor mounted turned; calibrated anew in turns"


class Calibration:
    """The states of one magnetometer: hard iron, uT, and scale factors; none where the settings ask for none.

    ``forgotten_ns``: when it was begun anew last, by what was believed of the attitude then; None: never.
    """

    def __init__(self, aid: Aid, host: Host) -> None:
        self.iron, self.scale = host.layout.get(aid.own("hard_iron")), host.layout.get(aid.own("magnetic_scale"))
        self._variance = aid.settings.uncalibrated_ut**2
        self.forgotten_ns: int | None = None
        self._failures, self._until_ns = 0, 0

    def field_ut(self, field_b: np.ndarray, host: Host) -> np.ndarray:
        """Measured field (3,), tesla, as the estimate makes it, uT."""
        field: np.ndarray = UT * field_b
        if self.iron is not None:
            field = field - host.core.estimate[self.iron]
        return field if self.scale is None else field / (1.0 + host.core.estimate[self.scale])

    def fill(self, H: np.ndarray, by_field: np.ndarray, field_ut: np.ndarray, host: Host) -> None:
        """Columns of ``H`` (m, n) for an innovation with the derivative ``by_field`` (m, 3) by the calibrated field."""
        if self.iron is None:
            return
        by_iron = by_field if self.scale is None else by_field / (1.0 + host.core.estimate[self.scale])
        H[:, self.iron] = by_iron
        if self.scale is not None:
            H[:, self.scale] = by_iron * field_ut

    def sigma_ut(self, host: Host) -> float:
        """Largest sigma of the hard iron, uT; 0 without states."""
        return 0.0 if self.iron is None else math.sqrt(max(host.P.diagonal()[self.iron].max(), 0.0))

    def is_known(self, host: Host) -> bool:
        """Whether the field shows a heading."""
        return self.sigma_ut(host) < UNKNOWN_UT

    def is_proven(self, stamp_ns: int) -> bool:
        """Whether no calibration was contradicted of late by the one before it."""
        return stamp_ns >= self._until_ns

    def forget(self, stamp_ns: int, host: Host) -> None:
        """Begin the calibration anew: nothing is known of the hard iron but its usual size."""
        if self.iron is not None:
            again = self.forgotten_ns is not None and stamp_ns - self.forgotten_ns < 1e9 * REMEMBERED_S
            self._failures = self._failures + 1 if again else 0
            self.forgotten_ns = stamp_ns
            self._until_ns = stamp_ns + round(1e9 * PROVEN_S * 2 ** min(self._failures, 10)) if again else 0
            kalman.reset_block(host.P, self.iron, self._variance * np.eye(3), host.core.history)


class HardIronAid(Aid):
    """Strength and dip: the field along the horizontal one and down against the model's, uT."""

    name, labels = "hard_iron", ("along_ut", "down_ut")
    measurement, topic, views = MagneticField, "imu/mag", (Attitude,)
    teaches = ("hard_iron", "magnetic_scale")

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.reference: MagneticReference | FieldAtPlace = MagneticReference(settings.decimal_year, settings.declination_deg)
        self.other_field = Latch("magnetic field and model disagree", (self.topic, "the magnetic model"), "uT")
        self.latches = [self.other_field]

    def blocks(self) -> list[Block]:
        """Hard iron, uT, and scale factors where they are asked for."""
        own, iron, scale = self.settings, self.own("hard_iron"), self.own("magnetic_scale")
        blocks = [random_walk(iron, [f"{iron}_{axis}_ut" for axis in "xyz"], Kind.FREE, own.hard_iron_ut, own.hard_iron_walk_ut_rts)]
        return blocks + ([random_walk(scale, [f"{scale}_{axis}" for axis in "xyz"], Kind.FREE, own.scale)] if own.scale else [])

    def attach(self, host: Host) -> None:
        """Find the states."""
        super().attach(host)
        self.calibration = Calibration(self, host)

    def free(self, stamp_ns: int, host: Host) -> np.ndarray | None:
        """The calibration, with GPS or without."""
        return self._teaching

    def innovation(self, measurement: MagneticField, host: Host) -> Innovation | str:
        """``y = a (B_n - C B_est)``, rows of a along the horizontal field and down; ``dy/dphi = -a [C B_est x]``."""
        core = host.core
        self.reference.follow(measurement.stamp_ns)
        model = self.reference.field_n(core.nav[0], core.nav[1], core.nav[2])
        if model is None:
            return Reason("no magnetic model", "wait for a fix, or set magnetic.decimal_year")
        field, C = self.calibration.field_ut(measurement.field_b, host), core.C_nb()
        rows = np.array([[*model[:2] / math.hypot(model[0], model[1]), 0.0], [0.0, 0.0, 1.0]])
        seen = C @ field
        H = np.zeros((2, host.layout.size))
        H[:, core.attitude_rows] = -rows @ skew(seen)
        self.calibration.fill(H, -rows @ C, field, host)
        return Innovation(rows @ (UT * model - seen), H, self.settings.strength_ut**2 * np.eye(2), rows @ seen, self._teaching)

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """As every aid; a field that is another one is named."""
        decision, reason = super().control(stamp_ns, test_ratio, host)
        y = self.status.innovation
        size = 0.0 if y is None else math.hypot(*y)
        disagrees = decision is not Decision.FUSE or not self.calibration.is_proven(stamp_ns)
        self.other_field.judge(stamp_ns, disagrees, size, self.source, ADVICE)
        return decision, INTERFERENCE if decision is Decision.REJECT else reason

    def rejects(self, measurement: MagneticField) -> bool:
        """Whether this very measurement was found to be of another field."""
        return self.decision is Decision.REJECT and self.status.stamp_ns == measurement.stamp_ns

    def prepare(self, measurement: MagneticField, innovation: Innovation, host: Host) -> Innovation:
        """Errors of the model and of scale factors last: many samples in one attitude are one."""
        innovation.R = innovation.R * correlation_factor(self.since_s(measurement), self.settings.strength_tau_s)
        return innovation

    def recover(self, measurement: MagneticField, innovation: Innovation, host: Host) -> None:
        """Forget the calibration; the attitude stays."""
        self.calibration.forget(measurement.stamp_ns, host)
        self.fuse(innovation, host)
