"""Magnetometer: magnetic heading, with a slow error of its own."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids._hard_iron import INTERFERENCE, UNPROVEN, UT, Calibration, HardIronAid
from lowcostnav_ros.base.measurements import MagneticField
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.views import Attitude
from lowcostnav_ros.estimation.aiding import (
    BEYOND_GATE,
    Aid,
    Decision,
    GateSettings,
    Host,
    Innovation,
    Reason,
    Sensor,
    SensorSettings,
    reset_to,
)
from lowcostnav_ros.estimation.cross_checks.heading import SLOWEST_MPS, HeadingCheck, crabs, heading_of
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.physics.geomagnetism import check_year, year_setting
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace, MagneticReference, magnetic_innovation
from lowcostnav_ros.physics.rotation import skew, wrap

TURNED = "magnetic heading contradicts the GPS track"
AGAINST_MOTION = "magnetic heading contradicts the motion GPS shows"
ADVICE = "calibrate the magnetometer, look for iron or currents near it"
STEEPEST = 0.7
"""Sine of the pitch up to which a nose points along the track."""
TRACK_SIGMA_DEG = 15.0
"""Sigma of a heading taken from the track."""
DECLINATION_UNKNOWN = Reason("declination unknown", "wait for a fix, or set place.lat_lon_deg or magnetic.declination_deg")

SMALLEST_UT = 1e-3
NO_MODEL = Reason("no magnetic model of this date", "set magnetic.decimal_year or magnetic.declination_deg")


@dataclass(frozen=True)
class MagneticSettings(SensorSettings):
    """Magnetometer as a heading reference."""

    enabled: bool = setting(True, "Use the magnetometer for heading.")
    noise_deg: float = setting(1.0, "White noise of the magnetic heading.", unit="deg", minimum=0.01, maximum=90.0, within=3)
    bias_deg: float = setting(
        2.5, "Slow heading error left after calibration, Gauss-Markov sigma.", unit="deg", minimum=0.0, maximum=90.0, within=3
    )
    bias_tau_s: float = setting(120.0, "Correlation time of the slow heading error.", unit="s", minimum=1.0, within=2)
    decimal_year: float = year_setting("Date of the magnetic model")
    hard_iron_ut: float = setting(1.0, "Hard iron left after calibration, sigma; 0: no states.", unit="uT", minimum=0.0, maximum=200.0)
    hard_iron_walk_ut_rts: float = setting(0.02, "Growth of that sigma.", unit="uT/sqrt(s)", minimum=0.0, maximum=10.0)
    uncalibrated_ut: float = setting(
        60.0, "Sigma of the hard iron of a sensor whose field contradicts model or motion for long.", unit="uT", minimum=0.0, maximum=500.0
    )
    scale: float = setting(0.0, "Scale-factor error of each axis, sigma as a fraction; 0: no states.", minimum=0.0, maximum=0.5)
    strength_ut: float = setting(1.5, "Error of strength and dip, which show the hard iron.", unit="uT", minimum=0.05, maximum=50.0)
    strength_tau_s: float = setting(5.0, "Correlation time of that error.", unit="s", minimum=0.0, maximum=600.0)
    declination_deg: list = setting([], "Declination, east positive; empty: from the model.", unit="deg", minimum=-180.0, maximum=180.0)
    period_s: float = setting(0.5, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)

    def __post_init__(self) -> None:
        if len(self.declination_deg) > 1:
            raise SettingsError(f"'magnetic.declination_deg' takes one number or none, got {self.declination_deg}.")
        if not self.declination_deg:
            check_year(self.decimal_year)


class MagneticAid(Aid):
    """Magnetic heading through the full tilt geometry, rad; a slow heading error is a state of its own.

    ``reference`` gives the field expected at a place; a host that does not estimate its position hands it the place last known.
    """

    name, labels = "magnetic_heading", ("heading_rad",)
    measurement, topic, views = MagneticField, "imu/mag", (Attitude,)
    strength: HardIronAid | None = None

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.turned = HeadingCheck(self.topic)
        self.against_motion = Latch("magnetic heading and motion disagree", (self.topic, "the motion GPS shows"), "deg", 0.0, 20.0)
        self.against_gyros = Latch("magnetic heading and gyros disagree", (self.topic, "the gyros"), "deg")
        self.latches = [self.turned, self.against_motion, self.against_gyros]
        self.reference: MagneticReference | FieldAtPlace = MagneticReference(settings.decimal_year, settings.declination_deg)

    def blocks(self) -> list[Block]:
        """Slow heading error, rad."""
        if self.settings.bias_deg == 0.0:
            return []
        labels = [self.own("magnetic_heading_bias_rad")]
        sigma = self.settings.bias_deg * DEGREE
        return [gauss_markov(self.own("heading_bias"), labels, Kind.FREE, sigma, self.settings.bias_tau_s)]

    def attach(self, host: Host) -> None:
        """Find the states of the calibration."""
        super().attach(host)
        self.calibration = Calibration(self, host) if self.strength is None else self.strength.calibration

    @property
    def remark(self) -> str:
        """What is odd about the date of the model."""
        return self.reference.remark

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """As every aid, unless wind explains in no way how far it is off the track: then the track gives the heading."""
        core, moving = host.core, self.shows_heading(stamp_ns, host)
        known = self.calibration.is_known(host)
        if moving and known and self.status.observation is not None:
            C, (north, east) = core.C_nb(), core.nav[3:5]
            heading = heading_of(C)
            began = abs(C[2, 0]) < STEEPEST and self.turned.compare(stamp_ns, heading + self.status.observation[0], north, east)
            if began and crabs(heading, north, east) is not None:  # the estimate has followed it
                down = slice(core.attitude_rows.stop - 1, core.attitude_rows.stop)
                reset_to(host, down, np.array([wrap(math.atan2(east, north) - heading)]), np.array([[(TRACK_SIGMA_DEG * DEGREE) ** 2]]))
            if began:
                self.calibration.forget(stamp_ns, host)
        if self.turned.held is not None and known:
            return Decision.REJECT, TURNED
        decision = super().control(stamp_ns, test_ratio, host)
        size = 0.0 if self.status.observation is None else abs(float(self.status.observation[0])) / DEGREE
        self.against_gyros.judge(stamp_ns, decision == (Decision.REJECT, BEYOND_GATE), size, self.source, ADVICE)
        if self.status.observation is not None and self.against_motion.held is not None:
            self.against_motion.judge(stamp_ns, decision[0] is Decision.REJECT, size, self.source, ADVICE)
        return decision

    def shows_heading(self, stamp_ns: int, host: Host) -> bool:
        """Whether GPS shows a heading without the magnetometer: the vehicle moves, and its velocity is measured."""
        return host.gps_good(stamp_ns) and math.hypot(host.core.nav[3], host.core.nav[4]) > SLOWEST_MPS

    def doubt(self, stamp_ns: int, host: Host) -> str:
        """Where GPS shows the heading, a magnetometer that contradicts it is not followed, but calibrated anew where it has states."""
        if not self.shows_heading(stamp_ns, host):
            return ""
        size = 0.0 if self.status.observation is None else abs(float(self.status.observation[0])) / DEGREE
        self.against_motion.judge(stamp_ns, True, size, self.source, ADVICE)
        return AGAINST_MOTION if self.calibration.iron is None else ""

    def recover(self, measurement: MagneticField, innovation: Innovation, host: Host) -> None:
        """Forget the calibration rather than the heading, where it has states: gyros do not step, a field beside iron does."""
        if self.calibration.iron is None:
            super().recover(measurement, innovation, host)
        else:
            self.calibration.forget(measurement.stamp_ns, host)

    def innovation(self, measurement: MagneticField, host: Host) -> Innovation | str:
        """Heading innovation with its attitude row; refused when the field is not the earth's (interference)."""
        core = host.core
        self.reference.follow(measurement.stamp_ns)
        reference = self.reference.at(core.nav[0], core.nav[1], core.nav[2])
        if reference is None:
            return NO_MODEL if self.reference.remark else DECLINATION_UNKNOWN
        field_ut, known, C = self.calibration.field_ut(measurement.field_b, host), self.calibration.is_known(host), core.C_nb()
        refusal = Reason.of(reference.refusal(field_ut / UT)) if known else ""
        if not refusal and self.strength is not None and self.strength.rejects(measurement):
            refusal = INTERFERENCE
        if not refusal and not self.calibration.is_proven(measurement.stamp_ns):
            refusal = UNPROVEN
        if refusal:
            return refusal
        H = np.zeros((1, host.layout.size))
        model = None if known else self.reference.field_n(core.nav[0], core.nav[1], core.nav[2])
        if model is None:
            y, H[0, core.attitude_rows], level = magnetic_innovation(C, field_ut, reference.declination)
            north, east = (C @ field_ut)[:2]
            across = np.array([east, -north, 0.0]) / max(level, SMALLEST_UT) ** 2
        else:  # linear in the hard iron, however large it is
            level = UT * math.hypot(model[0], model[1])
            across = np.array([model[1], -model[0], 0.0]) * UT / level**2
            y, H[0, core.attitude_rows] = float(across @ C @ field_ut), across @ skew(C @ field_ut)
        self.calibration.fill(H, (across @ C)[None, :], field_ut, host)
        bias = host.layout.get(self.own("heading_bias"))
        if bias is not None:
            H[0, bias] = 1.0
            y -= core.estimate[bias.start]
        return Innovation(np.array([y]), H, np.array([[(self.settings.noise_deg * DEGREE) ** 2]]), np.array([y]))


def _make(settings: MagneticSettings, key: str, stations: Any) -> list[Aid]:
    """The heading; before it, where hard iron is a state, what tells another field."""
    heading = MagneticAid(settings, key, stations)
    if settings.hard_iron_ut == 0.0:
        return [heading]
    heading.strength = HardIronAid(settings, key, stations)
    return [heading.strength, heading]


MAGNETIC = AIDS.register("magnetic", Sensor("magnetic", MagneticSettings, _make), __name__)
