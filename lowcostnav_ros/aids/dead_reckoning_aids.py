"""Aids of the dead-reckoning navigator: GPS position and velocity that teach, pressure altitude and DME ranges that remain."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, Pressure, SlantRange
from lowcostnav_ros.cores.reckoning import SLOWEST_MPS
from lowcostnav_ros.cores.reckoning_model import NM, POS
from lowcostnav_ros.cores.reckoning_settings import DmeSettings, GpsSettings, HeightSettings, WindSettings
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, GateSettings, Innovation
from lowcostnav_ros.physics.atmosphere import pressure_altitude
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.stochastic import correlation_factor
from lowcostnav_ros.radionav.geometry import range_and_direction
from lowcostnav_ros.radionav.stations import StationTable

FAR_BEYOND = 9.0
"""Test ratio (three times the gate in sigmas) above which even the last aid left is rejected, not limited."""


class GpsPositionAid(Aid):
    """GPS position, all three axes; after a long run of rejections the position starts over and the wind stays."""

    def __init__(self, settings: GpsSettings) -> None:
        super().__init__("gps_position", ("north_m", "east_m", "down_m"), settings.gate)
        self.settings = settings

    def noise(self, fix: GpsPosition) -> np.ndarray:
        """Covariance (3, 3) of one fix with the floor on its variances, m^2."""
        return fix.cov_n + np.diag(np.maximum(self.settings.position_floor_m**2 - np.diag(fix.cov_n), 0.0))

    def innovation(self, measurement: GpsPosition, host: Any) -> Innovation | str:
        y = difference_n(measurement.lat, measurement.lon, measurement.height, *host.state.nav)
        H = np.zeros((3, host.state.layout.size))
        H[:, POS] = np.eye(3)
        factor = correlation_factor(since_s(self, measurement), self.settings.correlation_s)
        return Innovation(y, H, factor * self.noise(measurement), y.copy())

    def recover(self, measurement: GpsPosition, innovation: Innovation, host: Any) -> None:
        """Put the position on the fix and forget its correlations: what was learned of wind and sensors is not kicked."""
        dx = np.zeros(host.state.layout.size)
        dx[POS] = innovation.y
        kalman.reset_block(host.P, POS, self.noise(measurement))
        host.correct(dx)


class GpsVelocityAid(Aid):
    """GPS velocity: teaches wind, heading bias and airspeed errors while it lasts."""

    def __init__(self, settings: GpsSettings, wind: WindSettings) -> None:
        super().__init__("gps_velocity", ("north_mps", "east_mps", "down_mps"), settings.gate)
        self.settings, self.wind = settings, wind

    def innovation(self, measurement: GpsVelocity, host: Any) -> Innovation | str:
        if not host.held.airborne:
            return "below the minimum airspeed"
        silent = host.state.silent(host.held)
        if silent:
            return silent
        velocity, H = host.state.velocity(host.held)
        floor = np.maximum(self.settings.velocity_floor_mps**2 - np.diag(measurement.cov_n), 0.0)
        tau_s = max(self.settings.correlation_s, self.wind.gust_tau_s)
        R = measurement.cov_n + np.diag(floor) + host.state.velocity_noise(host.held)
        return Innovation(measurement.vel_n - velocity, H, correlation_factor(since_s(self, measurement), tau_s) * R, measurement.vel_n)


class BaroAid(Aid):
    """Pressure altitude: height plus a bias that GPS teaches."""

    def __init__(self, settings: HeightSettings, gate: GateSettings) -> None:
        super().__init__("baro", ("pressure_altitude_m",), gate)
        self.settings = settings

    def innovation(self, measurement: Pressure, host: Any) -> Innovation | str:
        altitude = float(pressure_altitude(measurement.pressure_pa))
        slope = float(pressure_altitude(measurement.pressure_pa + 1.0)) - altitude
        index = host.state.layout["baro_bias"].start
        H = np.zeros((1, host.state.layout.size))
        H[0, 2], H[0, index] = -1.0, 1.0
        variance = max(slope * slope * measurement.variance, self.settings.baro_noise_m**2)
        y = altitude - (host.state.nav[2] + host.state.estimate[index])
        return Innovation(np.array([y]), H, np.array([[variance]]), np.array([altitude]))


class DmeAid(Aid):
    """One slant range at a time, in full geometry; it never moves height.

    The variance of a reply is that of its whole error; what the bias model explains of it is not counted twice.  Where the bias is no state
    it is noise, of which replies of one station in quick succession repeat the same draw.
    While DME is all there is, a range outside the gate is limited to the gate rather than rejected, unless it lies far beyond.
    """

    def __init__(self, settings: DmeSettings, stations: StationTable | None) -> None:
        super().__init__("dme", ("slant_range_m",), settings.gate)
        self.settings, self.stations = settings, stations
        self._used_ns: dict[str, int] = {}

    def innovation(self, measurement: SlantRange, host: Any) -> Innovation | str:
        if self.stations is None:
            return "no station table"
        if measurement.station not in self.stations:
            return f"station unknown ({measurement.station})"
        station = self.stations[measurement.station]
        if not station.has_dme:
            return "station has no DME"
        predicted, direction = range_and_direction(*host.state.nav, station.lat, station.lon, station.height)
        if predicted <= 0.0:
            return "over the station"
        H = np.zeros((1, host.state.layout.size))
        H[0, POS] = direction
        slow = (self.settings.bias_nm * NM) ** 2
        R = max(measurement.variance - slow, (self.settings.noise_nm * NM) ** 2) + _curvature(host.P, direction, predicted)
        bias = host.state.range_bias_index(measurement.station)
        if bias is None:
            R += slow * self._repetition(measurement, host.held.speed)
        else:
            H[0, bias] = 1.0
            predicted += host.state.estimate[bias]
        y = np.array([measurement.range_m - predicted])
        return Innovation(y, H, np.array([[R]]), np.array([measurement.range_m]), host.state.free_for_ranges)

    def process(self, measurement: SlantRange, host: Any) -> bool:
        used = super().process(measurement, host)
        if used:
            self._used_ns[measurement.station] = measurement.stamp_ns
        return used

    def _repetition(self, measurement: SlantRange, speed_mps: float) -> float:
        """Factor on the variance of a range bias that is not a state, for the time since the station's last reply."""
        last_ns = self._used_ns.get(measurement.station)
        if last_ns is None:
            return 1.0
        tau_s = self.settings.bias_distance_nm * NM / max(speed_mps, SLOWEST_MPS)
        return correlation_factor(1e-9 * (measurement.stamp_ns - last_ns), tau_s)

    def control(self, stamp_ns: int, test_ratio: float, host: Any) -> tuple[Decision, str]:
        self.limit_instead_of_reject = test_ratio < FAR_BEYOND and not host.gps_good()
        return super().control(stamp_ns, test_ratio, host)


def since_s(aid: Aid, measurement: Any) -> float:
    """Seconds since an aid last used a measurement, ``inf`` before the first."""
    age = aid.status.age_s(measurement.stamp_ns)
    return math.inf if age is None else age


def _curvature(P: np.ndarray, direction: np.ndarray, range_m: float) -> float:
    """Variance, m^2, that the curvature of the range circle adds when position is known poorly against the range."""
    across = np.array([-direction[1], direction[0]])
    variance = float(across @ P[0:2, 0:2] @ across)
    return 0.75 * (variance / range_m) ** 2  # mean square of d^2 / (2 R) for a Gaussian cross-range error d
