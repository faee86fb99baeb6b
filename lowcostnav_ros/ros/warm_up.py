"""Fly a navigator through half a minute in memory before its node is ready.

Loading a compiled kernel takes tens of milliseconds, compiling one seconds.  That time is spent here, on a navigator that is thrown away,
rather than in the air at the first GPS fix.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.gnss.constellation import gps_24
from lowcostnav_ros.gnss.observables import range_and_rate
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.encode import imu_from_solution, odometry_from_solution
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, dcm_ne, displace, geodetic_to_ecef

if TYPE_CHECKING:
    from lowcostnav_ros.navigators.base import Navigator

FLIGHT_S, STEP_S, SAMPLES = 30, 0.2, 20
SPEED = 50.0
LYING_S, LIE_M = 5.0, 1000.0
PLACE = (0.6578, -2.1262, 500.0)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
EYE = np.eye(3)


def warm_up(navigator: "Navigator") -> int:
    """Feed a straight and level flight to a navigator; return how many fused solutions came out.

    Whatever it makes of the flight is not judged: the point is that every kernel on its way has run once.
    """
    solutions = []
    for measurement in straight_flight(list(navigator.inputs)):
        solutions += navigator.feed(measurement)
        navigator.output()
    if solutions:
        _encode(solutions[-1], navigator)
    return len(solutions)


def straight_flight(sources: list[str]) -> Iterator[m.Measurement]:
    """Yield thirty seconds of noise-free level flight to the north, on the given sources."""
    for step in range(round(FLIGHT_S / STEP_S)):
        stamp_ns = 10**18 + round(1e9 * STEP_S) * (step + 1)
        lat, lon, height = (float(x) for x in displace(*PLACE, np.array([SPEED * STEP_S * step, 0.0, 0.0])))
        for source in sources:
            measurement = _measurement(source, stamp_ns, lat, lon, height)
            if measurement is not None:
                yield measurement


def _measurement(source: str, stamp_ns: int, lat: float, lon: float, height: float) -> m.Measurement | None:
    force, still = np.array([0.0, 0.0, -STANDARD_GRAVITY]), np.zeros(3)
    velocity = np.array([SPEED, 0.0, 0.0])
    try:
        kind = topics.spec(source).msgtype
    except ValueError:
        return None
    if source == "imu/data_raw":
        stamps = stamp_ns - round(1e9 * STEP_S / SAMPLES) * np.arange(SAMPLES)[::-1]
        return m.ImuBlock.of(source, stamps, np.tile(force, (SAMPLES, 1)), np.zeros((SAMPLES, 3)))
    if kind == topics.IMU:
        return m.Attitude(stamp_ns, source, LEVEL, 1e-4 * EYE, still, force)
    if kind == topics.ODOMETRY:
        covariances = {"cov_pos": EYE, "cov_vel": EYE, "cov_att": 1e-4 * EYE}
        return m.NavSolution(stamp_ns, source, lat, lon, height, velocity, LEVEL, still, force, **covariances, mode=Mode.GPS)
    simple = {
        "gps/fix": lambda: m.GpsPosition(stamp_ns, source, lat, lon, height, 4.0 * EYE),
        "gps/vel": lambda: m.GpsVelocity(stamp_ns, source, velocity, 0.01 * EYE),
        "imu/mag": lambda: m.MagneticField(stamp_ns, source, np.array([2.2e-5, 0.5e-5, 4.2e-5]), 1e-14 * EYE),
        "air/velocity": lambda: m.AirVelocity(stamp_ns, source, velocity, np.diag([4.0, 1e6, 1e6])),
        "air/static_pressure": lambda: m.Pressure(stamp_ns, source, 95_460.0, 100.0),
        "air/dynamic_pressure": lambda: m.Pressure(stamp_ns, source, 1_450.0, 100.0),
        "air/temperature": lambda: m.AirTemperature(stamp_ns, source, 285.0, 1.0),
        "gnss/raw": lambda: _epoch(stamp_ns, source, lat, lon, height, velocity),
        "dme/range": lambda: m.SlantRange(stamp_ns, source, "OAK", 40_000.0, 1.0e5),
        "vor/bearing": lambda: m.VorBearing(stamp_ns, source, "OAK", 1.0, 3.0e-4),
    }
    return simple[source]() if source in simple else None


def _epoch(stamp_ns: int, source: str, lat: float, lon: float, height: float, vel_n: np.ndarray) -> m.GnssEpoch:
    """Noise-free observations of the simulated satellites in view; the first one lies in the last seconds, to be found and left out."""
    place_e, velocity_e = geodetic_to_ecef(lat, lon, height), dcm_ne(lat, lon).T @ vel_n
    constellation = gps_24()
    sat_pos, sat_vel = constellation.states(1e-9 * (stamp_ns - 10**18))
    ranges, rates, los = range_and_rate(place_e, velocity_e, sat_pos, sat_vel)
    seen = los @ place_e > 0.1 * np.linalg.norm(place_e)
    ranges[np.flatnonzero(seen)[0]] += LIE_M if stamp_ns - 10**18 > 1e9 * (FLIGHT_S - LYING_S) else 0.0
    n = int(np.count_nonzero(seen))
    columns = ranges[seen], rates[seen], np.full(n, 5.0), np.full(n, 0.2), np.zeros(n), sat_pos[seen], sat_vel[seen]
    return m.GnssEpoch(
        stamp_ns, source, constellation.system[seen], constellation.sat_id[seen], *columns, np.ones(n, bool), np.ones(n, bool)
    )


def _encode(solution: m.NavSolution, navigator: "Navigator") -> None:
    if navigator.origin is not None and solution.lat is not None:
        to_cdr(odometry_from_solution(solution, navigator.origin))
    elif solution.q_nb is not None:
        to_cdr(imu_from_solution(solution))
