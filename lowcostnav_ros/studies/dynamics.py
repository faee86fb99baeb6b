"""The continuous error dynamics F of every navigator that has a filter of its own, for studies of what its measurements can tell."""

from collections.abc import Callable
from typing import Any

import numpy as np

NOT_OFFERED = {
    "ahrs": "it is told position, velocity and acceleration from outside its filter; watch ins_gps, which estimates them",
    "supervisor": "it has no filter of its own; watch the navigator it flies on",
}
"""Navigators whose error dynamics are not offered, and why."""


def dynamics_of(name: str) -> Callable[[Any], np.ndarray]:
    """Return what gives F (n, n) of a navigator, by its name in the registry, at its present state.

    Raises
    ------
    LookupError
        For a navigator of :data:`NOT_OFFERED`, or one that is not known; the message says why.
    """
    if name in ("ins_gps", "ins_gnss"):
        from lowcostnav_ros.cores.inertial import dynamics_now

        return dynamics_now
    if name == "gnss_only":
        return _satellites_alone
    if name == "dead_reckoning":
        return _dead_reckoning
    raise LookupError(NOT_OFFERED.get(name, "its error dynamics are not known"))


def _satellites_alone(navigator) -> np.ndarray:
    from lowcostnav_ros.cores.motion import motion_dynamics

    return motion_dynamics(navigator.layout.size, navigator.layout.rate)


def _dead_reckoning(navigator: Any) -> np.ndarray:
    """Position moves by vertical velocity, wind, heading and airspeed errors; every other state decays by its own rate."""
    layout = navigator.state.layout
    F = -np.diag(layout.rate)
    F[:3] += navigator.state.velocity(navigator.held)[1]
    return F
