"""Settings of the GPS and air data navigator that are no sensor's."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.air_corrections import AirCorrectionsSettings
from lowcostnav_ros.navigators.base import HorizonSettings


@dataclass(frozen=True)
class CascadeSettings:
    """The filter of position and velocity of the cascade (filter: multirate or fixed_gain)."""

    air_mps: float = setting(0.25, "Sigma of the corrected air-data velocity in it.", unit="m/s", minimum=1e-3, maximum=20.0)
    position_mps: float = setting(0.23, "Sigma of GPS velocity in it.", unit="m/s", minimum=1e-3, maximum=20.0)
    gps_m: float = setting(2.26, "Sigma of GPS position in it.", unit="m", minimum=0.01, maximum=100.0)
    velocity_step_mps: float = setting(0.28, "Change of velocity within a step, sigma.", unit="m/s", minimum=1e-4, maximum=20.0)
    position_step_m: float = setting(0.0068, "Change of position beyond that, sigma.", unit="m", minimum=1e-6, maximum=10.0)
    step_s: float = setting(0.02, "Its step.", unit="s", minimum=0.001, maximum=1.0)
    gps_steps: int = setting(4, "Steps from one GPS output to the next.", minimum=1, maximum=100)
    error_tau_s: float = setting(1.0, "Correlation time of the error of the air-data velocity.", unit="s", minimum=0.01, maximum=100.0)


@dataclass(frozen=True)
class AirDataGpsOwnSettings(AirCorrectionsSettings):
    """Settings of the GPS and air data navigator that are no sensor's."""

    attitude_topic: str = setting("imu/data_fused", "Topic of the attitude: any AHRS, or hars/attitude.")
    heading_reference: str = setting("true", "What its heading counts from.", choices=("true", "magnetic"))
    variation_deg: float = setting(
        999.0, "Magnetic variation, east positive; 999 takes it from the magnetic model.", unit="deg", minimum=-180.0, maximum=999.0
    )
    filter: str = setting(
        "joint",
        "joint: position among the corrections; multirate, fixed_gain: the thesis's cascade of two filters.",
        choices=("joint", "multirate", "fixed_gain"),
    )
    bump_m: float = setting(1.0, "Position sigma added when the satellites change.", unit="m", minimum=0.0, maximum=100.0)
    straight_s: float = setting(
        30.0, "After straight flight this long all corrections but the wind are held; 0 never.", unit="s", minimum=0.0, maximum=3600.0
    )
    alert_nm: float = setting(0.5, "Estimated horizontal sigma above which an alert is raised.", unit="NM", minimum=0.01, maximum=100.0)
    cascade: CascadeSettings = group(CascadeSettings)
    horizon: HorizonSettings = group(HorizonSettings, lag_s=0.25, output_period_s=0.02)  # as of dead reckoning
