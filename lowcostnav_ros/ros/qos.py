"""Quality of service: four profiles, chosen by what a topic is for.

Sensors are published reliably, so that a recorder may ask for everything, and received best effort, so that a slow listener loses
samples (counted from the stamps) instead of holding the sensor up.  ``qos.lossless`` makes both sides reliable and keep-all:
publishing then waits for the slowest listener, which is what recordings that must be complete need.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from lowcostnav_ros.messages.topics import TopicSpec

SENSOR_DEPTH = 200  # two seconds of a 100 Hz IMU; the usual 5 is too short for Python


def lossless() -> QoSProfile:
    """Reliable and keep-all: nothing is lost, a publisher waits."""
    return QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)


def sensor_publisher() -> QoSProfile:
    """Reliable, keep the last 200."""
    return QoSProfile(depth=SENSOR_DEPTH, reliability=ReliabilityPolicy.RELIABLE)


def sensor_subscription() -> QoSProfile:
    """Best effort, keep the last 200: matches reliable and best-effort publishers alike."""
    return QoSProfile(depth=SENSOR_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)


def output() -> QoSProfile:
    """Reliable, keep the last 10: what people and other nodes look at."""
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """Reliable, transient local, keep the last: a late joiner still gets it."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def for_publisher(topic: TopicSpec, is_lossless: bool) -> QoSProfile:
    """Profile a node of this package publishes ``topic`` with."""
    if topic.latched:
        return latched()
    if topic.name in ("clock", "diagnostics"):
        return output()
    return lossless() if is_lossless else sensor_publisher()


def for_subscription(topic: TopicSpec, is_lossless: bool) -> QoSProfile:
    """Profile with which a node of this package subscribes to ``topic``."""
    if topic.latched:
        return latched()
    if topic.name in ("clock", "diagnostics"):
        return sensor_subscription()
    return lossless() if is_lossless else sensor_subscription()
