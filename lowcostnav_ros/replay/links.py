"""How one navigator hears another in a replay: through the very messages that carry its solution in flight."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.replay.digest import imu_record, odometry_record


def output_topic(name: str) -> str:
    """Topic of a navigator's fused solution."""
    return fused_topics(name)[0]


def recorder_of(msgtype: str) -> Callable[[Any], bytes]:
    """The function that packs a fused message of this type for the digest."""
    return imu_record if msgtype == topics.IMU else odometry_record


class Link:
    """Turns one navigator's solutions into messages, and messages into what the others are fed.

    Parameters
    ----------
    name : str
        Name of the navigator.
    navigator : Navigator
    rules : DecodeRules
        Shared by all links, so that a map origin is known to who decodes an odometry.
    """

    def __init__(self, name: str, navigator: Navigator, rules: DecodeRules) -> None:
        self.navigator = navigator
        self.topic = output_topic(name)
        self.msgtype = topics.spec(self.topic).msgtype
        self.is_attitude = self.msgtype == topics.IMU
        self._room = self.topic.rpartition("/")[0]
        self._decoder = Decoder(rules)
        self._origin: Any = None

    def message(self, solution: NavSolution) -> Any:
        """The fused message of a solution, as the live node would publish it; None while there is nothing to publish."""
        if self.is_attitude:
            return None if solution.q_nb is None else encode.imu_from_solution(solution)
        origin = self.navigator.origin
        if origin is None:
            return None
        if origin is not self._origin:
            self._origin = origin  # listeners learn it from the message, in degrees, which is not always the same last bit
            self._decoder.decode(f"{self._room}/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(solution.stamp_ns, origin)))
        return encode.odometry_from_solution(solution, origin)

    def heard(self, solution: NavSolution, message: Any, wanted: Collection[str]) -> Iterator[Measurement]:
        """What listeners get, decoded from bytes as in flight.

        Parameters
        ----------
        solution : NavSolution
        message : message object
            The fused message of the solution.
        wanted : collection of str
            Topics somebody listens to.
        """
        said = [(self.topic, self.msgtype, message)]
        if not self.is_attitude:
            said.append((f"{self._room}/wind_fused", topics.TWIST, encode.wind_from_solution(solution)))
        for topic, msgtype, spoken in said:
            if topic in wanted and spoken is not None:
                measurement = self._decoder.decode(topic, msgtype, to_cdr(spoken))
                if not isinstance(measurement, Rejected):
                    yield measurement


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
    return [name for name in names if any(topic in navigator.inputs for topic in fused_topics(name))]
