"""Settings of the attitude and heading reference and the list of blocks they choose."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerCalibration
from lowcostnav_ros.cores.imu_errors import ImuSettings, bias_blocks, core_block
from lowcostnav_ros.estimation.aiding import GateSettings
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov, random_walk
from lowcostnav_ros.navigators.base import HorizonSettings

FULL, EULER, QUATERNION, VECTOR_MATCHING, SWITCHED = FILTERS = ("full", "euler", "quaternion", "vector_matching", "switched")
"""What ``filter`` may say."""


@dataclass(frozen=True)
class PlaceSettings:
    """Where the flight is until a position is received; it gives the magnetic declination, gravity and the earth's rate."""

    lat_lon_deg: list = setting([], "Latitude, longitude; empty: unknown before the first fix.", unit="deg", minimum=-180.0, maximum=180.0)
    height_m: float = setting(0.0, "Height above the ellipsoid.", unit="m", minimum=-1000.0, maximum=30000.0)

    def __post_init__(self) -> None:
        if len(self.lat_lon_deg) not in (0, 2) or (self.lat_lon_deg and abs(self.lat_lon_deg[0]) > 89.0):
            raise SettingsError(f"'place.lat_lon_deg' needs latitude (at most 89) and longitude, or nothing; got {self.lat_lon_deg}.")


@dataclass(frozen=True)
class GpsVelocitySettings:
    """GPS velocity: its change is the acceleration that the accelerometers feel beside gravity."""

    lever_arm_b_m: list = setting([0.0, 0.0, 0.0], "Antenna relative to the IMU, forward, right, down.", unit="m", minimum=-100.0)
    latency_s: float = setting(0.0, "Longest delay between validity and arrival.", unit="s", minimum=0.0, maximum=5.0)
    sigma_scale: float = setting(1.0, "Factor on the receiver's stated sigma.", minimum=0.1, maximum=100.0)
    velocity_floor_mps: float = setting(0.05, "Smallest velocity sigma believed.", unit="m/s", minimum=1e-4, maximum=1e2)
    timeout_s: float = setting(2.5, "No accepted velocity for this long is an outage.", unit="s", minimum=0.1, maximum=60.0)
    gate: GateSettings = group(GateSettings)

    def __post_init__(self) -> None:
        if len(self.lever_arm_b_m) != 3:
            raise SettingsError(f"'gps.lever_arm_b_m' needs forward, right, down; got {len(self.lever_arm_b_m)} numbers.")


@dataclass(frozen=True)
class MagneticHeadingSettings:
    """Calibrated magnetometer: heading only."""

    enabled: bool = setting(True, "Use the magnetometer for heading.")
    noise_deg: float = setting(0.8, "White noise of the magnetic heading.", unit="deg", minimum=0.01, maximum=90.0)
    bias_deg: float = setting(2.5, "Slow heading error left after calibration, Gauss-Markov sigma.", unit="deg", minimum=0.01, maximum=90.0)
    bias_tau_s: float = setting(120.0, "Correlation time of the slow heading error.", unit="s", minimum=1.0)
    decimal_year: float = setting(2026.5, "Date of the magnetic model.", unit="year", minimum=2010.0, maximum=2030.0)
    declination_deg: list = setting([], "Declination, east positive; empty: from the model.", unit="deg", minimum=-180.0, maximum=180.0)
    period_s: float = setting(0.5, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class AirflowSettings:
    """Air data: what gives the acceleration when GPS velocity is missing."""

    enabled: bool = setting(True, "Use the air-relative velocity.")
    noise_mps: float = setting(0.5, "White noise and gusts in each component.", unit="m/s", minimum=0.01, maximum=20.0)
    bias_mps: float = setting(2.6, "Slow airspeed error, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=50.0)
    bias_tau_s: float = setting(400.0, "Correlation time of the slow airspeed error.", unit="s", minimum=1.0)
    incidence_deg: float = setting(3.0, "Usual incidence of the body x axis, used without a vane.", unit="deg", minimum=-5.0, maximum=20.0)
    incidence_sigma_deg: float = setting(2.0, "Incidence about the usual one, Gauss-Markov sigma.", unit="deg", minimum=0.1, maximum=20.0)
    incidence_tau_s: float = setting(60.0, "Correlation time of the incidence.", unit="s", minimum=0.5)
    sideslip_sigma_deg: float = setting(1.5, "Sideslip, Gauss-Markov sigma.", unit="deg", minimum=0.1, maximum=20.0)
    sideslip_tau_s: float = setting(15.0, "Correlation time of the sideslip.", unit="s", minimum=0.5)
    wind_mps: float = setting(5.0, "Change of a wind component in its correlation time, sigma.", unit="m/s", minimum=0.01, maximum=50.0)
    wind_tau_s: float = setting(400.0, "Correlation time of the wind.", unit="s", minimum=1.0)
    wind_start_mps: float = setting(10.0, "Sigma of the wind at the start.", unit="m/s", minimum=0.1, maximum=100.0)
    updraught_mps: float = setting(0.5, "Vertical wind, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=20.0)
    updraught_tau_s: float = setting(30.0, "Correlation time of the vertical wind.", unit="s", minimum=1.0)
    minimum_mps: float = setting(15.0, "Below this airspeed nothing is used.", unit="m/s", minimum=1.0, maximum=200.0)
    period_s: float = setting(0.2, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    timeout_s: float = setting(3.0, "No accepted airspeed for this long is an outage.", unit="s", minimum=0.1, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class LevelSettings:
    """Plain levelling by the accelerometers, the last resort, and the switch that allows it."""

    period_s: float = setting(1.0, "Span over which the velocity must not have changed.", unit="s", minimum=0.2, maximum=10.0)
    acceleration_mps2: float = setting(0.3, "Acceleration left in steady flight, sigma.", unit="m/s^2", minimum=0.01, maximum=5.0)
    yaw_rate_dps: float = setting(0.5, "Turning faster than this is manoeuvring.", unit="deg/s", minimum=0.05, maximum=10.0)
    force_g: float = setting(0.05, "Specific force further than this from one g is manoeuvring.", unit="g", minimum=0.005, maximum=0.5)
    filter_s: float = setting(1.0, "Time constant of the low-pass before the switch.", unit="s", minimum=0.05, maximum=20.0)
    release: float = setting(0.7, "Share of the limits below which flight counts as steady again.", minimum=0.1, maximum=1.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class GpsAttitudeSettings:
    """Attitude from several GPS antennas: free of drift, and what teaches the gyro biases."""

    enabled: bool = setting(False, "Use GPS attitude in the full filter; the euler and quaternion filters always do.")
    sigma_scale: float = setting(1.0, "Factor on the receiver's stated sigma.", minimum=0.1, maximum=100.0)
    floor_deg: float = setting(0.05, "Smallest sigma believed.", unit="deg", minimum=0.001, maximum=10.0)
    timeout_s: float = setting(2.5, "No accepted attitude for this long is an outage.", unit="s", minimum=0.1, maximum=60.0)
    gate: GateSettings = group(GateSettings)


@dataclass(frozen=True)
class ConstantGainSettings:
    """Tuning of the constant-gain filters; the defaults are those flown (Gebre-Egziabher 2004, tables 4.2 and 4.4)."""

    gps_alpha: float = setting(0.2, "GPS attitude: factor on the gyro noise.", minimum=1e-3, maximum=1e3)
    gps_beta: float = setting(2e-4, "GPS attitude: driving noise of the gyro biases.", unit="deg/s/sqrt(s)", minimum=1e-9, maximum=1.0)
    gps_sigma_deg: float = setting(0.25, "GPS attitude: noise of each angle.", unit="deg", minimum=0.01, maximum=10.0)
    gps_period_s: float = setting(0.5, "GPS attitude: spacing the gain is made for; faster ones are skipped.", unit="s", minimum=0.05)
    level_alpha: float = setting(10.0, "Level and magnetic heading: factor on the gyro noise.", minimum=1e-3, maximum=1e3)
    level_beta: float = setting(1e-5, "Level and magnetic heading: factor on the gyro drift.", minimum=1e-9, maximum=1e3)
    level_sigma_deg: float = setting(0.06, "Noise of roll and pitch by accelerometers, 1 milli-g.", unit="deg", minimum=0.001, maximum=10.0)
    heading_sigma_deg: float = setting(0.8, "Noise of the magnetic heading.", unit="deg", minimum=0.01, maximum=30.0)
    level_period_s: float = setting(0.5, "Spacing of level and magnetic heading.", unit="s", minimum=0.05, maximum=10.0)
    gyro_sigma_dps: float = setting(0.05, "Gyro noise the gains are made for.", unit="deg/s/sqrt(Hz)", minimum=1e-6, maximum=10.0)
    drift_dps: float = setting(0.05, "Gyro drift the gains are made for.", unit="deg/s", minimum=1e-6, maximum=10.0)
    drift_tau_s: float = setting(1000.0, "Correlation time of that drift.", unit="s", minimum=1.0)


@dataclass(frozen=True)
class RateSwitchSettings:
    """Manoeuvre switch of the constant-gain filters: what it has beside the yaw rate, load, low-pass and release of ``level``."""

    tilt_rate_dps: float = setting(2.0, "Rolling or pitching faster than this is manoeuvring.", unit="deg/s", minimum=0.1, maximum=50.0)
    tilt_filter_s: float = setting(0.2, "Time constant of the low-pass of roll and pitch rate.", unit="s", minimum=0.01, maximum=10.0)
    hold_off_s: float = setting(1.0, "Flight must be quiet for this long before it counts as steady.", unit="s", minimum=0.0, maximum=60.0)


@dataclass(frozen=True)
class FirstAttitudeSettings:
    """How the first attitude is found."""

    window_s: float = setting(2.0, "Average the specific force this long.", unit="s", minimum=0.5, maximum=60.0)
    track_speed_mps: float = setting(10.0, "Above this GPS speed the track serves as heading.", unit="m/s", minimum=1.0, maximum=100.0)
    track_sigma_deg: float = setting(12.0, "Sigma of heading minus track (wind drift).", unit="deg", minimum=0.5, maximum=60.0)
    air_tilt_deg: float = setting(1.5, "Sigma of roll and pitch found with airspeed.", unit="deg", minimum=0.1, maximum=30.0)
    unaided_tilt_deg: float = setting(3.0, "Sigma of roll and pitch by accelerometers alone.", unit="deg", minimum=0.1, maximum=30.0)


@dataclass(frozen=True)
class AhrsSettings:
    """All settings of the attitude and heading reference."""

    filter: str = setting(FULL, "Which filter: full, or one with the constant gains of the source.", choices=FILTERS)
    horizon: HorizonSettings = group(HorizonSettings)
    imu: ImuSettings = group(ImuSettings)
    place: PlaceSettings = group(PlaceSettings)
    gps: GpsVelocitySettings = group(GpsVelocitySettings)
    magnetometer: MagnetometerCalibration = group(MagnetometerCalibration)
    magnetic: MagneticHeadingSettings = group(MagneticHeadingSettings)
    airflow: AirflowSettings = group(AirflowSettings)
    level: LevelSettings = group(LevelSettings)
    alignment: FirstAttitudeSettings = group(FirstAttitudeSettings)
    gps_attitude: GpsAttitudeSettings = group(GpsAttitudeSettings)
    constant_gain: ConstantGainSettings = group(ConstantGainSettings)
    rate_switch: RateSwitchSettings = group(RateSwitchSettings)
    failed_tilt_deg: float = setting(20.0, "Roll or pitch sigma beyond which the attitude counts as failed.", unit="deg", minimum=2.0)


def chosen_blocks(settings: AhrsSettings) -> list[Block]:
    """Blocks of the error state: inertial core, inertial sensor errors, slow heading error, wind and airflow.

    The wind is a random walk with the short-term growth of a Gauss-Markov process, so that a steady wind is no error to forget.
    """
    magnetic, air = settings.magnetic, settings.airflow
    blocks = [core_block(settings.imu), *bias_blocks(settings.imu)]
    if magnetic.enabled:
        blocks.append(gauss_markov("heading_bias", ["heading_bias_rad"], Kind.HEADING_BIAS, magnetic.bias_deg * DEGREE, magnetic.bias_tau_s))
    if air.enabled:
        growth = air.wind_mps * float(np.sqrt(2.0 / air.wind_tau_s))
        blocks += [
            random_walk("wind", ["wind_north_mps", "wind_east_mps"], Kind.WIND, air.wind_start_mps, growth),
            gauss_markov("updraught", ["wind_down_mps"], Kind.FREE, air.updraught_mps, air.updraught_tau_s),
            gauss_markov("airspeed_bias", ["airspeed_bias_mps"], Kind.AIRSPEED_BIAS, air.bias_mps, air.bias_tau_s),
            gauss_markov("sideslip", ["sideslip_rad"], Kind.FREE, air.sideslip_sigma_deg * DEGREE, air.sideslip_tau_s),
            gauss_markov("incidence", ["incidence_rad"], Kind.FREE, air.incidence_sigma_deg * DEGREE, air.incidence_tau_s),
        ]
    return blocks
