"""VOR radials as an aid: one class for every navigator that keeps a position.

The error of a radial has three parts, modelled as what they are:

- what is left of the station's *alignment* lasts: a state per station (Gauss-Markov, long), which GPS teaches while it is good;
- *course bends* change along the way: noise with a correlation distance, of which radials in quick succession repeat one draw.  No state
  could follow them, so their variance is multiplied by the factor that leaves the information such radials really hold;
- *receiver noise* is white.

While GPS is good a radial moves the station's own state and nothing else: what it could tell of the position, GPS tells better.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lowcostnav_ros.base.measurements import VorBearing
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE, NAUTICAL_MILE
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Innovation
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout, gauss_markov
from lowcostnav_ros.estimation.station_slots import StationSlots
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.physics.stochastic import correlation_factor
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.radionav.vor import BearingView, bearing_view, out_of_service

BLOCK = "vor_bias"
SLOWEST_MPS = 1.0
"""Speed at which course bends still change when the aircraft stands."""


@dataclass(frozen=True)
class VorGateSettings(GateSettings):
    """The gate of radials; they are used seconds apart, so recovery takes many of them."""

    recovery_s: float = setting(60.0, "Rejecting this long makes the aid recover (widen or re-initialise).", unit="s", minimum=0.0)


@dataclass(frozen=True)
class VorSettings:
    """VOR radials; the default parts of the error add up to 1 degree (the usual range is 1 to 5)."""

    enabled: bool = setting(False, "Use VOR radials for position.")
    stations_file: str = setting("", "Station table; empty takes that of the DME, where there is one.")
    bias_deg: float = setting(0.6, "Error left of a station's alignment, sigma; 0: no states.", unit="deg", minimum=0.0, maximum=20.0)
    bias_tau_s: float = setting(3600.0, "Correlation time of that error.", unit="s", minimum=10.0)
    bend_deg: float = setting(0.75, "Course bends, sigma.", unit="deg", minimum=0.0, maximum=20.0)
    bend_distance_nm: float = setting(2.0, "Distance flown over which bends stay correlated.", unit="NM", minimum=0.01, maximum=100.0)
    noise_deg: float = setting(0.3, "White noise of the receiver, sigma.", unit="deg", minimum=0.001, maximum=20.0)
    slots: int = setting(4, "Stations whose alignment error is held at one time.", minimum=1, maximum=16)
    period_s: float = setting(5.0, "Use at most one radial of a station in this time.", unit="s", minimum=0.0, maximum=600.0)
    timeout_s: float = setting(30.0, "Without a radial for this long a station is named no more.", unit="s", minimum=1.0, maximum=600.0)
    gate: VorGateSettings = group(VorGateSettings)


def bias_blocks(settings: VorSettings) -> list[Block]:
    """States of the alignment errors, rad; none when radials are not used or their alignment counts as perfect."""
    if not settings.enabled or settings.bias_deg == 0.0:
        return []
    labels = [f"vor_bias_{i + 1}_rad" for i in range(settings.slots)]
    return [gauss_markov(BLOCK, labels, Kind.FREE, settings.bias_deg * DEGREE, settings.bias_tau_s)]


class BearingState(NamedTuple):
    """What the aid asks of its host (``host.bearing_state()``).

    ``position`` lat, lon [rad], height [m]; ``speed_mps`` over ground or through the air; ``free`` (n,) states it may move, None: all.
    """

    position: tuple[float, float, float]
    speed_mps: float
    layout: Layout
    estimate: np.ndarray
    free: np.ndarray | None


class VorAid(Aid):
    """One radial at a time; it needs no height and never moves it by itself.

    Parameters
    ----------
    settings : VorSettings
    stations : StationTable or None
        Where the stations stand and how they are aligned; without it every radial is refused by name.
    layout : Layout
        The host's states; the block of :func:`bias_blocks` may be among them.
    """

    def __init__(self, settings: VorSettings, stations: StationTable | None, layout: Layout) -> None:
        super().__init__("vor", ("radial_rad",), settings.gate)
        self.settings, self.stations = settings, stations
        self._slots = StationSlots(layout.get(BLOCK), settings.bias_deg * DEGREE)
        self._used_ns: dict[str, int] = {}

    def due(self, measurement: VorBearing) -> bool:
        """Whether the last radial used of this station is a period ago; its errors are slow, more would only feign certainty."""
        return not 0.0 <= self._since_s(measurement) < self.settings.period_s - 1e-3

    def heard(self, now_ns: int) -> list[str]:
        """Stations with a radial used within the time-out, by ident."""
        return sorted(name for name, stamp_ns in self._used_ns.items() if 0 <= now_ns - stamp_ns <= 1e9 * self.settings.timeout_s)

    def innovation(self, measurement: VorBearing, host: Any) -> Innovation | str:
        """y = radial + declination - (bearing + alignment error), wrapped; H is the gradient of the bearing and 1 on the error."""
        state = host.bearing_state()
        reason = self._refusal(measurement, state)
        if reason:
            return reason
        station = self.stations[measurement.station]
        seen = bearing_view(station, *state.position)
        y = measurement.bearing_rad + station.declination - seen.bearing
        H = np.zeros((1, state.layout.size))
        H[0, 0:3] = seen.gradient_n
        index = self._slots.index(measurement.station)
        if index is not None:
            H[0, index] = 1.0
            y -= state.estimate[index]
        variance = self._variance(measurement, state.speed_mps, lasting=index is None) + _curvature(host.P, seen)
        return Innovation(np.array([wrap(y)]), H, np.array([[variance]]), np.array([measurement.bearing_rad]), state.free)

    def process(self, measurement: VorBearing, host: Any) -> bool:
        """Seat the station, if its radial can be used at all; then as every aid."""
        state = host.bearing_state()
        if not self._refusal(measurement, state):
            self._slots.take(measurement.station, measurement.stamp_ns, host.P, state.estimate)
        used = super().process(measurement, host)
        if used:
            self._used_ns[measurement.station] = measurement.stamp_ns
        return used

    def _refusal(self, measurement: VorBearing, state: BearingState) -> str:
        if self.stations is None:
            return "no station table"
        if measurement.station not in self.stations:
            return f"station unknown ({measurement.station})"
        return out_of_service(self.stations[measurement.station], *state.position)

    def _variance(self, measurement: VorBearing, speed_mps: float, lasting: bool) -> float:
        """Variance of a radial, rad^2, without what a state holds; ``lasting``: no state holds the alignment error.

        What the receiver states beyond the three parts lasts as bends do: taken for white it would average out.
        """
        own, since_s = self.settings, self._since_s(measurement)
        bias, bend, noise = ((x * DEGREE) ** 2 for x in (own.bias_deg, own.bend_deg, own.noise_deg))
        bend = max(bend, measurement.variance - bias - noise)
        tau_s = own.bend_distance_nm * NAUTICAL_MILE / max(speed_mps, SLOWEST_MPS)
        total = noise + bend * correlation_factor(since_s, tau_s)
        return total + bias * correlation_factor(since_s, own.bias_tau_s) if lasting else total

    def _since_s(self, measurement: VorBearing) -> float:
        """Seconds since a radial of this station was used; ``inf`` before the first and after a start at an earlier time."""
        last_ns = self._used_ns.get(measurement.station)
        if last_ns is None or last_ns > measurement.stamp_ns:
            return math.inf
        return 1e-9 * (measurement.stamp_ns - last_ns)


def _curvature(P: np.ndarray, seen: BearingView) -> float:
    """Variance, rad^2, of the bearing's second-order term -(along across)/d^2 where position is known poorly against the distance."""
    across = seen.gradient_n[0:2] * seen.distance_m
    along = np.array([across[1], -across[0]])
    S = P[0:2, 0:2]
    product = float((along @ S @ along) * (across @ S @ across) + (along @ S @ across) ** 2)
    return product / max(seen.distance_m, 1.0) ** 4
