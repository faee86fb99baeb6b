"""Settings of the dead-reckoning navigator that are no sensor's."""

import math
from dataclasses import dataclass
from typing import Any

from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.cores.reckoning import ReckoningSettings
from lowcostnav_ros.navigators.base import HorizonSettings

BARO_DRIFT_M, BARO_TAU_S = 23.0, 400.0
"""Change of pressure altitude minus height, and the time in which it happens."""
THESIS_SPEED_MPS = 46.3
"""90 kt, to which the correlation times of Gebre-Egziabher's table 6.1 belong."""


def baro_walk(drift_m: float = BARO_DRIFT_M, tau_s: float = BARO_TAU_S) -> float:
    """Growth, m/sqrt(s), of a random walk that starts like a Gauss-Markov process of this sigma and correlation time."""
    return drift_m * math.sqrt(2.0 / tau_s)


@dataclass(frozen=True)
class DeadReckoningOwnSettings(ReckoningSettings):
    """Settings of the dead-reckoning navigator that are no sensor's."""

    attitude_topic: str = setting("imu/data_fused", "Topic the attitude is taken from.")
    alert_nm: float = setting(0.5, "Estimated horizontal sigma above which an alert is raised.", unit="NM", minimum=0.01, maximum=100.0)
    horizon: HorizonSettings = group(HorizonSettings, lag_s=0.25)  # the fused attitude of the AHRS arrives one lag of its own later

    @staticmethod
    def upgraded(flat: dict[str, Any]) -> dict[str, Any]:
        """Names of today for those of recordings in which the barometer belonged to the height, or turbulence and wind varied with time."""
        flat = _with_turbulence_along_the_way(flat)
        old = {name: flat[f"height.baro_{name}"] for name in ("bias_m", "noise_m", "drift_m", "tau_s") if f"height.baro_{name}" in flat}
        if not old:
            return flat
        new = {"baro.bias_m": old.get("bias_m"), "baro.sigma_m": old.get("noise_m")}
        if old.keys() & {"drift_m", "tau_s"}:
            try:
                new["baro.walk_m_rts"] = baro_walk(old.get("drift_m", BARO_DRIFT_M), old.get("tau_s", BARO_TAU_S))
            except (TypeError, ValueError, ZeroDivisionError):
                raise SettingsError("'height.baro_drift_m' and 'height.baro_tau_s' must be numbers, the latter above 0.") from None
        new |= {f"baro.gate.{name}": flat.get(f"gps.gate.{name}") for name in ("probability", "recovery_s")}
        kept = {name: value for name, value in flat.items() if not name.startswith("height.baro_")}
        return {name: value for name, value in new.items() if value is not None} | kept


def _with_turbulence_along_the_way(flat: dict[str, Any]) -> dict[str, Any]:
    """Settings of recordings in which turbulence had a correlation time: they fly as they were set, nothing is learned."""
    if "wind.gust_tau_s" not in flat:
        return flat
    kept = {name: value for name, value in flat.items() if name != "wind.gust_tau_s"}
    tau_s = flat["wind.gust_tau_s"]
    if isinstance(tau_s, bool) or not isinstance(tau_s, int | float):
        raise SettingsError("'wind.gust_tau_s' must be a number; today it is 'wind.gust_distance_m', the way flown in that time.")
    gust_m = min(max(tau_s * THESIS_SPEED_MPS, 1.0), 1e5)
    return {"wind.distance_km": 0.0, "wind.gust_distance_m": gust_m, "learn_s": 0.0, "heading.bank_deg": 0.0} | kept
