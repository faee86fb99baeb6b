"""What the decoder accepts: kinds and frames of sources, plausible ranges, variances where a message states none; and refusals."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.messages.kind import TOPICS, Kind, described, find

if TYPE_CHECKING:
    from lowcostnav_ros.messages.map_frames import MapFrame
    from lowcostnav_ros.physics.earth import LocalFrame

ANY = "any"
"""Among the frames of a source: accept every frame id."""


class Listener(Protocol):
    """What a navigator states about its sources: the topic whose message each carries, and further frame ids."""

    @property
    def kinds(self) -> Mapping[str, str]: ...
    @property
    def frames(self) -> Mapping[str, Collection[str]]: ...


@dataclass(frozen=True, slots=True)
class DecodeRules:
    """What to accept and what to assume.

    Attributes
    ----------
    kinds : dict of source to canonical topic
        Kinds of sources that their names do not show (see :func:`~lowcostnav_ros.messages.kind.find`); :meth:`assign` fills it.
    frames : dict of source to frame ids
        Accepted besides those of the kind; :data:`ANY` accepts all.
    everywhere : tuple of frame ids
        Accepted of every source; :data:`ANY` accepts all.
    default_variances : mapping of source to variances, or None
        For a covariance of all zeros (NED/FRD order, SI); a source that is missing is refused.  None: those of the kinds.
    origins : dict of navigator name to the :class:`LocalFrame` its odometry is expressed in; a :class:`Decoder`
        fills it as ``<navigator>/origin`` arrives.
    map_frames : dict of navigator name to what is known of the origins it has announced
    max_angular_rate, max_specific_force : float
        rad/s and m/s^2; more than this is a unit error, not an aircraft.
    mag_range : (float, float)
        Tesla; the earth's field is 0.2e-4 to 0.7e-4, the margin leaves room for an uncalibrated hard iron.
    max_range_m : float
        Slant range that no station serves.
    """

    kinds: dict[str, str] = field(default_factory=dict)
    frames: dict[str, Collection[str]] = field(default_factory=dict)
    everywhere: tuple[str, ...] = ()
    default_variances: Mapping[str, tuple[float, ...]] | None = None
    origins: dict[str, "LocalFrame"] = field(default_factory=dict)
    map_frames: dict[str, "MapFrame"] = field(default_factory=dict)
    max_angular_rate: float = 35.0
    max_specific_force: float = 1000.0
    mag_range: tuple[float, float] = (0.1e-4, 1.4e-4)
    max_range_m: float = 600.0e3
    _known: dict[str, Kind] = field(default_factory=dict, init=False, repr=False, compare=False)

    def assign(self, source: str, kind: str, frames: str | Collection[str] = ()) -> None:
        """Give a source the kind of a canonical topic (``gps/fix``, ``<navigator>/odometry``), and frame ids of its own.

        Raises
        ------
        RegistryError
            When there is no such topic.
        """
        self.kinds[source] = described(kind).name
        self.frames[source] = (frames,) if isinstance(frames, str) else frames
        self._known.pop(source, None)

    def allow(self, frames: Mapping[str, Collection[str]]) -> None:
        """Accept further frame ids of some sources."""
        for source, further in frames.items():
            self.frames[source] = {*self.frames.get(source, ()), *further}
            self._known.pop(source, None)

    def accept(self, listener: Listener) -> None:
        """Assign the kinds and frames that a navigator's settings give its sources; a frame that any listener accepts is accepted.

        Raises
        ------
        SettingsError
            When two listeners take one source for different kinds.
        """
        for source, topic in listener.kinds.items():
            canonical = find(topic, {})  # ``radar/fix`` carries what every navigator's fix does
            kind = topic if canonical is None else canonical.name
            frames = {*self.frames.get(source, ()), *listener.frames.get(source, ())}
            if source not in TOPICS:
                if self.kinds.get(source, kind) != kind:
                    raise SettingsError(f"The topic '{source}' is configured as {self.kinds[source]} and as {kind}; correct one of them.")
                self.assign(source, kind, frames)
            elif frames:
                self.frames[source] = frames
                self._known.pop(source, None)

    def kind_of(self, source: str) -> Kind | None:
        """Return the kind of a source under these rules, with the source's name, frames and variances; None where it has none."""
        kind = self._known.get(source)
        if kind is None:
            found = find(source, self.kinds)
            if found is None:
                return None
            own, variances = {*self.frames.get(source, ()), *self.everywhere}, self.default_variances
            frames = frozenset() if ANY in own or not found.frames else found.frames | own
            assumed = found.variances if variances is None else tuple(variances.get(source, ()))
            kind = self._known[source] = replace(found, name=source, frames=frames, variances=assumed)
        return kind


def parse_further(entries: Collection[str]) -> dict[str, str]:
    """Turn ``['cabin/pressure:air/static_pressure']`` into topic and the topic of the package it is like.

    Raises
    ------
    SettingsError
        For an entry that does not read so.
    """
    kinds = {source: kind for source, _, kind in (entry.partition(":") for entry in entries)}
    for source, kind in kinds.items():
        if kind not in TOPICS:
            raise SettingsError(f"'{source}:{kind}' must read 'topic:known topic', for example 'cabin/pressure:air/static_pressure'.")
    return kinds


FURTHER = "Topics of further sensors, each with the topic it is like, as 'cabin/pressure:air/static_pressure'."
"""Meaning of the setting that :func:`parse_further` reads."""

RULES = DecodeRules()
"""Rules used where none are given."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """A message that is not used: ``reason`` is a fixed phrase to count by, ``detail`` holds the offending value."""

    source: str
    reason: str
    detail: str = ""
    stamp_ns: int = 0


class Refusal(Exception):
    """Raised between the checks and :func:`decode`, which turns it into a :class:`Rejected`; never leaves this package."""

    def __init__(self, reason: str, detail: object = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.detail = str(detail)
