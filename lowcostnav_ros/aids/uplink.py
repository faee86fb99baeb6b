"""What the ground can send a dead reckoner up a data link: radar fixes and the wind (Gebre-Egziabher 2004, sections 6.2 and 8.2).

Both come as any navigator's messages do, a fix and a wind, and are off until their topic is set.  A stamp says when the value held; what
comes later than the fusion horizon allows is dropped by name, so the ground carries a fix on to the time of sending.
"""

from typing import Any

import numpy as np

from lowcostnav_ros.aids.dead_reckoning_aids import since_s
from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.cores.reckoning_settings import RadarSettings, WindUplinkSettings
from lowcostnav_ros.estimation.aiding import Aid, Innovation
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.stochastic import correlation_factor


class RadarFixAid(Aid):
    """Horizontal position as a ground radar saw it; never height."""

    def __init__(self, settings: RadarSettings) -> None:
        super().__init__("radar_fix", ("north_m", "east_m"), settings.gate)
        self.settings = settings

    def innovation(self, measurement: NavSolution, host: Any) -> Innovation | str:
        if measurement.lat is None or measurement.cov_pos is None:
            return "position or its covariance is missing"
        state = host.state
        y = difference_n(measurement.lat, measurement.lon, state.nav[2], *state.nav)[0:2]
        H = np.zeros((2, state.layout.size))
        H[0, 0] = H[1, 1] = 1.0
        R = _floored(measurement.cov_pos[0:2, 0:2], self.settings.floor_m)
        return Innovation(y, H, R, y.copy(), state.free_for_ranges)


class WindUplinkAid(Aid):
    """Wind as the ground reports it; reports repeat one forecast error for long, so many of them say little more than one."""

    def __init__(self, settings: WindUplinkSettings) -> None:
        super().__init__("wind_uplink", ("wind_north_mps", "wind_east_mps"), settings.gate)
        self.settings = settings

    def innovation(self, measurement: NavSolution, host: Any) -> Innovation | str:
        if measurement.wind_n is None or measurement.cov_wind is None:
            return "wind or its covariance is missing"
        state = host.state
        factor = correlation_factor(since_s(self, measurement), self.settings.correlation_s)
        R = factor * _floored(measurement.cov_wind, self.settings.floor_mps)
        return Innovation(measurement.wind_n - state.totals()[0:2], state.wind_rows, R, measurement.wind_n)


def _floored(covariance: np.ndarray, sigma: float) -> np.ndarray:
    """Raise the variances of a covariance (2, 2) to at least ``sigma`` squared."""
    return covariance + np.diag(np.maximum(sigma**2 - np.diag(covariance), 0.0))
