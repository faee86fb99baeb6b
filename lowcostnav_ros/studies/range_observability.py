"""What ranges taken one at a time determine, in windows along a recording: position, wind, heading error, airspeed error.

One receiver receives one station at a time (Gebre-Egziabher 2004, section 6.3); :mod:`lowcostnav_ros.radionav.observability` has the rows.
The track and the velocity through the air are those that the navigator estimates.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import Measurement, SlantRange
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.radionav.observability import STATES, Track, measurement_rows, rank, singular_values

SAMPLE_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class RangeWindow:
    """One window: its start, ns, ranges and stations in it, rank of the first 2, 4 and 6 of :data:`STATES`, and singular values of all six.

    The singular values are of columns scaled to unit length.
    """

    start_ns: int
    ranges: int
    stations: tuple[str, ...]
    ranks: tuple[int, ...]
    singular_values: np.ndarray


class RangeWatch:
    """Follow a navigator that estimates position and wind, and the ranges it is given; it changes nothing the navigator computes."""

    def __init__(self, navigator: Navigator, window_s: float) -> None:
        self._navigator, self._window_ns = navigator, round(1e9 * window_s)
        self._ranges: list[SlantRange] = []
        self._flown: list[tuple[float, ...]] = []

    def see(self, measurement: Measurement) -> None:
        """Take note of a range, and of the state once a second; called after the navigator was fed with it."""
        if isinstance(measurement, SlantRange):
            self._ranges.append(measurement)
        if self._flown and measurement.stamp_ns < self._flown[-1][0] + SAMPLE_NS:
            return
        now = self._navigator.output()
        if now is None or not now.has_position or now.vel_n is None or now.wind_n is None:
            return
        if not self._flown or now.stamp_ns > self._flown[-1][0]:
            self._flown.append((now.stamp_ns, *now.place, *(now.vel_n[:2] - now.wind_n)))

    def windows(self) -> list[RangeWindow]:
        """Windows in order; those with fewer than two ranges are left out."""
        table = self._navigator.stations
        if len(self._flown) < 2 or table is None:
            return []
        begin, end = int(self._flown[0][0]), int(self._flown[-1][0])
        known = [r for r in self._ranges if begin <= r.stamp_ns <= end and r.station in table]
        found = (self._window(t, [r for r in known if t <= r.stamp_ns < t + self._window_ns]) for t in range(begin, end, self._window_ns))
        return [window for window in found if window is not None]

    def _window(self, start_ns: int, ranges: list[SlantRange]) -> RangeWindow | None:
        flown = [row for row in self._flown if start_ns <= row[0] < start_ns + self._window_ns]
        if len(ranges) < 2 or len(flown) < 2:
            return None
        here = flown[0][1:4]
        north, east = np.array([difference_n(*row[1:4], *here)[:2] for row in flown]).T
        time_s = np.array([1e-9 * (row[0] - start_ns) for row in flown])
        air = np.array([row[4:6] for row in flown]).T
        places = [self._navigator.stations[r.station] for r in ranges]
        stations = np.array([difference_n(s.lat, s.lon, s.height, *here)[:2] for s in places])
        rows = measurement_rows(Track(time_s, north, east, *air), stations, np.array([1e-9 * (r.stamp_ns - start_ns) for r in ranges]))
        names = tuple(dict.fromkeys(r.station for r in ranges))
        return RangeWindow(start_ns, len(ranges), names, tuple(rank(rows[:, :k]) for k in (2, 4, len(STATES))), singular_values(rows))
