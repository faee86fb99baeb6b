"""Recordings of other systems: which of their topics is like which of ours, and under what name each is read."""

from collections.abc import Collection, Iterable, Mapping

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.messages.kind import TOPICS, Kind
from lowcostnav_ros.messages.topics import source_of


def parse_maps(entries: Iterable[str]) -> dict[str, str]:
    """Turn ``['fix=gps/fix', 'uav1/=']`` into recorded topic to our name; what ends in a slash stands for all topics that begin so.

    Raises
    ------
    SettingsError
        For an entry that does not read so.
    """
    maps = {}
    for entry in entries:
        recorded, equals, name = (part.strip() for part in entry.partition("="))
        if not equals or not source_of(recorded) or (not name and not recorded.endswith("/")):
            raise SettingsError(f"'{entry}' must read 'recorded topic=our topic', for example fix=gps/fix, or 'namespace/='.")
        maps[source_of(recorded)] = source_of(name)
    return maps


def mapped(topic: str, maps: Mapping[str, str]) -> str:
    """Return the source name under which a recorded topic is read."""
    source = source_of(topic)
    if source in maps:
        return maps[source]
    for recorded, name in maps.items():
        if recorded.endswith("/") and source.startswith(recorded):
            return name + source.removeprefix(recorded)
    return source


def offers(types: Mapping[str, str]) -> dict[str, str]:
    """Find recorded topics that are like a sensor's topic which the recording lacks.

    Parameters
    ----------
    types : mapping of source to message type

    Returns
    -------
    dict of recorded topic to our topic
        ``{'uav1/': ''}`` where a namespace alone stands between them.
    """
    lacking = [kind for name, kind in TOPICS.items() if kind.sensed and name not in types]
    found: dict[str, str] = {}
    for kind in lacking:
        alike = [source for source in types if kind.takes(types[source]) and source not in found and _is_foreign(source, types)]
        ranked = sorted((rank, source) for source in alike if (rank := _likeness(source, kind)) is not None)
        if ranked:
            found[ranked[0][1]] = kind.name
    spaces = {source.removesuffix(name) for source, name in found.items() if source.endswith(f"/{name}")}
    if len(spaces) == 1 and len(found) > 1:
        space = spaces.pop()
        return {space: ""} | {source: name for source, name in found.items() if source != space + name}
    return found


def _is_foreign(source: str, types: Collection[str]) -> bool:
    """Whether a topic may be another system's sensor: neither one of ours, nor a navigator's or the truth's."""
    if source in TOPICS:
        return not TOPICS[source].sensed and not source.startswith("truth/")
    return f"{source.rpartition('/')[0]}/odometry" not in types


def _likeness(source: str, kind: Kind) -> int | None:
    """Rank of a likeness by name, the closest first; None where only the type is alike and several of our topics have it."""
    words, own = set(source.replace("_", "/").split("/")), kind.name.split("/")
    if source.endswith(f"/{kind.name}"):
        return 0
    if own[-1] in source.rpartition("/")[2].split("/"):
        return 1
    if own[-1] in words or own[0] in words or set(_ALIASES.get(kind.name, ())) & words:
        return 2
    same = [other for other in TOPICS.values() if other.sensed and other.msgtype == kind.msgtype]
    return 3 if len(same) == 1 else None


_ALIASES = {"gps/vel": ("velocity", "vel", "gnss"), "imu/data_raw": ("imu", "raw"), "air/velocity": ("airspeed",)}


def options(found: Mapping[str, str]) -> str:
    """Return the options that read what :func:`offers` found."""
    return " ".join(f"--map {recorded}={name}" for recorded, name in sorted(found.items()))
