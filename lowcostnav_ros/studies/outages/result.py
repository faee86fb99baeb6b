"""What a study of outages found, typed; :func:`~lowcostnav_ros.replay.result.plain` makes ``outages.json`` of it.

Numbers end in their unit; stamps and times are s; an error is estimate minus reference.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.units import NAUTICAL_MILE

HALF_MILE_M = 0.5 * NAUTICAL_MILE
PARTS = ("loss", "wind", "airspeed", "heading", "velocity", "rest")
"""Where an error comes from, see :mod:`.parts`."""


@dataclass(frozen=True, slots=True)
class End:
    """The error some time after GPS was lost.

    Attributes
    ----------
    length_s : float
    north_m, east_m, down_m, horizontal_m : float
    sigma_m : float
        The navigator's own sigma along the longer half-axis of its error ellipse.
    error_over_sigma : float
        RMS over north and east of error over sigma: 1 on average where sigmas fit.
    heading_deg, heading_sigma_deg : float or None
    parts_m : dict of str to float
        Share of each of :data:`PARTS` in the horizontal error, m along its direction; they add up to it.
    circumstances : dict of str to float
        ``wind_change_mps`` and ``turned_deg`` since the loss, mean ``heading_error_deg`` and ``airspeed_error_mps``; as far as known.
    """

    length_s: float
    north_m: float
    east_m: float
    down_m: float
    horizontal_m: float
    sigma_m: float
    error_over_sigma: float
    heading_deg: float | None
    heading_sigma_deg: float | None
    parts_m: dict[str, float]
    circumstances: dict[str, float]


@dataclass(frozen=True, slots=True)
class Outage:
    """One navigator in one window.

    Attributes
    ----------
    start_s, after_s : float
        Stamp of the loss, and the same from the start of the recording.
    lat_deg, lon_deg : float
        Where GPS was lost.
    ends : tuple of End
        Without those lengths that reach beyond the recording or where the reference is missing.
    silent_s : tuple of float
        Lengths at whose end there was no solution.
    horizontal_m, sigma_m : tuple of float or None
        At every second since the loss.
    """

    start_s: float
    after_s: float
    lat_deg: float
    lon_deg: float
    ends: tuple[End, ...]
    silent_s: tuple[float, ...]
    horizontal_m: tuple[float | None, ...]
    sigma_m: tuple[float | None, ...]

    def end(self, length_s: float) -> End | None:
        """The error after one of the lengths, None where it is not known."""
        return next((end for end in self.ends if end.length_s == length_s), None)


@dataclass(frozen=True, slots=True)
class Statistics:
    """All windows of one length: how many, errors at their ends, error over sigma, in how many there was no solution left."""

    length_s: float
    windows: int
    silent: int
    median_m: float
    p95_m: float
    max_m: float
    share_within_half_mile: float
    vertical_max_m: float
    error_over_sigma_rms: float
    share_beyond_3_sigma: float


@dataclass(frozen=True, slots=True)
class Flown:
    """One navigator with one set of settings: their name and hash, all its windows, statistics by length, the worst in a sentence."""

    navigator: str
    settings: str
    settings_hash: str
    outages: tuple[Outage, ...]
    statistics: tuple[Statistics, ...] = ()
    worst: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Navigator and settings in words."""
        return f"{self.navigator}, {self.settings}"

    def ends(self, length_s: float) -> list[tuple[Outage, End]]:
        """Windows with the errors at their ends."""
        return [(outage, end) for outage in self.outages if (end := outage.end(length_s)) is not None]


@dataclass(frozen=True, slots=True)
class OutageStudy:
    """The whole study.

    Attributes
    ----------
    recording, version : str
    first_stamp_s, last_stamp_s : float
    reference : str
        In words: what the errors were formed against.
    withheld : tuple of str
    lengths_s : tuple of float
    every_s : float
    without_gps : tuple of float
        Starts, s after the start of the recording, that were left out because there was no GPS to lose.
    left_out : dict of str to str
        Navigators that were not run, and why.
    flown : tuple of Flown
    track_deg : tuple of (float, float)
        The way over ground: latitude, longitude.
    """

    recording: str
    version: str
    first_stamp_s: float
    last_stamp_s: float
    reference: str
    withheld: tuple[str, ...]
    lengths_s: tuple[float, ...]
    every_s: float
    without_gps: tuple[float, ...]
    left_out: dict[str, str]
    flown: tuple[Flown, ...]
    track_deg: tuple[tuple[float, float], ...]


def statistics_of(outages: tuple[Outage, ...], length_s: float) -> Statistics | None:
    """Statistics of one length, None where no window has an end of it."""
    ends = [end for outage in outages if (end := outage.end(length_s)) is not None]
    silent = sum(length_s in outage.silent_s for outage in outages)
    if not ends:
        return None
    horizontal, sigma = np.array([e.horizontal_m for e in ends]), np.array([e.sigma_m for e in ends])
    return Statistics(
        length_s,
        len(ends) + silent,
        silent,
        float(np.median(horizontal)),
        float(np.percentile(horizontal, 95)),
        float(horizontal.max()),
        float((horizontal <= HALF_MILE_M).sum() / (len(ends) + silent)),
        max(abs(e.down_m) for e in ends),
        math.sqrt(float(np.mean([e.error_over_sigma**2 for e in ends]))),
        float((horizontal > 3.0 * sigma).mean()),
    )
