"""Settings of the attitude and heading reference that are no sensor's."""

from dataclasses import dataclass

from lowcostnav_ros.aids._constant_gain import ConstantGainSettings
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerCalibration
from lowcostnav_ros.cores.imu_errors import ImuSettings
from lowcostnav_ros.estimation.manoeuvre import RateSwitchSettings
from lowcostnav_ros.navigators.ahrs.constant_gain import EulerFilter, QuaternionFilter, SwitchedFilter, VectorMatchingFilter, WahbaFilter
from lowcostnav_ros.navigators.ahrs.filter import Filter
from lowcostnav_ros.navigators.ahrs.full import FullFilter
from lowcostnav_ros.navigators.base import HorizonSettings
from lowcostnav_ros.starts.attitude_core import PlaceSettings
from lowcostnav_ros.starts.first_attitude import FirstAttitudeSettings

FILTERS: dict[str, type[Filter]] = {
    "full": FullFilter,
    "euler": EulerFilter,
    "quaternion": QuaternionFilter,
    "vector_matching": VectorMatchingFilter,
    "wahba": WahbaFilter,
    "switched": SwitchedFilter,
}
"""Values of ``filter``."""


@dataclass(frozen=True)
class AhrsOwnSettings:
    """Settings of the attitude and heading reference that are no sensor's."""

    filter: str = setting("full", "Which filter: full, or one with the constant gains of the source.", choices=tuple(FILTERS))
    horizon: HorizonSettings = group(HorizonSettings)
    imu: ImuSettings = group(ImuSettings)
    place: PlaceSettings = group(PlaceSettings)
    magnetometer: MagnetometerCalibration = group(MagnetometerCalibration)
    alignment: FirstAttitudeSettings = group(FirstAttitudeSettings)
    constant_gain: ConstantGainSettings = group(ConstantGainSettings)
    rate_switch: RateSwitchSettings = group(RateSwitchSettings)
    failed_tilt_deg: float = setting(20.0, "Roll or pitch sigma beyond which the attitude counts as failed.", unit="deg", minimum=2.0)
