"""The topics of a navigator by its name, without importing it."""

from lowcostnav_ros.messages.topics import NAVIGATOR_TOPICS
from lowcostnav_ros.navigators.registry import label_of


def topics_of(name: str, room: str = "") -> tuple[str, ...]:
    """Return all topics a navigator publishes; ``room`` is their first part where the navigator does not declare it, default its name."""
    label = label_of(name)
    return label.outputs or tuple(f"{label.room or room or name}/{part}" for part in NAVIGATOR_TOPICS)


def fused_topics(name: str) -> tuple[str, ...]:
    """Return the topics that carry a navigator's fused solution, the solution itself first."""
    return tuple(topic for topic in topics_of(name) if topic.endswith("_fused"))
