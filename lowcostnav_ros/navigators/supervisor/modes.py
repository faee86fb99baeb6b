"""Modes of the backup-navigation system as one table (Gebre-Egziabher 2004, section 2.3, figures 2.2 and 2.3; G55).

Before flight a GPS outage forbids departure.  In flight GPS is primary and everything else is calibrated on it; when only its stated
accuracy degrades, stand-alone GPS goes on; when it is lost the aircraft coasts on the backup; when it returns it must agree with the
backup for a while before it is primary again.
"""

from dataclasses import dataclass
from enum import Enum

from lowcostnav_ros.base.modes import Mode


class Gps(Enum):
    """What GPS is worth at the moment."""

    LOST = "lost"
    SEEN = "seen"  # fixes come again, not yet in agreement for long enough
    COARSE = "coarse"  # in agreement, its stated accuracy does not allow a precise approach
    GOOD = "good"


MODES = (Mode.INITIALISING, Mode.NO_GO, Mode.CALIBRATING, Mode.GPS, Mode.COASTING, Mode.RE_ACQUIRING, Mode.FAILED)

_HEALTHY: dict[Gps, str] = {Gps.COARSE: Mode.GPS, Gps.GOOD: Mode.CALIBRATING}
_LOST_IN_FLIGHT: dict[Gps, str] = {Gps.LOST: Mode.COASTING, Gps.SEEN: Mode.RE_ACQUIRING, **_HEALTHY}
_LOST_ON_GROUND: dict[Gps, str] = {Gps.LOST: Mode.NO_GO, Gps.SEEN: Mode.NO_GO, **_HEALTHY}

IN_FLIGHT: dict[str, dict[Gps, str]] = dict.fromkeys(MODES, _LOST_IN_FLIGHT)
"""Mode and GPS to the next mode, airborne: what matters there is GPS alone."""

ON_GROUND: dict[str, dict[Gps, str]] = {
    **dict.fromkeys(MODES, _LOST_ON_GROUND),
    Mode.INITIALISING: {Gps.LOST: Mode.INITIALISING, Gps.SEEN: Mode.INITIALISING, **_HEALTHY},
    Mode.COASTING: _LOST_IN_FLIGHT,  # landed without GPS: the position is still reckoned until GPS is back
    Mode.RE_ACQUIRING: _LOST_IN_FLIGHT,
}
"""The same before departure and after landing."""


@dataclass(frozen=True, slots=True)
class Facts:
    """What the next mode depends on; ``waited`` is True once initialisation has lasted longer than it should."""

    gps: Gps
    airborne: bool
    solution: bool
    waited: bool = False


def next_mode(mode: str, facts: Facts) -> str:
    """Return the mode that follows ``mode``.

    Without any live solution: failed, or still initialising when there never was one.
    """
    if not facts.solution:
        waiting = mode in (Mode.INITIALISING, Mode.NO_GO) and not facts.airborne
        if not waiting:
            return Mode.FAILED
        return Mode.NO_GO if facts.waited else mode
    if facts.airborne:
        return IN_FLIGHT[mode][facts.gps]
    following = ON_GROUND[mode][facts.gps]
    return Mode.NO_GO if following == Mode.INITIALISING and facts.waited else following
