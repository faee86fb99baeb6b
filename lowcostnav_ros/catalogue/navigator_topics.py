"""The topics of a navigator by its name, without importing it."""

from lowcostnav_ros.messages.topics import NAVIGATOR_TOPICS
from lowcostnav_ros.navigators.registry import label_of

HEALTH = "health"
"""Last part of the topic on which every navigator says how it is."""


def topics_of(name: str, room: str = "") -> tuple[str, ...]:
    """Return all topics a navigator publishes; ``room`` is their first part where the navigator does not declare it, default its name."""
    label = label_of(name)
    room = label.room or room or name
    own = label.outputs or tuple(f"{room}/{part}" for part in NAVIGATOR_TOPICS if part != HEALTH)
    return (*own, *filter(None, (label.aiding,)), f"{room}/{HEALTH}")


def fused_topics(name: str) -> tuple[str, ...]:
    """Return the topics that carry a navigator's fused solution, the solution itself first, and its health."""
    return tuple(topic for topic in topics_of(name) if topic.endswith(("_fused", f"/{HEALTH}")))
