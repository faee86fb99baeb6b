"""Flights that the thesis did not make: two-way ranging beacons, GPS carrier against a base, over the same network of settings."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.catalogue.equipment import load_imu_profile, load_stations
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.navigators.pseudolite_ins import PseudoliteIns
from lowcostnav_ros.reproduce.kawecki.flights import first_state, truth_of
from lowcostnav_ros.reproduce.solimeno.flights import Flight, fed, flight_of, imu_of
from lowcostnav_ros.sensors.gnss_carrier import GnssCarrierSimulator, GnssCarrierSimulatorSettings
from lowcostnav_ros.sensors.ranging import RangingSimulator, RangingSimulatorSettings


@dataclass(frozen=True)
class OtherCase:
    """``sensor``: ``ranging`` or ``gnss_carrier``; ``profile`` of the inertial unit; ``rate_hz`` of the ranges; the first position is
    known to ``start_m``."""

    sensor: str = "ranging"
    seed: int = 1
    profile: str = "automotive"
    rate_hz: float = 2.0
    beacons: int = 4
    start_m: float = 3.0
    duration_s: float = 820.0


def fly_other(case: OtherCase) -> Flight:
    """Fly a case: no GPS fix at any time, the first velocity and attitude known to 0.3 m/s, 0.5 deg and, in heading, 2 deg."""
    truth, profile, table = truth_of(case.duration_s), load_imu_profile(case.profile), load_stations("beacons_range.csv")
    values: dict[str, Any] = {"horizon.lag_s": 0.0, "gps.latency_s": 0.0, "pseudolite.enabled": False}
    values["aids"] = ["gps", "pseudolite", case.sensor]
    settings: Any = replace(from_mapping(PseudoliteIns.Settings, values), imu=imu_settings(profile.filter_noise()))
    if case.sensor == "ranging":
        some = type(table)(list(table)[: case.beacons])
        measured: list = RangingSimulator(RangingSimulatorSettings(seed=case.seed, rate_hz=case.rate_hz), some).simulate(truth)
    else:
        measured = GnssCarrierSimulator(GnssCarrierSimulatorSettings(seed=case.seed)).simulate(truth)
    navigator = PseudoliteIns(settings, table)
    sigma = np.array([case.start_m] * 3 + [0.3] * 3 + np.radians([0.5, 0.5, 2.0]).tolist())
    off = sigma * np.random.default_rng(case.seed).standard_normal(9)
    navigator.begin(int(truth.stamps_ns[0]), first_state(truth, off), np.diag(sigma**2))
    return flight_of(truth, fed(navigator, imu_of(profile, truth, case.seed), measured))
