"""Faults of satellite navigation: spoofing, covariances that cannot be, satellites that lie."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity, Measurement
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.simulation.fault import Change, Fault, each, enter

RECEIVER, RAW = ("gps/fix", "gps/vel"), ("gnss/raw",)


def spoofed(rate_n: tuple[float, float, float], ramp_s: float) -> Change:
    """A false place that moves off at a rate (m/s NED), reached within ``ramp_s``, with the velocity that belongs to it."""
    rate = np.array(rate_n)

    def change(m: Measurement, t_s: float) -> Measurement:
        if isinstance(m, GpsVelocity):
            return replace(m, vel_n=m.vel_n + rate * min(1.0, t_s / ramp_s))
        if isinstance(m, GpsPosition):
            moved = rate * (0.5 * t_s**2 / ramp_s if t_s < ramp_s else t_s - 0.5 * ramp_s)
            lat, lon, height = displace(m.lat, m.lon, m.height, moved)
            return replace(m, lat=lat, lon=lon, height=height)
        return m

    return each(change)


def moved(by_n: tuple[float, float, float]) -> Change:
    """A fix at another place."""

    def change(m: Measurement, t_s: float) -> Measurement:
        if not isinstance(m, GpsPosition):
            return m
        lat, lon, height = displace(m.lat, m.lon, m.height, np.array(by_n))
        return replace(m, lat=lat, lon=lon, height=height)

    return each(change)


def first(change: Change) -> Change:
    """A change of the first message alone."""
    return lambda window: [*change(replace(window, arrived=window.arrived[:1])), *window.arrived[1:]]


def covariance(how: Callable[[np.ndarray], np.ndarray]) -> Change:
    """A fix or velocity with another covariance."""
    return each(lambda m, t_s: replace(m, cov_n=how(m.cov_n)) if isinstance(m, GpsPosition | GpsVelocity) else m)


def satellites(how: Callable[[GnssEpoch, float], dict[str, Any]]) -> Change:
    """An epoch with other columns."""
    return each(lambda m, t_s: replace(m, **how(m, t_s)) if isinstance(m, GnssEpoch) else m)


def one(epoch: GnssEpoch) -> np.ndarray:
    """One for the satellite of the lowest number, zero for the others, shape (n,)."""
    return (epoch.sat_id == epoch.sat_id.min(initial=99)).astype(float)


for _rate in (0.5, 2.0, 10.0):
    enter(
        __name__,
        Fault(f"gps_spoofed_{_rate:g}_mps", "a spoofer that walks off, velocity and all", RECEIVER, spoofed((_rate, 0.0, 0.0), 10.0)),
    )
enter(__name__, Fault("gps_fix_jump_5_km", "a fix of another place", ("gps/fix",), moved((3000.0, 4000.0, 0.0))))
enter(__name__, Fault("gps_fix_height_jump", "a fix without satellites in the west", ("gps/fix",), moved((0.0, 0.0, -200.0))))

RANK_ONE = np.ones((3, 3))
for _name, _imitates, _how in (
    ("sigma_1_nm", "a standard deviation of a nanometre", lambda cov: 1e-18 * np.eye(3)),
    ("rank_one", "a covariance with correlations of one", lambda cov: 4.0 * RANK_ONE),
    ("overconfident", "a receiver that states a tenth of its error", lambda cov: 0.01 * cov),
    ("huge", "a covariance of a billion", lambda cov: 1e9 * np.eye(3)),
):
    enter(__name__, Fault(f"gps_fix_{_name}", _imitates, ("gps/fix",), covariance(_how)))
    enter(__name__, Fault(f"gps_vel_{_name}", _imitates, ("gps/vel",), covariance(_how)))
    enter(__name__, Fault(f"gps_fix_{_name}_once", _imitates, ("gps/fix",), first(covariance(_how))))

for _name, _imitates, _columns in (
    ("satellite_ramp", "the clock of one satellite runs away, 0.5 m/s", lambda e, t: {"pseudorange_m": e.pseudorange_m + 0.5 * t * one(e)}),
    ("satellite_jump", "one satellite by reflection", lambda e, t: {"pseudorange_m": e.pseudorange_m + 100.0 * one(e)}),
    ("half_jump", "half of the satellites a kilometre off", lambda e, t: {"pseudorange_m": e.pseudorange_m + 1000.0 * (e.sat_id % 2)}),
    ("sigma_1_nm", "a standard deviation of a nanometre", lambda e, t: {"sigma_m": 0.0 * e.sigma_m + 1e-9}),
    ("swapped", "the ranges of two satellites exchanged", lambda e, t: {"pseudorange_m": np.roll(e.pseudorange_m, 1)}),
):
    enter(__name__, Fault(f"gnss_{_name}", _imitates, RAW, satellites(_columns)))
