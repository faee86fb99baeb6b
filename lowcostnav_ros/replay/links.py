"""How one navigator hears another in a replay: through the very messages that carry its solution in flight."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from lowcostnav_ros.measurements import Measurement, NavSolution
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.decode import DecodeRules, Rejected, decode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.replay.digest import imu_record, odometry_record

ATTITUDE_SOURCES = {"ahrs": "imu/data_fused"}
"""Navigators whose fused solution is an attitude, and the topic it goes out on; all others publish ``<name>/odometry_fused``."""


def output_topic(name: str) -> str:
    """Topic of a navigator's fused solution."""
    return ATTITUDE_SOURCES.get(name, f"{name}/odometry_fused")


def recorder_of(msgtype: str) -> Callable[[Any], bytes]:
    """The function that packs a fused message of this type for the digest."""
    return imu_record if msgtype == topics.IMU else odometry_record


@dataclasses.dataclass(slots=True)
class Link:
    """Turns one navigator's solutions into messages, and messages into what the others are fed.

    Attributes
    ----------
    navigator : Navigator
    topic : str
        Where its fused solution goes.
    rules : DecodeRules
        Shared by all links, so that a map origin is known to who decodes an odometry.
    """

    navigator: Navigator
    topic: str
    rules: DecodeRules

    @property
    def is_attitude(self) -> bool:
        """Whether the fused message is an Imu rather than an Odometry."""
        return self.topic in ATTITUDE_SOURCES.values()

    @property
    def msgtype(self) -> str:
        """Type of the fused message."""
        return topics.IMU if self.is_attitude else topics.ODOMETRY

    def message(self, solution: NavSolution) -> Any:
        """The fused message of a solution, as the live node would publish it; None while there is nothing to publish."""
        if self.is_attitude:
            known = solution.q_nb is not None and solution.angular_rate_b is not None
            return encode.imu_from_solution(solution) if known else None
        if self.navigator.origin is None or solution.lat is None:
            return None
        self.rules.origins[self.navigator.name] = self.navigator.origin
        return encode.odometry_from_solution(solution, self.navigator.origin)

    def measurement(self, message: Any) -> Measurement | Rejected:
        """What a listener gets from the message, decoded from its bytes as in flight."""
        return decode(self.topic, self.msgtype, to_cdr(message), self.rules)


def in_order(navigators: Mapping[str, Navigator]) -> list[str]:
    """Names so that everyone comes after those it listens to."""
    waiting, done = dict(navigators), []
    while waiting:
        free = [n for n, nav in waiting.items() if not _heard(nav, (w for w in waiting if w != n))]
        chosen = free or list(waiting)[:1]  # a circle cannot be ordered; the horizon of each still sorts by stamp
        for name in chosen:
            done.append(name)
            del waiting[name]
    return done


def _heard(navigator: Navigator, names: Iterable[str]) -> list[str]:
    return [name for name in names if output_topic(name) in navigator.inputs]
