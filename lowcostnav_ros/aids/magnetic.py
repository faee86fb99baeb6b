"""Magnetometer: magnetic heading, with a slow error of its own."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import MagneticField
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.views import Attitude
from lowcostnav_ros.estimation.aiding import Aid, Decision, GateSettings, Host, Innovation, Reason, Sensor, SensorSettings, each, reset_to
from lowcostnav_ros.estimation.cross_checks.heading import SLOWEST_MPS, HeadingCheck, crabs
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.physics.geomagnetism import check_year, year_setting
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace, MagneticReference, magnetic_innovation
from lowcostnav_ros.physics.rotation import wrap

TURNED = "magnetic heading contradicts the GPS track"
AGAINST_MOTION = "magnetic heading contradicts the motion GPS shows"
ADVICE = "calibrate the magnetometer, look for iron or currents near it"
STEEPEST = 0.7
"""Sine of the pitch up to which a nose points along the track."""
TRACK_SIGMA_DEG = 15.0
"""Sigma of a heading taken from the track."""
DECLINATION_UNKNOWN = Reason("declination unknown", "wait for a fix, or set place.lat_lon_deg or magnetic.declination_deg")

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

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.turned = HeadingCheck(self.topic)
        self.against_motion = Latch("magnetic heading and motion disagree", (self.topic, "the motion GPS shows"), "deg", 0.0, 20.0)
        self.latches = [self.turned, self.against_motion]
        self.reference: MagneticReference | FieldAtPlace = MagneticReference(settings.decimal_year, settings.declination_deg)

    def blocks(self) -> list[Block]:
        """Slow heading error, rad."""
        if self.settings.bias_deg == 0.0:
            return []
        labels = [self.own("magnetic_heading_bias_rad")]
        sigma = self.settings.bias_deg * DEGREE
        return [gauss_markov(self.own("heading_bias"), labels, Kind.FREE, sigma, self.settings.bias_tau_s)]

    @property
    def remark(self) -> str:
        """What is odd about the date of the model."""
        return self.reference.remark

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """As every aid, unless wind explains in no way how far it is off the track: then the track gives the heading."""
        core, moving = host.core, self.shows_heading(stamp_ns, host)
        if moving and self.status.observation is not None:
            C, (north, east) = core.C_nb(), core.nav[3:5]
            heading = math.atan2(C[1, 0], C[0, 0])
            began = abs(C[2, 0]) < STEEPEST and self.turned.compare(stamp_ns, heading + self.status.observation[0], north, east)
            if began and crabs(heading, north, east) is not None:  # the estimate has followed it
                down = slice(core.attitude_rows.stop - 1, core.attitude_rows.stop)
                reset_to(host, down, np.array([wrap(math.atan2(east, north) - heading)]), np.array([[(TRACK_SIGMA_DEG * DEGREE) ** 2]]))
        if self.turned.held is not None:
            return Decision.REJECT, TURNED
        decision = super().control(stamp_ns, test_ratio, host)
        if self.status.observation is not None and self.against_motion.held is not None:
            size = abs(float(self.status.observation[0])) / DEGREE
            self.against_motion.judge(stamp_ns, decision[0] is Decision.REJECT, size, self.source, ADVICE)
        return decision

    def shows_heading(self, stamp_ns: int, host: Host) -> bool:
        """Whether GPS shows a heading without the magnetometer: the vehicle moves, and its velocity is measured."""
        return host.gps_good(stamp_ns) and math.hypot(host.core.nav[3], host.core.nav[4]) > SLOWEST_MPS

    def doubt(self, stamp_ns: int, host: Host) -> str:
        """Where GPS shows the heading, a magnetometer that contradicts it is not followed."""
        if not self.shows_heading(stamp_ns, host):
            return ""
        size = 0.0 if self.status.observation is None else abs(float(self.status.observation[0])) / DEGREE
        self.against_motion.judge(stamp_ns, True, size, self.source, ADVICE)
        return AGAINST_MOTION

    def innovation(self, measurement: MagneticField, host: Host) -> Innovation | str:
        """Heading innovation with its attitude row; refused when the field is not the earth's (interference)."""
        core = host.core
        self.reference.follow(measurement.stamp_ns)
        reference = self.reference.at(core.nav[0], core.nav[1], core.nav[2])
        if reference is None:
            return NO_MODEL if self.reference.remark else DECLINATION_UNKNOWN
        refusal = Reason.of(reference.refusal(measurement.field_b))
        if refusal:
            return refusal
        y, h_att, _ = magnetic_innovation(core.C_nb(), measurement.field_b, reference.declination)
        H = np.zeros((1, host.layout.size))
        H[0, core.attitude_rows] = h_att
        bias = host.layout.get(self.own("heading_bias"))
        if bias is not None:
            H[0, bias] = 1.0
            y -= core.estimate[bias.start]
        return Innovation(np.array([y]), H, np.array([[(self.settings.noise_deg * DEGREE) ** 2]]), np.array([y]))


MAGNETIC = AIDS.register("magnetic", Sensor("magnetic", MagneticSettings, each(MagneticAid)), __name__)
