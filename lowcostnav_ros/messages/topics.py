"""The door to topic names and types: every topic of the package with its message type, what it carries, in which frame and unit.

A *source* is a topic name without its leading slash; the same name heads a measurement, a row of the diagnostics and an entry of a
recording.  Topics are described one kind a file in ``messages.kinds``.
"""

from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.messages.kind import NAVIGATOR_TOPICS as NAVIGATOR_TOPICS
from lowcostnav_ros.messages.kind import TOPICS as TOPICS
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.kind import TopicSpec as TopicSpec
from lowcostnav_ros.messages.rules import RULES, DecodeRules

IMU = "sensor_msgs/msg/Imu"
MAGNETIC_FIELD = "sensor_msgs/msg/MagneticField"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
TWIST_ALONE = "geometry_msgs/msg/TwistStamped"
FLUID_PRESSURE = "sensor_msgs/msg/FluidPressure"
TEMPERATURE = "sensor_msgs/msg/Temperature"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
RANGE = "sensor_msgs/msg/Range"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
CLOCK = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


def kind_of(name: str, rules: DecodeRules = RULES) -> Kind | None:
    """Return the kind of a topic (with or without the leading slash) under its own name, None where it has none."""
    return rules.kind_of(source_of(name))


def spec(name: str, rules: DecodeRules = RULES) -> Kind:
    """Return the description of a topic.

    Parameters
    ----------
    name : str
        With or without the leading slash: one of :data:`TOPICS`, a further instance of one (``gps2/fix``), ``<navigator>/<part>`` for
        :data:`NAVIGATOR_TOPICS` (``nav/odometry`` is the supervisor's), or a source to which the rules assign a kind.
    rules : DecodeRules

    Raises
    ------
    ValueError
        For a name that is none of these, with the nearest known one.
    """
    kind = kind_of(name, rules)
    if kind is None:
        near, parts = nearest(source_of(name), TOPICS), ", ".join(NAVIGATOR_TOPICS)
        raise ValueError(f"Unknown topic '{name}'{near}; a navigator's topics are <navigator>/ followed by {parts}.")
    return kind


def source_of(topic: str) -> str:
    """Return the source name of a topic: the name without leading slashes."""
    return topic.lstrip("/")
