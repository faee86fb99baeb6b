"""Aids of the GPS/INS navigator: GPS position and velocity, barometric height, magnetic heading, airspeed, sideslip, wheels."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, GpsPosition, GpsVelocity, MagneticField, Pressure
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, POS, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Innovation
from lowcostnav_ros.physics.atmosphere import pressure_altitude
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.magnetic_heading import magnetic_innovation
from lowcostnav_ros.physics.rotation import quat_to_dcm, skew

if TYPE_CHECKING:
    from lowcostnav_ros.navigators.ins_gps import InsGps


@dataclass(frozen=True)
class GpsSettings:
    """GPS receiver and antenna."""

    lever_arm_b_m: list = setting([0.0, 0.0, 0.0], "Antenna relative to the IMU, forward, right, down.", unit="m", minimum=-100.0)
    latency_s: float = setting(0.2, "Longest delay between validity and arrival of a fix.", unit="s", minimum=0.0, maximum=5.0)
    sigma_scale: float = setting(1.0, "Factor on the receiver's stated sigma.", minimum=0.1, maximum=100.0)
    position_floor_m: float = setting(0.5, "Smallest position sigma believed.", unit="m", minimum=1e-3, maximum=1e3)
    velocity_floor_mps: float = setting(0.05, "Smallest velocity sigma believed.", unit="m/s", minimum=1e-4, maximum=1e2)
    position_bias_m: float = setting(0.0, "Slow position error, Gauss-Markov sigma; 0: no states.", unit="m", minimum=0.0)
    position_bias_tau_s: float = setting(300.0, "Correlation time of the slow position error.", unit="s", minimum=1.0)
    period_s: float = setting(0.0, "Use at most one fix in this time; 0 uses all.", unit="s", minimum=0.0, maximum=60.0)
    timeout_s: float = setting(2.5, "No accepted fix for this long is an outage.", unit="s", minimum=0.1, maximum=600.0)
    gate: GateSettings = group(GateSettings)

    def __post_init__(self) -> None:
        if len(self.lever_arm_b_m) != 3:
            raise SettingsError(f"'gps.lever_arm_b_m' needs three numbers, forward, right, down, got {len(self.lever_arm_b_m)}.")


@dataclass(frozen=True)
class BaroSettings:
    """Static pressure as a height reference."""

    enabled: bool = setting(True, "Use static pressure for height.")
    sigma_m: float = setting(2.0, "White noise of the pressure altitude.", unit="m", minimum=0.01, maximum=1e3)
    bias_m: float = setting(150.0, "Sigma of pressure altitude minus ellipsoid height before GPS has taught it.", unit="m", minimum=0.0)
    walk_m_rts: float = setting(1.6, "Growth of that difference (23 m in 400 s).", unit="m/sqrt(s)", minimum=0.0, maximum=100.0)
    period_s: float = setting(0.5, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class MagneticSettings:
    """Magnetometer as a heading reference."""

    enabled: bool = setting(True, "Use the magnetometer for heading.")
    noise_deg: float = setting(1.0, "White noise of the magnetic heading.", unit="deg", minimum=0.01, maximum=90.0)
    bias_deg: float = setting(2.5, "Slow heading error left after calibration, Gauss-Markov sigma.", unit="deg", minimum=0.0, maximum=90.0)
    bias_tau_s: float = setting(120.0, "Correlation time of the slow heading error.", unit="s", minimum=1.0)
    decimal_year: float = setting(2026.5, "Date of the magnetic model.", unit="year", minimum=2015.0, maximum=2035.0)
    declination_deg: list = setting([], "Declination, east positive; empty: from the model.", unit="deg", minimum=-180.0, maximum=180.0)
    period_s: float = setting(0.5, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class AirDataSettings:
    """Airspeed and sideslip: they teach the wind while GPS is good and hold the position in an outage."""

    enabled: bool = setting(True, "Use airspeed and sideslip.")
    noise_mps: float = setting(1.0, "White noise of the true airspeed, turbulence included.", unit="m/s", minimum=0.01, maximum=50.0)
    bias_mps: float = setting(1.5, "Slow airspeed error, Gauss-Markov sigma.", unit="m/s", minimum=0.0, maximum=50.0)
    bias_tau_s: float = setting(400.0, "Correlation time of the slow airspeed error.", unit="s", minimum=1.0)
    sideslip_deg: float = setting(2.0, "Sigma of the sideslip where no vane measures it.", unit="deg", minimum=0.05, maximum=30.0)
    minimum_mps: float = setting(12.0, "Below this airspeed nothing is used.", unit="m/s", minimum=0.0, maximum=200.0)
    wind_mps: float = setting(5.0, "Wind change, Gauss-Markov sigma of each component.", unit="m/s", minimum=0.1, maximum=50.0)
    wind_tau_s: float = setting(400.0, "Correlation time of the wind change.", unit="s", minimum=1.0)
    wind_start_mps: float = setting(10.0, "Sigma of the wind at the start.", unit="m/s", minimum=0.1, maximum=100.0)
    period_s: float = setting(1.0, "Use at most one measurement in this time (its errors are slow).", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class WheelSettings:
    """Motion constraint of a road vehicle: no velocity sideways or up in its own axes."""

    enabled: bool = setting(False, "The vehicle rolls on wheels.")
    sigma_mps: float = setting(0.2, "Sigma of the sideways and vertical velocity.", unit="m/s", minimum=1e-3, maximum=10.0)
    period_s: float = setting(0.2, "Apply once in this time.", unit="s", minimum=0.01, maximum=60.0)
    minimum_mps: float = setting(1.0, "Applied above this speed only.", unit="m/s", minimum=0.0, maximum=100.0)
    gate: GateSettings = group(GateSettings)


def floored(cov: np.ndarray, scale: float, floor: float) -> np.ndarray:
    """Covariance scaled by sigma factor ``scale``, no variance below ``floor`` squared."""
    out = cov * (scale * scale)
    for i in range(3):
        out[i, i] = max(out[i, i], floor * floor)
    return out


class PositionAid(Aid):
    """GPS position of the antenna against the inertial position and lever arm, metres NED."""

    def __init__(self, settings: GpsSettings) -> None:
        super().__init__("gps_position", ("north_m", "east_m", "down_m"), settings.gate)
        self.settings = settings
        self.lever_b = np.array(settings.lever_arm_b_m, dtype=float)

    def innovation(self, measurement: GpsPosition, host: "InsGps") -> Innovation | str:
        """y = p_gps - (p + C l) - b; H = I on position, -[C l]x on attitude, I on the receiver's slow error."""
        nav, n = host.core.nav, host.layout.size
        lever_n = quat_to_dcm(nav[6:10]) @ self.lever_b
        y = difference_n(measurement.lat, measurement.lon, measurement.height, nav[0], nav[1], nav[2])
        observation, y = y.copy(), y - lever_n
        H = np.zeros((3, n))
        H[:, POS], H[:, ATT] = np.eye(3), -skew(lever_n)
        if "gps_position_bias" in host.layout:
            rows = host.layout["gps_position_bias"]
            H[:, rows] = np.eye(3)
            y = y - host.core.estimate[rows]
        return Innovation(y, H, floored(measurement.cov_n, self.settings.sigma_scale, self.settings.position_floor_m), observation)

    def recover(self, measurement: GpsPosition, innovation: Innovation, host: "InsGps") -> None:
        """Take the position from GPS afresh: a long disagreement says our position, not our attitude, is lost."""
        kalman.reset_block(host.P, POS, innovation.R)
        dx = np.zeros(host.layout.size)
        dx[POS] = innovation.y
        host.correct(dx)


class VelocityAid(Aid):
    """GPS velocity of the antenna against inertial velocity plus rotation of the lever arm, m/s NED."""

    def __init__(self, settings: GpsSettings) -> None:
        super().__init__("gps_velocity", ("north_mps", "east_mps", "down_mps"), settings.gate)
        self.settings = settings
        self.lever_b = np.array(settings.lever_arm_b_m, dtype=float)

    def innovation(self, measurement: GpsVelocity, host: "InsGps") -> Innovation | str:
        """y = v_gps - (v + C (w x l)); the lever-arm velocity also depends on attitude and gyro bias."""
        nav, n = host.core.nav, host.layout.size
        C = quat_to_dcm(nav[6:10])
        swing_n = C @ np.cross(host.rate_b, self.lever_b)
        H = np.zeros((3, n))
        H[:, VEL], H[:, ATT] = np.eye(3), -skew(swing_n)
        H[:, host.layout["gyro_bias"]] = C @ skew(self.lever_b)
        y = measurement.vel_n - nav[3:6] - swing_n
        return Innovation(y, H, floored(measurement.cov_n, self.settings.sigma_scale, self.settings.velocity_floor_mps), measurement.vel_n)

    def recover(self, measurement: GpsVelocity, innovation: Innovation, host: "InsGps") -> None:
        """Take the velocity from GPS afresh, leaving attitude and biases alone."""
        kalman.reset_block(host.P, VEL, innovation.R)
        dx = np.zeros(host.layout.size)
        dx[VEL] = innovation.y
        host.correct(dx)


class BaroAid(Aid):
    """Pressure altitude against height plus the learned difference between the two, m."""

    def __init__(self, settings: BaroSettings) -> None:
        super().__init__("baro_height", ("height_m",), settings.gate)
        self.settings = settings

    def innovation(self, measurement: Pressure, host: "InsGps") -> Innovation | str:
        """y = h_pressure - (h + b); height is minus the down error, so H = -1 on down and 1 on the bias."""
        altitude = float(pressure_altitude(measurement.pressure_pa))
        bias = host.layout["baro_bias"].start
        H = np.zeros((1, host.layout.size))
        H[0, 2], H[0, bias] = -1.0, 1.0
        y = altitude - host.core.nav[2] - host.core.estimate[bias]
        return Innovation(np.array([y]), H, np.array([[self.settings.sigma_m**2]]), np.array([altitude]))


class MagneticAid(Aid):
    """Magnetic heading through the full tilt geometry, rad; a slow heading error is a state of its own."""

    def __init__(self, settings: MagneticSettings) -> None:
        super().__init__("magnetic_heading", ("heading_rad",), settings.gate)
        self.settings = settings

    def innovation(self, measurement: MagneticField, host: "InsGps") -> Innovation | str:
        """Heading innovation with its attitude row; refused when the field is not the earth's (interference)."""
        nav = host.core.nav
        reference = host.magnetic.at(nav[0], nav[1], nav[2])
        reason = reference.refusal(measurement.field_b)
        if reason:
            return reason
        y, h_att, _ = magnetic_innovation(quat_to_dcm(nav[6:10]), measurement.field_b, reference.declination)
        H = np.zeros((1, host.layout.size))
        H[0, ATT] = h_att
        if "heading_bias" in host.layout:
            bias = host.layout["heading_bias"].start
            H[0, bias] = 1.0
            y -= host.core.estimate[bias]
        return Innovation(np.array([y]), H, np.array([[(self.settings.noise_deg * DEGREE) ** 2]]), np.array([y]))


def air_velocity_b(host: "InsGps") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicted air-relative velocity: in n, in b, and its Jacobian (3, n) in b (velocity, wind and attitude columns)."""
    nav, wind = host.core.nav, host.layout["wind"]
    C = quat_to_dcm(nav[6:10])
    air_n = nav[3:6].copy()
    air_n[:2] -= host.core.estimate[wind]
    J = np.zeros((3, host.layout.size))
    J[:, VEL], J[:, ATT] = C.T, C.T @ skew(air_n)
    J[:, wind] = -C.T[:, :2]
    return air_n, C.T @ air_n, J


class AirspeedAid(Aid):
    """True airspeed against the length of velocity minus wind, m/s."""

    def __init__(self, settings: AirDataSettings) -> None:
        super().__init__("airspeed", ("tas_mps",), settings.gate)
        self.settings = settings

    def innovation(self, measurement: AirVelocity, host: "InsGps") -> Innovation | str:
        """y = TAS - (|v - w| + b)."""
        tas = float(np.linalg.norm(measurement.vel_b))
        if tas < self.settings.minimum_mps:
            return "below minimum airspeed"
        air_n, _, _ = air_velocity_b(host)
        speed = float(np.linalg.norm(air_n))
        if speed < 1.0:
            return "predicted airspeed is zero"
        layout = host.layout
        H = np.zeros((1, layout.size))
        H[0, VEL] = air_n / speed
        H[0, layout["wind"]] = -air_n[:2] / speed
        H[0, layout["airspeed_bias"]] = 1.0
        y = tas - speed - host.core.estimate[layout["airspeed_bias"]][0]
        stated = measurement.cov_b[0, 0] - self.settings.bias_mps**2  # what the message states beyond the slow error, a state here
        variance = max(self.settings.noise_mps**2, stated)
        return Innovation(np.array([y]), H, np.array([[variance]]), np.array([tas]), host.air_free())


class SideslipAid(Aid):
    """Sideways air-relative velocity: a vane's measurement, else zero within the sideslip sigma, m/s."""

    def __init__(self, settings: AirDataSettings) -> None:
        super().__init__("sideslip", ("lateral_mps",), settings.gate)
        self.settings = settings

    def innovation(self, measurement: AirVelocity, host: "InsGps") -> Innovation | str:
        """y = v_lateral - (C' (v - w))_y; not before the wind is known well enough to say which way the air comes from."""
        tas = float(np.linalg.norm(measurement.vel_b))
        if tas < self.settings.minimum_mps:
            return "below minimum airspeed"
        if host.wind_sigma() > 0.5 * tas:
            return "wind not known yet"
        _, air_b, J = air_velocity_b(host)
        measured = measurement.cov_b[1, 1] < UNKNOWN_VARIANCE
        lateral = measurement.vel_b[1] if measured else 0.0
        sigma = tas * self.settings.sideslip_deg * DEGREE
        variance = max(measurement.cov_b[1, 1], (0.25 * sigma) ** 2) if measured else sigma**2
        return Innovation(np.array([lateral - air_b[1]]), J[1:2].copy(), np.array([[variance]]), np.array([lateral]), host.air_free())


class WheelAid(Aid):
    """Road vehicle: velocity in its own axes has no sideways and no vertical part."""

    def __init__(self, settings: WheelSettings) -> None:
        super().__init__("wheels", ("lateral_mps", "vertical_mps"), settings.gate)
        self.settings = settings

    def innovation(self, measurement, host: "InsGps") -> Innovation | str:
        """y = 0 - (C' v)_{y,z} with the attitude column C'[v x]."""
        nav = host.core.nav
        if float(np.linalg.norm(nav[3:6])) < self.settings.minimum_mps:
            return "below minimum speed"
        C = quat_to_dcm(nav[6:10])
        H = np.zeros((2, host.layout.size))
        H[:, VEL], H[:, ATT] = C.T[1:], (C.T @ skew(nav[3:6]))[1:]
        y = -(C.T @ nav[3:6])[1:]
        return Innovation(y, H, np.eye(2) * self.settings.sigma_mps**2, np.zeros(2))
