"""Bags of ROS 1, and bags of ROS 2 whose topics are another system's, to the standard topics.

Which topic is which is told by type and name, as a replay offers it, or by what the user says.  Twists without covariance are taken for
velocities of a receiver.  Frames are taken for what the topic means: body axes forward left up, world axes east north up.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, MagneticField
from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.convert.profile import ConvertError
from lowcostnav_ros.convert.standard import Standard, Summary
from lowcostnav_ros.formats.parser import Account
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import new_bag
from lowcostnav_ros.messages.decode import decode
from lowcostnav_ros.messages.foreign import mapped, offers
from lowcostnav_ros.messages.parts import header, twist_stamped
from lowcostnav_ros.messages.store import STORE, from_cdr, full_type, to_cdr
from lowcostnav_ros.messages.topics import TWIST, kind_of, source_of, spec

MAGIC = b"#ROSBAG V2.0"
_TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
KNOWN = {
    "mavros/imu/data_raw": "imu/data_raw",
    "mavros/imu/mag": "imu/mag",
    "mavros/imu/static_pressure": "air/static_pressure",
    "mavros/imu/diff_pressure": "air/dynamic_pressure",
    "mavros/global_position/raw/fix": "gps/fix",
    "mavros/global_position/raw/gps_vel": "gps/vel",
}
"""Topics of MAVROS, which has several of most types."""

Message = tuple[str, int, Any]
"""Topic, time of recording in ns, message object."""


def convert_bag(
    path: Path,
    out_bag: str | Path,
    maps: Mapping[str, str] | None = None,
    mounting_deg: tuple[float, float, float] | None = None,
) -> Summary:
    """Convert a bag of ROS 1 or of another system's topics.

    Parameters
    ----------
    path : Path
        A ``.bag`` file, or what a replay reads.
    out_bag : str or Path
        Bag to create.
    maps : mapping of recorded topic to ours, optional
        Instead of what is guessed.
    mounting_deg : tuple of three floats, optional
        Roll, pitch, yaw from the axes of the inertial sensor to those of the body.

    Raises
    ------
    ConvertError, BagError
        Each with one sentence that says what to do.
    """
    is_first = is_ros_1(path)
    types = _types_1(path) if is_first else _types_2(path)
    chosen = _chosen(path, types, maps or {})
    account = Account()
    for recorded, msgtype in types.items():
        if recorded not in chosen:
            account.left_out[f"{recorded} ({msgtype})"] += 1
    with new_bag(out_bag) as bag:
        standard = Standard(bag, mounting_deg)
        for recorded, received_ns, message in (_messages_1(path, set(chosen)) if is_first else _messages_2(path, set(chosen))):
            ours = chosen[recorded]
            account.origins.setdefault(ours, f"/{recorded} ({types[recorded]}), frame '{message.header.frame_id}'")
            _put(standard, account, ours, received_ns, message)
        standard.close()
        if not standard.found:
            raise ConvertError(f"{path} holds nothing usable on {', '.join(chosen)} ({_words(standard.rejected())}).")
        if remark := standard.mounting_remark():
            account.remark(remark)
        name = "ROS 1 bag" if is_first else "ROS 2 bag"
        return Summary(name, "stamps of the messages", standard.found, account, standard.rejected())


def is_ros_1(path: Path) -> bool:
    """Whether a file is a bag of ROS 1."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def _words(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} x {reason}" for reason, count in counts.items()) or "no messages"


def _chosen(path: Path, types: Mapping[str, str], maps: Mapping[str, str]) -> dict[str, str]:
    """Recorded topic to ours: what the user says, what is known, what looks alike."""
    chosen: dict[str, str] = {}
    for recorded, ours in maps.items():
        if recorded not in types:
            raise ConvertError(f"{path} has no topic '{recorded}' to map{nearest(recorded, types)}.")
        spec(ours)
        chosen[recorded] = source_of(ours)
    rest = {name: TWIST if kind == _TWIST_STAMPED else kind for name, kind in types.items() if name not in chosen}
    guessed = {name: ours for name, ours in KNOWN.items() if name in rest} or _offered(rest)
    own = {name: name for name in rest if (kind := kind_of(name)) is not None and kind.msgtype == rest[name] and kind.sensed}
    for recorded, ours in {**guessed, **own}.items():
        if ours not in chosen.values():
            chosen[recorded] = ours
    if not chosen:
        listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())[:12])
        raise ConvertError(f"{path} has no topic that looks like a sensor's; it has {listed}; name them with --map recorded=ours.")
    return chosen


def _offered(types: Mapping[str, str]) -> dict[str, str]:
    found = offers(types)
    return {name: mapped(name, found) for name in types if mapped(name, found) != name}


def _put(standard: Standard, account: Account, ours: str, received_ns: int, message: Any) -> None:
    kind = spec(ours)
    stamp = message.header.stamp
    stamp_ns = stamp.sec * 10**9 + stamp.nanosec or received_ns
    if message.__msgtype__ == _TWIST_STAMPED:
        linear = message.twist.linear
        message = twist_stamped(stamp_ns, kind.frame, np.array([linear.x, linear.y, linear.z]), np.zeros((3, 3)))
        account.remark(f"{ours} came without a covariance: a usual one is taken.")
    elif message.__msgtype__ != kind.msgtype:
        account.refused[f"{ours}: wrong message type {message.__msgtype__}"] += 1
        return
    else:
        message.header = header(stamp_ns, kind.frame)
    measurement = decode(ours, kind.msgtype, to_cdr(message))
    if isinstance(measurement, ImuBlock | MagneticField):
        standard.put(measurement)
    else:
        standard.put_message(stamp_ns, ours, kind.msgtype, message)


def _types_1(path: Path) -> dict[str, str]:
    from rosbags.rosbag1 import Reader, ReaderError

    try:
        with Reader(path) as bag:
            return {source_of(one.topic): full_type(one.msgtype) for one in bag.connections}
    except (ReaderError, OSError, ValueError, KeyError) as error:
        raise ConvertError(f"{path} is damaged ({error}); reindex it with the tools of ROS 1, or record again.") from error


def _types_2(path: Path) -> dict[str, str]:
    with BagReader(path) as bag:
        return dict(bag.types)


def _messages_1(path: Path, wanted: set[str]) -> Iterator[Message]:
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Reader(path) as bag:
        connections = [one for one in bag.connections if source_of(one.topic) in wanted and full_type(one.msgtype) in store.types]
        for connection, stamp_ns, raw in bag.messages(connections):
            yield source_of(connection.topic), stamp_ns, _of_ros_2(store.deserialize_ros1(raw, connection.msgtype))


def _messages_2(path: Path, wanted: set[str]) -> Iterator[Message]:
    with BagReader(path) as bag:
        for source, stamp_ns, raw in bag.stream(sorted(wanted)):
            yield source, stamp_ns, from_cdr(raw, bag.types[source])


def _of_ros_2(value: Any) -> Any:
    """The same message object of ROS 2, whose headers have no sequence number."""
    if not hasattr(value, "__msgtype__"):
        return value
    named = {name: _of_ros_2(getattr(value, name)) for name, _ in STORE.fielddefs[value.__msgtype__][1]}
    return STORE.types[value.__msgtype__](**named)
