"""How often a DME may be asked: the pulse budget of a transponder and the schedule of a receiver that keeps to it.

A receiver searches for 4 s at 135 pulses/s, then measures for 1 s at 25 pulses/s; it may not load a station more than one
that tracks it all the time, 1500 pulses/min (Gebre-Egziabher 2004, section 2.5.5).  One fix costs 565 pulses, so a station can
be asked twice a minute, and one receiver that alternates between two stations gets a range every 15 s.
"""

from dataclasses import dataclass

SEARCH_S = 4.0
REPLY_S = 1.0
SEARCH_PULSES_PER_S = 135
TRACK_PULSES_PER_S = 25
TRANSPONDER_PULSES_PER_S = 3000
SCHEMES = ("one_receiver", "two_receivers", "scanning")

PULSES_PER_FIX = int(SEARCH_S * SEARCH_PULSES_PER_S + REPLY_S * TRACK_PULSES_PER_S)
PULSES_PER_MINUTE = 60 * TRACK_PULSES_PER_S
FIXES_PER_STATION_PER_MINUTE = PULSES_PER_MINUTE // PULSES_PER_FIX


class ScheduleError(ValueError):
    """A schedule that asks too much; the message says what is possible."""


def transponder_load(tracking: int, searching: int) -> int:
    """Return the pulses per second that aircraft in track and in search put on one transponder (its capacity is 3000)."""
    return tracking * TRACK_PULSES_PER_S + searching * SEARCH_PULSES_PER_S


def answered_share(pulses_per_s: float) -> float:
    """Share of the questions that a transponder answers under a load."""
    return min(1.0, TRANSPONDER_PULSES_PER_S / pulses_per_s) if pulses_per_s > 0.0 else 1.0


@dataclass(frozen=True)
class Slot:
    """One question: which channel of the receiver(s), when it starts and when the reply is there, seconds from the start."""

    channel: int
    begin_s: float
    reply_s: float


@dataclass(frozen=True)
class InterrogationSchedule:
    """When which channel is asked.

    Parameters
    ----------
    scheme : str
        ``one_receiver``: stations in turn, one range per interval.  ``two_receivers``: every station at once, each interval.
        ``scanning``: every station tracked all the time, one range of each per interval.
    stations : int
        Number of stations asked.
    interval_s : float
        Seconds between ranges as the scheme defines; 0 takes the shortest the budget allows.
    over_budget : bool
        Allow an interval that loads a station more than its share, as the source flies two receivers at 15 s; not one that the receiver
        cannot keep.

    Raises
    ------
    ScheduleError
        When the interval would overload a station or the receiver.
    """

    scheme: str = "one_receiver"
    stations: int = 2
    interval_s: float = 0.0
    over_budget: bool = False

    def __post_init__(self) -> None:
        if self.scheme not in SCHEMES:
            raise ScheduleError(f"DME scheme must be one of {', '.join(SCHEMES)}, got '{self.scheme}'.")
        if self.stations < 1:
            raise ScheduleError("A DME schedule needs at least one station.")
        if self.scheme == "two_receivers" and self.stations != 2:
            raise ScheduleError(f"Two receivers ask two stations, not {self.stations}; use one_receiver or scanning.")
        shortest = shortest_interval_s(self.scheme, self.stations)
        if self.interval_s == 0.0:
            object.__setattr__(self, "interval_s", shortest)
        possible = REPLY_S if self.scheme == "scanning" else SEARCH_S + REPLY_S
        if self.interval_s < (possible if self.over_budget else shortest) - 1e-9:
            shortest = possible if self.over_budget else shortest
            what = "what a receiver can" if self.over_budget else f"the pulse budget of {PULSES_PER_MINUTE} pulses/min per station"
            raise ScheduleError(
                f"DME interval of {self.interval_s:g} s is over {what}; "
                f"use {shortest:g} s or longer for {self.scheme} with {self.stations} station{'s' if self.stations > 1 else ''}."
            )

    @property
    def pulses_per_minute(self) -> float:
        """Load on one station."""
        if self.scheme == "scanning":
            return 60.0 * TRACK_PULSES_PER_S
        return 60.0 / (self.interval_s * (self.stations if self.scheme == "one_receiver" else 1)) * PULSES_PER_FIX

    @property
    def saturation(self) -> str:
        """What a schedule over the budget does to a station, in words; empty within it."""
        load = self.pulses_per_minute
        if load <= PULSES_PER_MINUTE + 1e-6:
            return ""
        aircraft = int(60.0 * TRANSPONDER_PULSES_PER_S / load)
        return f"DME: {load:.0f} pulses/min on each station, over the budget of {PULSES_PER_MINUTE}: {aircraft} such aircraft saturate it."

    def slots(self, turn: int) -> tuple[Slot, ...]:
        """Return the questions of interval number ``turn`` (0, 1, ...)."""
        begin_s = turn * self.interval_s
        if self.scheme == "one_receiver":
            return (Slot(turn % self.stations, begin_s, begin_s + SEARCH_S + REPLY_S),)
        return tuple(Slot(channel, begin_s, begin_s + SEARCH_S + REPLY_S) for channel in range(self.stations))


def shortest_interval_s(scheme: str, stations: int) -> float:
    """Return the shortest interval the pulse budget and the receiver allow, seconds."""
    if scheme == "scanning":
        return REPLY_S
    turns = stations if scheme == "one_receiver" else 1
    return max(60.0 / (turns * FIXES_PER_STATION_PER_MINUTE), SEARCH_S + REPLY_S)
