"""Withholding: sources taken away from the navigators for a while, written ``gps/fix,gps/vel@290-350`` or, for good, ``...@290-``.

The numbers are seconds.  A window that starts before the recording's first stamp is counted from the
recording's start, any other is read as stamps.  So ``@290-350`` means the same on a bag that starts at zero and on one that carries
wall-clock stamps, and a window copied from a result file (``t_s``) fits as it is.
"""

import dataclasses
import re
from collections.abc import Iterable

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.base.settings import nearest

NS = 1_000_000_000
_FORM = re.compile(r"^(?P<sources>[^@]+?)(?:@(?P<start>\d+(?:\.\d*)?)-(?P<end>\d+(?:\.\d*)?)?)?$")


class WithholdError(ValueError):
    """A withhold option that cannot be used; the message is one sentence that says what to do."""


@dataclasses.dataclass(frozen=True, slots=True)
class Withhold:
    """Sources to withhold and their window in seconds as written (``None`` for the whole flight, no end for the rest of it)."""

    sources: tuple[str, ...]
    start_s: float | None = None
    end_s: float | None = None

    @property
    def text(self) -> str:
        """The option as a user would write it."""
        window = "" if self.start_s is None else f"@{self.start_s:g}-{'' if self.end_s is None else f'{self.end_s:g}'}"
        return ",".join(self.sources) + window


@dataclasses.dataclass(frozen=True, slots=True)
class Window:
    """A withheld window in stamps: sources, first stamp in, first stamp out again (ns), and a sentence for the summary."""

    sources: frozenset[str]
    start_ns: int
    end_ns: int
    text: str

    def holds(self, source: str, stamp_ns: int) -> bool:
        """Whether a measurement of ``source`` valid at ``stamp_ns`` is withheld."""
        return source in self.sources and self.start_ns <= stamp_ns < self.end_ns


def parse_withhold(text: str) -> Withhold:
    """Read ``SOURCE[,SOURCE...][@START-[END]]``; without an end the window lasts for the rest of the flight.

    Raises
    ------
    WithholdError
        When the text has another form, names no source, or the window is empty.
    """
    match = _FORM.match(text.strip())
    sources = tuple(s.strip().lstrip("/") for s in match["sources"].split(",")) if match else ()
    if not match or not all(sources):
        raise WithholdError(f"--withhold '{text}' is not understood; write sources and a window in seconds, like gps/fix,gps/vel@290-350.")
    if match["start"] is None:
        return Withhold(sources)
    start, end = float(match["start"]), float(match["end"]) if match["end"] else None
    if end is not None and not start < end:
        raise WithholdError(f"--withhold '{text}': the window must end after it starts; swap or widen {start:g}-{end:g}.")
    return Withhold(sources, start, end)


def check_sources(withheld: Iterable[Withhold], available: Iterable[str]) -> None:
    """Refuse a withheld source that the recording does not hold, naming the nearest one it does.

    Raises
    ------
    WithholdError
    """
    known = sorted(available)
    for source in (s for w in withheld for s in w.sources):
        if source not in known:
            raise WithholdError(f"--withhold: the recording has no source '{source}'{nearest(source, known)}.")


def resolve(withhold: Withhold, first_stamp_ns: int) -> Window:
    """Place a window on the recording's clock by the rule of the module.

    Parameters
    ----------
    withhold : Withhold
    first_stamp_ns : int
        First stamp of the recording.
    """
    sources = ", ".join(withhold.sources)
    if withhold.start_s is None:
        return Window(frozenset(withhold.sources), -(2**62), 2**62, f"{sources} withheld all flight")
    offset = first_stamp_ns if round(withhold.start_s * NS) < first_stamp_ns else 0
    start_ns = round(withhold.start_s * NS) + offset
    end_ns = 2**62 if withhold.end_s is None else round(withhold.end_s * NS) + offset
    ends = ("from {0:g} s on", "stamp {0:.3f} s on") if withhold.end_s is None else ("{0:g}-{1:g} s", "stamps {0:.3f} s to {1:.3f} s")
    written = ends[0].format(withhold.start_s, withhold.end_s)
    reading = f"read as seconds from the start: {ends[1].format(start_ns / NS, end_ns / NS)}" if offset else "read as stamps"
    return Window(frozenset(withhold.sources), start_ns, end_ns, f"{sources} withheld {written}, {reading}")


def split(measurement: Measurement, windows: Iterable[Window]) -> tuple[Measurement | None, Measurement | None]:
    """Divide a measurement into (what is fed, what is withheld); inertial blocks are divided by sample."""
    held_by = [w for w in windows if measurement.source in w.sources]
    if not held_by:
        return measurement, None
    if isinstance(measurement, ImuBlock):
        stamps = measurement.stamps_ns
        held = np.zeros(len(stamps), dtype=bool)
        for window in held_by:
            held |= (stamps >= window.start_ns) & (stamps < window.end_ns)
        return (measurement, None) if not held.any() else (measurement[~held] if not held.all() else None, measurement[held])
    if any(w.holds(measurement.source, measurement.stamp_ns) for w in held_by):
        return None, measurement
    return measurement, None
