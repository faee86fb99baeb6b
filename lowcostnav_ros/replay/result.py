"""What a replay found, typed; :meth:`ReplayResult.to_mapping` is the layout of ``summary.json`` and of ``--json``.

Every class here is a level of that file and its attributes are the keys, in order.  Numbers end in their unit; stamps and times are s.
An attribute that is None stands in the file as null, but for those declared ``omitted()``, which are not written.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from lowcostnav_ros.base.plain import empty, omitted, plain, typed

PARTS = ("flight", "withheld_gps", "without_gps")
"""Parts of a flight over which errors are summed up."""


@dataclasses.dataclass(frozen=True, slots=True)
class Size:
    """Statistics of the magnitude of one error, in its unit, and the stamp of the largest, s."""

    rms: float
    median: float
    p95: float
    max: float
    max_at_s: float


@dataclasses.dataclass(frozen=True, slots=True)
class PositionErrors:
    """Mean and RMS of the position error by ``north``, ``east``, ``up``, RMS in the plane and in space, m."""

    mean_m: dict[str, float]
    rms_m: dict[str, float]
    rms_2d_m: float
    rms_3d_m: float


@dataclasses.dataclass(frozen=True, slots=True)
class Approach:
    """Strictest approach category that the 95 % errors meet (empty for none); share within each: ``horizontal``, ``vertical``, ``both``."""

    met_by_95: str
    share_within: dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Errors over one part of a flight.

    Attributes
    ----------
    samples : int
    horizontal_m to wind_mps : Size or None
        None where it could not be compared.
    error_over_sigma : dict of str to float
        RMS of error over sigma by axis; 1 when the sigmas are consistent.
    nees_horizontal : float or None
        2 expected.
    position, approach
        None without positions.
    """

    samples: int
    horizontal_m: Size | None = omitted()
    vertical_m: Size | None = omitted()
    position_m: Size | None = omitted()
    velocity_mps: Size | None = omitted()
    roll_deg: Size | None = omitted()
    pitch_deg: Size | None = omitted()
    heading_deg: Size | None = omitted()
    wind_mps: Size | None = omitted()
    error_over_sigma: dict[str, float] = empty()
    nees_horizontal: float | None = None
    position: PositionErrors | None = omitted()
    approach: Approach | None = omitted()

    def size(self, name: str) -> Size | None:
        """Statistics of one size by its name, such as ``horizontal_m``."""
        return getattr(self, name)


@dataclasses.dataclass(frozen=True, slots=True)
class IntervalErrors:
    """One outage or withheld window; ``start_s`` is None from the beginning, ``satellites`` the largest number seen in an outage."""

    text: str
    start_s: float | None
    end_s: float
    samples: int
    worst_horizontal_m: float | None = None
    worst_3d_m: float | None = None
    satellites: int | None = None
    error_at_end: dict[str, float] | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Exceedance:
    """One stretch beyond an alert limit; ``verdict``: ``warned`` in time, ``brief`` (over before a warning was due), ``missed``."""

    start_s: float
    end_s: float
    alarm_due_s: float
    alarm_s: float | None
    verdict: str


@dataclasses.dataclass(frozen=True, slots=True)
class ServiceErrors:
    """A flight against the alert limits of one service."""

    horizontal_limit_m: float
    vertical_limit_m: float
    time_to_alert_s: float
    exceedances: int
    warned: int
    brief: int
    missed: int
    longest_s: float
    beyond_limit_s: float
    alert_s: float
    beyond_without_alert_s: float
    listed: tuple[Exceedance, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class NavigatorErrors:
    """Errors of one navigator; ``whole``, over all of the flight, is ``flight`` against the truth, else ``withheld_gps`` against fixes."""

    reference: str | None = None
    whole: ErrorSummary | None = dataclasses.field(default=None, metadata={"names": ("withheld_gps", "flight")})
    without_gps: ErrorSummary | None = None
    services: dict[str, ServiceErrors] = empty()
    position_present_s: float = 0.0
    outages: tuple[IntervalErrors, ...] = ()
    windows: tuple[IntervalErrors, ...] = ()
    against_truth: bool = dataclasses.field(default=True, metadata={"hidden": True})

    @property
    def flight(self) -> ErrorSummary | None:
        """Errors against the truth."""
        return self.whole if self.against_truth else None

    @property
    def withheld_gps(self) -> ErrorSummary | None:
        """Errors against withheld fixes."""
        return None if self.against_truth else self.whole

    def parts(self) -> Iterator[tuple[str, ErrorSummary]]:
        """Parts of the flight in which there were errors to form, by their names in :data:`PARTS`."""
        return ((part, found) for part in PARTS if (found := getattr(self, part)) is not None)


@dataclasses.dataclass(frozen=True, slots=True)
class Fused:
    """Fingerprint of a fused solution and its comparison with the recorded one (``equals_recorded`` None where none was recorded)."""

    sha256: str | None
    sha256_recorded: str | None
    equals_recorded: bool | None
    first_differing_stamp_s: float | None
    count: int
    count_recorded: int
    count_equal: int
    count_differing: int
    count_missing: int
    count_outside_recording: int


@dataclasses.dataclass(frozen=True, slots=True)
class Exclusion:
    """One excluded satellite."""

    stamp_s: float
    satellite: str
    why: str


@dataclasses.dataclass(frozen=True, slots=True)
class Alarm:
    """First alarm of the integrity tests."""

    stamp_s: float
    text: str


@dataclasses.dataclass(frozen=True, slots=True)
class IntegritySummary:
    """Integrity tests over a flight: seconds by verdict, exclusions (the first are listed, all counted), protection levels."""

    verdict_seconds: dict[str, float]
    exclusions: tuple[Exclusion, ...]
    exclusion_count: int
    alarm: Alarm | None
    epochs_with_protection_level: int
    epochs_beyond_protection_level: int
    largest_error_over_protection_level: float | None


@dataclasses.dataclass(frozen=True, slots=True)
class ContradictionSummary:
    """One contradiction over a flight: when it was first seen, for how many seconds it held, how large it was, its last advice."""

    name: str
    parties: tuple[str, ...]
    suspect: str
    first_s: float
    seconds: float
    largest: float
    unit: str
    advice: str


@dataclasses.dataclass(frozen=True, slots=True)
class StampSummary:
    """Offset of the stamps of one device at the end: in all and corrected, s, positive for late; whether its sigma means anything."""

    late_s: float
    sigma_s: float
    corrected_s: float
    is_observed: bool


@dataclasses.dataclass(frozen=True, slots=True)
class AidSummary:
    """Use of one aid; the statistics of its innovations are None when none was formed.

    ``innovation_correlation`` is that of one with the next.
    """

    used: int
    not_used_or_limited: dict[str, int]
    tested: int
    nis_per_dof: float | None = omitted()
    innovation_mean: dict[str, float] | None = omitted()
    innovation_rms: dict[str, float] | None = omitted()
    innovation_correlation: dict[str, float] | None = omitted()


@dataclasses.dataclass(frozen=True, slots=True)
class InputSummary:
    """What a navigator received from one source, and what it rejected by reason."""

    required: bool
    received: int
    rejected: dict[str, int]


@dataclasses.dataclass(frozen=True, slots=True)
class NavigatorResult:
    """Everything about one navigator; ``smoothed``: errors of its smoothed solutions, where they were asked for."""

    fused: Fused
    solutions: int
    mode_at_end: str
    reason_at_end: str
    mode_seconds: dict[str, float] = empty()
    restarts: dict[str, int] = empty()
    errors: NavigatorErrors = NavigatorErrors()
    integrity: IntegritySummary | None = None
    aids: dict[str, AidSummary] = empty()
    inputs: dict[str, InputSummary] = empty()
    feed_seconds: float = 0.0
    smoothed: NavigatorErrors | None = omitted()
    contradictions: tuple[ContradictionSummary, ...] = ()
    stamps: dict[str, StampSummary] = empty()


@dataclasses.dataclass(frozen=True, slots=True)
class Bag:
    """The recording: name, identity, messages by topic."""

    name: str
    sha256: str
    topics: dict[str, int]


@dataclasses.dataclass(frozen=True, slots=True)
class SourceCounts:
    """Messages of one source of the recording, and those the decoder rejected by reason."""

    count: int
    rejected: dict[str, int]


@dataclasses.dataclass(frozen=True, slots=True)
class Recording:
    """What a replay of a bag adds: its identity, topic of the truth, navigators not run and why, sources, assumptions made."""

    bag: Bag
    truth: str | None = None
    left_out: dict[str, str] = empty()
    inputs: dict[str, SourceCounts] = empty()
    assumed: dict[str, int] = empty()


@dataclasses.dataclass(frozen=True, slots=True)
class WithoutGps:
    """When there was no GPS."""

    intervals_s: tuple[tuple[float, float], ...]
    total_s: float


@dataclasses.dataclass(frozen=True, slots=True)
class Place:
    """A radio station on the map."""

    ident: str
    lat_deg: float
    lon_deg: float


@dataclasses.dataclass(frozen=True, slots=True)
class Times:
    """Wall time and real-time factors, of the whole pass and of each navigator as if it flew alone."""

    wall_s: float
    decode_s: float
    real_time_factor: float | None
    real_time_factor_by_navigator: dict[str, float | None]


@dataclasses.dataclass(frozen=True, slots=True)
class ReplayResult:
    """What a replay found.

    Attributes
    ----------
    recording : Recording or None
        None where a stream was replayed; in the file its keys stand beside the others.
    navigators : dict of str to NavigatorResult
    settings : dict of str to dict
        Settings by navigator, dotted names.
    time : Times or None
        None until the pass has been timed.
    verdicts : tuple of dict or None
        ``metric`` and ``verdict`` of each expectation; None where no baseline was given.
    """

    recording: Recording | None = dataclasses.field(metadata={"flat": Recording})
    version: str
    settings_hash: str
    settings: dict[str, Any]
    first_stamp_s: float
    last_stamp_s: float
    duration_s: float
    withheld: tuple[str, ...]
    without_gps: WithoutGps
    stations: tuple[Place, ...]
    navigators: dict[str, NavigatorResult]
    time: Times | None = omitted()
    verdicts: tuple[dict[str, str], ...] | None = omitted()

    def navigator(self, name: str) -> NavigatorResult:
        """The part about one navigator."""
        return self.navigators[name]

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values, fit for JSON."""
        return plain(self)

    summary = property(to_mapping)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> "ReplayResult":
        """Read what :meth:`to_mapping` gave.

        Raises
        ------
        ValueError
            When a level is no mapping or lacks a key.
        """
        return typed(cls, values)
