"""Settings of the MEMS navigator that are no sensor's."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.calibration.reference_rest import GRAVITY_POSITIVE, SPECIFIC_FORCE
from lowcostnav_ros.cores.carried import CarriedSettings
from lowcostnav_ros.navigators.base import HorizonSettings

AUTO, AS_PRINTED = "auto", "as_printed"
JOINT, CASCADE = "joint", "cascade"


@dataclass(frozen=True)
class MemsInsOwnSettings:
    """Settings of the MEMS navigator that are no sensor's."""

    attitude_topic: str = setting("imu/data_fused", "Topic of the reference: attitude, rates and accelerations.")
    accel_sign: str = setting(
        AUTO,
        "What its accelerometers give at rest on the down axis: -1 g, +1 g, determined at rest, or +1 g taken for the motion as printed.",
        choices=(AUTO, SPECIFIC_FORCE, GRAVITY_POSITIVE, AS_PRINTED),
    )
    filter: str = setting(
        JOINT, "joint: position, velocity and errors of the reference; cascade: the thesis's two filters.", choices=(JOINT, CASCADE)
    )
    told_s: float = setting(2.0, "The sign of the accelerometers is decided in this time.", unit="s", minimum=0.1, maximum=600.0)
    coast_limit_m: float = setting(100.0, "Without GPS, the time until the position is worse is reported.", unit="m", minimum=1.0)
    lag_limit_s: float = setting(1.0, "GPS that comes later after the newest stamp is named.", unit="s", minimum=0.05, maximum=60.0)
    alert_nm: float = setting(0.5, "Estimated horizontal sigma above which an alert is raised.", unit="NM", minimum=0.01, maximum=100.0)
    reference: CarriedSettings = group(CarriedSettings)
    horizon: HorizonSettings = group(HorizonSettings, lag_s=0.25)

    def __post_init__(self) -> None:
        if self.accel_sign == AS_PRINTED and self.filter != CASCADE:
            raise SettingsError("'accel_sign' as_printed is of the thesis's cascade; set 'filter' to cascade, or change the sign.")
