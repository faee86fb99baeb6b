"""Where a source comes from on an aircraft of one's own: ``input.<source>.topic`` and ``input.<source>.frames``, in every node's settings.

The source keeps its name everywhere behind the edge (settings, diagnostics, recordings); only what is subscribed to, and the frame ids
that are accepted, change.  A recording carries these settings with those of the navigators, so that it is read as it was flown.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.documents import read_yaml
from lowcostnav_ros.base.settings import SettingsError, nearest, shown
from lowcostnav_ros.messages.kind import TOPICS, find
from lowcostnav_ros.messages.topics import source_of

HEAD, TOPIC, FRAMES = "input.", ".topic", ".frames"


@dataclass(frozen=True)
class Inputs:
    """Topics that carry sources under other names, and frame ids accepted of each source beside the usual ones."""

    topics: Mapping[str, str] = field(default_factory=dict)
    frames: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __or__(self, other: "Inputs") -> "Inputs":
        """Both; where they disagree on a topic, the other's."""
        frames = {source: (*self.frames.get(source, ()), *other.frames.get(source, ())) for source in {**self.frames, **other.frames}}
        return Inputs({**self.topics, **other.topics}, frames)

    def maps(self, recorded: Iterable[str]) -> dict[str, str]:
        """Of a recording's topics, those to be read under another name: ours are not there beside them."""
        there = {source_of(topic) for topic in recorded}
        return {topic: source for source, topic in self.topics.items() if topic in there and source not in there}


def is_of_input(name: str) -> bool:
    """Whether a setting says where a source comes from: ``input.gps/fix.topic``; ``input.frames`` is of the node."""
    return name.startswith(HEAD) and name.endswith((TOPIC, FRAMES)) and name.count(".") > 1


def parse_inputs(values: Mapping[str, Any], where: str = "settings") -> Inputs:
    """Read those of ``values``, dotted names, that :func:`is_of_input`; others are left alone.

    Raises
    ------
    SettingsError
        For a source that there is none of, a topic that is no name, frames that are no list.
    """
    found = Inputs({}, {})
    for name, value in values.items():
        if not is_of_input(name):
            continue
        source, _, part = name.removeprefix(HEAD).rpartition(".")
        if find(source, {}) is None:
            raise SettingsError(f"{where}: '{name}': there is no source '{source}'{nearest(source, TOPICS)}.")
        if part == "topic":
            if not isinstance(value, str) or not source_of(value) or any(c.isspace() for c in value):
                raise SettingsError(f"{where}: '{name}' must name a topic, such as /mavros/imu/data_raw, got {shown(value)}.")
            found |= Inputs({source: source_of(value)})
        else:
            frames = [value] if isinstance(value, str) else value
            if not isinstance(frames, list | tuple) or not all(isinstance(frame, str) for frame in frames):
                raise SettingsError(f"{where}: '{name}' must list frame ids, or be 'any', got {shown(value)}.")
            found |= Inputs({}, {source: tuple(frames)})
    return found


def inputs_in(folder: Path | None) -> Inputs:
    """What the parameter files of a folder say of their inputs; of a recording, or one that ``--config`` names."""
    found = Inputs()
    for path in sorted(folder.glob("*.yaml")) if folder is not None and folder.is_dir() else ():
        content = read_yaml(path)
        for node in content.values() if isinstance(content, Mapping) else ():
            if isinstance(node, Mapping) and isinstance(node.get("ros__parameters"), Mapping):
                found |= parse_inputs(dict(_dotted(node["ros__parameters"])), str(path))
    return found


def _dotted(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def remedy(source: str, topic: str) -> str:
    """The setting that takes a source from a topic, as a reader would type it."""
    return f"{HEAD}{source}{TOPIC}: /{topic}"
