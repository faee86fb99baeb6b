"""The flights of the navigator's Monte Carlo: truth and measurements after the flight test of Gebre-Egziabher (2004), section 7.3.

Half an hour at 50 m/s: turns around a point 16 miles east and 6 miles north of the airport, three minutes each, then straight to the
airport.  Wind 8 m/s from the west plus a Gauss-Markov variation; the pilot corrects for it, so every flight follows about the same ground
track.  Sensor errors are those of table 6.1; the errors of the ranges come from the DME simulator.  Two stations 20 NM from the airport and
beyond it, (north +-16, east -12) NM: the thesis does not print theirs.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude, Measurement, SlantRange
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.units import DEGREE, NAUTICAL_MILE
from lowcostnav_ros.calibration.heading_error import HeadingErrorModel
from lowcostnav_ros.physics.earth import LocalFrame, displace
from lowcostnav_ros.physics.rotation import euler_to_quat, wrap
from lowcostnav_ros.physics.stochastic import GaussMarkov, initial_state, simulate
from lowcostnav_ros.radionav.geometry import range_and_direction
from lowcostnav_ros.radionav.stations import Station, StationTable
from lowcostnav_ros.reproduce.gebre.update_methods import Case
from lowcostnav_ros.sensors.dme import DmeSimulatorSettings, range_error

FLIGHT_S = 1800
TURNS_S = 1160
AIRSPEED_MPS = 50.0
RADIUS_M = AIRSPEED_MPS * 180.0 / (2.0 * math.pi)
MILE_M = 1609.344
CENTRE_M = np.array([6.0 * MILE_M, 16.0 * MILE_M])
MEAN_WIND_MPS = np.array([0.0, 8.0])
HEIGHT_M = 600.0
AIRPORT = LocalFrame(37.69 * DEGREE, -121.82 * DEGREE)
STATIONS_NM = {"NOR": (16.0, -12.0), "SOU": (-16.0, -12.0)}
START_NS = 1_000_000_000_000
SECOND_NS = 1_000_000_000
STEEPEST_TURN = 3.0 * DEGREE
"""Largest change of course in a second, rad."""

WIND = GaussMarkov(5.0, 400.0)
HEADING = HeadingErrorModel()
AIRSPEED = GaussMarkov(2.6, 400.0)


@dataclass(frozen=True, eq=False)
class Flight:
    """One flight second by second; row k of a rate holds from second k to k + 1.

    Attributes
    ----------
    place : ndarray, shape (n + 1, 3)
        True lat, lon [rad], height [m].
    wind_n : ndarray, shape (n, 2)
        True wind, m/s.
    heading, airspeed : ndarray, shape (n,)
        As measured, rad and m/s.
    flown_m : ndarray, shape (n + 1,)
        Distance over ground.
    seed : int
    """

    place: np.ndarray
    wind_n: np.ndarray
    heading: np.ndarray
    airspeed: np.ndarray
    flown_m: np.ndarray
    seed: int

    def air_n(self) -> np.ndarray:
        """Air-relative velocity as measured, resolved in n, shape (n, 3)."""
        level = np.zeros_like(self.heading)
        return np.column_stack((self.airspeed * np.cos(self.heading), self.airspeed * np.sin(self.heading), level))


def fly(seed: int) -> Flight:
    """Fly one flight; everything random comes from ``seed``."""
    rng = stream(seed, "flight")
    wind_n = MEAN_WIND_MPS + _drawn(WIND, rng, 2)
    heading = _drawn(HEADING.slow, rng)[:, 0] + HEADING.white_sigma * rng.standard_normal(FLIGHT_S)
    airspeed = AIRSPEED_MPS + _drawn(AIRSPEED, rng)[:, 0]
    lat, lon, _ = AIRPORT.from_ned(np.array([*CENTRE_M, 0.0]) + np.array([RADIUS_M, 0.0, 0.0]))
    start = np.array([float(lat), float(lon), HEIGHT_M])
    place, true_heading, flown_m = ground_track(start, AIRPORT.lat, AIRPORT.lon, wind_n, CENTRE_M, RADIUS_M, AIRSPEED_MPS, TURNS_S)
    return Flight(place, wind_n, wrap_all(true_heading + heading), airspeed, flown_m, seed)


def _drawn(process: GaussMarkov, rng: np.random.Generator, axes: int = 1) -> np.ndarray:
    return simulate(process, 1.0, FLIGHT_S, rng, initial_state(process, rng, axes))[0]


@kernel
def wrap_all(angles):
    """Angles brought to -pi ... pi."""
    out = np.empty_like(angles)
    for i in range(angles.shape[0]):
        out[i] = wrap(angles[i])
    return out


@kernel
def ground_track(start, airport_lat, airport_lon, wind_n, centre_m, radius_m, airspeed, turns_s):
    """Turns around a point to the right, then straight to the airport, the heading held into the wind second by second.

    Returns the places (n + 1, 3), true headings (n,) and distances flown (n + 1,).
    """
    n = wind_n.shape[0]
    place, heading, flown = np.empty((n + 1, 3)), np.empty(n), np.zeros(n + 1)
    place[0] = start
    course, arrived = 0.5 * math.pi, False
    per_north, per_east = 6.36e6, 6.378e6 * math.cos(airport_lat)  # the pilot's map; truth moves on the ellipsoid
    for k in range(n):
        north, east = (place[k, 0] - airport_lat) * per_north, (place[k, 1] - airport_lon) * per_east
        arrived = arrived or (k >= turns_s and math.hypot(north, east) < 1000.0)
        if k < turns_s:
            out_n, out_e = north - centre_m[0], east - centre_m[1]
            wanted = math.atan2(out_e, out_n) + 0.5 * math.pi + math.atan(2.0 * (math.hypot(out_n, out_e) / radius_m - 1.0))
        else:
            wanted = course if arrived else math.atan2(-east, -north)
        course += min(max(wrap(wanted - course), -STEEPEST_TURN), STEEPEST_TURN)
        across = -wind_n[k, 0] * math.sin(course) + wind_n[k, 1] * math.cos(course)
        heading[k] = course - math.asin(across / airspeed)
        step = np.array([airspeed * math.cos(heading[k]) + wind_n[k, 0], airspeed * math.sin(heading[k]) + wind_n[k, 1], 0.0])
        place[k + 1, 0], place[k + 1, 1], place[k + 1, 2] = displace(place[k, 0], place[k, 1], place[k, 2], step)
        flown[k + 1] = flown[k] + math.hypot(step[0], step[1])
    return place, heading, flown


def stations() -> StationTable:
    """The two DME stations of the flights."""
    table = []
    for ident, (north_nm, east_nm) in STATIONS_NM.items():
        lat, lon, _ = AIRPORT.from_ned(NAUTICAL_MILE * np.array([north_nm, east_nm, 0.0]))
        table.append(Station(ident, ident, float(lat), float(lon), 0.0, 0.0, "86X", "H"))
    return StationTable(table)


def ranges(flight: Flight, case: Case, table: StationTable) -> list[SlantRange]:
    """Slant ranges of an update method along a flight.

    The errors are those of the DME simulator, drawn every second for every station, so all methods meet the same range biases.
    """
    distance_m = case.bias_distance_nm * NAUTICAL_MILE
    settings = DmeSimulatorSettings(seed=flight.seed % 2**31, correlation_distance_m=distance_m)
    variance = settings.drift_m**2 + settings.noise_m**2
    errors = {station.ident: range_error(settings, station.ident) for station in table}
    listed, out = list(table), []
    for second in range(1, FLIGHT_S + 1):
        error_m = {ident: error.draw(flight.flown_m[second]) for ident, error in errors.items()}
        for k in case.asked(second):
            station = listed[k]
            lat, lon, height = flight.place[second]
            true_m, _ = range_and_direction(lat, lon, height, station.lat, station.lon, station.height)
            measured_m = true_m + error_m[station.ident]
            out.append(SlantRange(START_NS + second * SECOND_NS, "dme/range", station.ident, measured_m, variance))
    return out


def air_measurements(flight: Flight) -> list[Measurement]:
    """Attitude and air-relative velocity of every second, level, as an AHRS and air data would hand them over."""
    cov_att, cov_b = 1e-4 * np.eye(3), np.diag([0.25, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
    out: list[Measurement] = []
    for k, (heading, airspeed) in enumerate(zip(flight.heading, flight.airspeed, strict=True)):
        stamp_ns = START_NS + k * SECOND_NS
        q_nb = euler_to_quat(0.0, 0.0, heading)
        out.append(Attitude(stamp_ns, "imu/data_fused", q_nb, cov_att, np.zeros(3), np.array([0.0, 0.0, -9.8])))
        out.append(AirVelocity(stamp_ns, "air/velocity", np.array([airspeed, 0.0, 0.0]), cov_b))
    return out
