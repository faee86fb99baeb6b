"""How one navigator receives another's solution in a replay: through the very messages that carry its solution in flight."""

from collections.abc import Callable, Collection, Iterator, Mapping
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
        Shared by all links, so that the map origin is known wherever an odometry is decoded.
    """

    def __init__(self, name: str, navigator: Navigator, rules: DecodeRules) -> None:
        self.navigator = navigator
        self.topic, *_, self._health_topic = fused_topics(name)
        self.msgtype = topics.spec(self.topic).msgtype
        self.is_attitude = self.msgtype == topics.IMU
        self._room = self.topic.rpartition("/")[0]
        self._decoder = Decoder(rules)
        navigator.map_origins = rules.origins
        self._origin: Any = None

    def message(self, solution: NavSolution) -> Any:
        """The fused message of a solution, as the live node would publish it; None while there is nothing to publish."""
        if self.is_attitude:
            return None if solution.q_nb is None else encode.imu_from_solution(solution)
        origin = self.navigator.origin
        if origin is None:
            return None
        if origin is not self._origin:
            self._origin = origin  # subscribers take it from the message, in degrees, which is not always the same last bit
            self._decoder.decode(f"{self._room}/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(solution.stamp_ns, origin)))
        return encode.odometry_from_solution(solution, origin)

    def received(self, solution: NavSolution, message: Any, wanted: Collection[str]) -> Iterator[Measurement]:
        """What subscribers receive, decoded from bytes as in flight.

        Parameters
        ----------
        solution : NavSolution
        message : message object
            The fused message of the solution.
        wanted : collection of str
            Topics some navigator takes.
        """
        published = [(self.topic, self.msgtype, message)]
        if solution.health is not None:
            published.insert(0, (self._health_topic, topics.DIAGNOSTICS, encode.health_from(solution.health)))
        if not self.is_attitude:
            published.append((f"{self._room}/wind_fused", topics.TWIST, encode.wind_from_solution(solution)))
        for topic, msgtype, sent in published:
            if topic in wanted and sent is not None:
                measurement = self._decoder.decode(topic, msgtype, to_cdr(sent))
                if not isinstance(measurement, Rejected):
                    yield measurement


def in_order(navigators: Mapping[str, Navigator]) -> list[str]:
    """Names so that each comes after those whose solutions it takes."""
    waiting: list[str] = list(navigators)
    done: list[str] = []
    while waiting:
        taken = {n: [w for w in waiting if w != n and any(t in navigators[n].inputs for t in fused_topics(w))] for n in waiting}
        free = [n for n in waiting if not taken[n]] or waiting[:1]  # a circle cannot be ordered; the horizon of each still sorts by stamp
        done += free
        waiting = [n for n in waiting if n not in free]
    return done
