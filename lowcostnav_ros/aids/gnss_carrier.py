"""GPS code and carrier against a base on the ground: satellite and atmosphere cancel, and what is left is a carrier like any other."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids._carrier import CarrierAid, CarrierSettings, ResetSettings
from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.estimation.aiding import Sensor, each
from lowcostnav_ros.gnss.receiver_clock import CLOCKS


@dataclass(frozen=True)
class GnssCarrierSettings(CarrierSettings):
    """GPS code and carrier against a base."""

    code_sigma_m: float = setting(1.5, "Noise of a code.", unit="m", minimum=0.01, maximum=1000.0)
    oscillator: str = setting("compensated_crystal", "Receiver oscillator.", choices=tuple(CLOCKS))
    reset: ResetSettings = group(ResetSettings, code_updates=20)


class GnssCarrierAid(CarrierAid):
    """Code and carrier of satellites, whose places come with the epoch."""

    name, topic = "gnss_carrier", "gnss/carrier"

    def place_of(self, epoch: CarrierEpoch) -> tuple[np.ndarray, np.ndarray, list[tuple[int, str]]]:
        """Satellites, where the epoch says they are."""
        if epoch.pos_e is None:
            return np.zeros(0, np.int64), np.zeros((0, 3)), [(0, "no satellite positions")]
        placed = np.flatnonzero(epoch.pos_e.any(axis=1))
        return placed, epoch.pos_e[placed], []


GNSS_CARRIER = AIDS.register("gnss_carrier", Sensor("gnss_carrier", GnssCarrierSettings, each(GnssCarrierAid)), __name__)
