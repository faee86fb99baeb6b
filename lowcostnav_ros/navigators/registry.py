"""The navigators by name, in the order in which one feeds the next.

A navigator describes itself in its class; what :class:`NavigatorLabel` names can be asked for without importing it and the compiler
behind it.
"""

from dataclasses import dataclass, field

from lowcostnav_ros.base.registry import ClassRegistry


@dataclass(frozen=True)
class NavigatorLabel:
    """What a navigator declares in its class, which is decorated with ``@navigator`` and has ``Settings`` whose defaults make one.

    ``room`` is the first part of its topics, empty for its name; ``outputs`` its topics where they are not the usual ones; ``colour`` and
    ``dash`` how reports draw it, empty for any; ``healthy_modes`` those with its full accuracy; ``modes`` those that only it has: for each
    a colour and, where there is less than a position, words such as ``without a solution``.  ``aiding`` is a topic on which its velocity
    goes to a receiver; one that is on ``standby`` is flown by the supervisor when nothing else is sound.
    ``outdone_by`` names navigators that fly on the same sensors and more, ``chooses`` one that publishes others' solutions: where time is
    short they are left out when they add nothing.
    """

    name: str
    room: str = ""
    outputs: tuple[str, ...] = ()
    colour: str = ""
    dash: str = ""
    healthy_modes: tuple[str, ...] = ("gps", "calibrating")
    modes: dict[str, tuple[str, str]] = field(default_factory=dict)
    aiding: str = ""
    standby: bool = False
    outdone_by: tuple[str, ...] = ()
    chooses: bool = False


NAVIGATORS = ClassRegistry("navigator", "lowcostnav_ros.navigators", "navigator", NavigatorLabel)
navigator = NAVIGATORS.entry()

HEALTHY_COLOUR = "#1b9e77"
COMMON_MODES = {
    "coasting": ("#e6a817", ""),
    "aligning": ("#a6b4c0", ""),
    "initialising": ("#c9d1d8", ""),
    "failed": ("#c0392b", ""),
    "no solution": ("#c9d1d8", "without a solution"),
}


def label_of(name: str) -> NavigatorLabel:
    """Return the label of a navigator; the usual one for a name that is not registered."""
    return NAVIGATORS.label(name) if name in NAVIGATORS else NavigatorLabel(name)


def known_modes() -> dict[str, tuple[str, str]]:
    """Return all modes of all navigators, each with its colour and, where there is less than a position, what there is."""
    labels = [NAVIGATORS.label(name) for name in NAVIGATORS]
    healthy = {mode: (HEALTHY_COLOUR, "") for label in labels for mode in label.healthy_modes}
    return COMMON_MODES | healthy | {mode: look for label in labels for mode, look in label.modes.items()}
