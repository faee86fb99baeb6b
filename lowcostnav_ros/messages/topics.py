"""Every topic of the package: name, message type, what it carries, in which frame and unit.

A *source* is a topic name without its leading slash; the same name heads a measurement, a row of the diagnostics and an entry of a
recording.
"""

from dataclasses import dataclass, replace

from lowcostnav_ros.base.settings import nearest

IMU = "sensor_msgs/msg/Imu"
MAGNETIC_FIELD = "sensor_msgs/msg/MagneticField"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
FLUID_PRESSURE = "sensor_msgs/msg/FluidPressure"
TEMPERATURE = "sensor_msgs/msg/Temperature"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
RANGE = "sensor_msgs/msg/Range"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
CLOCK = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


@dataclass(frozen=True, slots=True)
class TopicSpec:
    """One topic: ``frame`` is the header's frame_id, ``latched`` asks for transient-local durability."""

    name: str
    msgtype: str
    description: str
    frame: str = ""
    unit: str = ""
    latched: bool = False


_CLOUD = (
    "Satellite observations; fields: see messages.gnss_cloud. One point a satellite is used: of two signals that agree the one of "
    "the smaller sigma; copies that contradict each other are all left out, the other satellites stay."
)
_SENSORS = (
    TopicSpec("imu/data_raw", IMU, "Specific force and angular rate; orientation_covariance[0] = -1.", "imu_link", "m/s^2, rad/s"),
    TopicSpec("imu/data", IMU, "The AHRS attitude (true heading) with bias-corrected rates, low latency.", "base_link", "rad/s, m/s^2"),
    TopicSpec("imu/data_fused", IMU, "The AHRS attitude at the fusion horizon: repeatable.", "base_link", "rad/s, m/s^2"),
    TopicSpec("imu/mag", MAGNETIC_FIELD, "Magnetic field.", "imu_link", "T"),
    TopicSpec("gps/fix", NAV_SAT_FIX, "Position, height above the ellipsoid, covariance ENU.", "gps", "deg, m, m^2"),
    TopicSpec("gps/attitude", IMU, "Attitude from several GPS antennas; rate and acceleration absent (-1).", "base_link", "rad"),
    TopicSpec("gps/vel", TWIST, "Velocity over ground, east north up at the antenna.", "gps", "m/s"),
    TopicSpec("gnss/raw", POINT_CLOUD, _CLOUD, "gps", "m, m/s"),
    TopicSpec("air/static_pressure", FLUID_PRESSURE, "Static pressure.", "base_link", "Pa"),
    TopicSpec("air/dynamic_pressure", FLUID_PRESSURE, "Impact pressure, total minus static.", "base_link", "Pa"),
    TopicSpec("air/temperature", TEMPERATURE, "Static air temperature.", "base_link", "deg C"),
    TopicSpec("air/velocity", TWIST, "Air-relative velocity: TAS on x, sideslip on y, incidence on z.", "base_link", "m/s"),
    TopicSpec("dme/range", RANGE, "One reply: slant range; frame_id is the station ident.", "", "m"),
    TopicSpec(
        "vor/bearing", POSE, "One radial: yaw = 90 deg - radial, roll, pitch and position zero; frame_id is the station ident.", "", "rad"
    ),
    TopicSpec("truth/odometry", ODOMETRY, "True pose and velocity, simulators only.", "map", "m, m/s"),
    TopicSpec("truth/imu", IMU, "Ideal inertial sample with the true attitude, simulators only.", "base_link", "m/s^2, rad/s"),
    TopicSpec("truth/wind", TWIST, "True velocity of the air mass, east north up at the aircraft.", "map", "m/s"),
    TopicSpec("truth/origin", NAV_SAT_FIX, "Geodetic origin of the map frame of truth/odometry.", "map", "deg, m", True),
    TopicSpec("clock", CLOCK, "Simulated time.", "", "s"),
    TopicSpec("diagnostics", DIAGNOSTICS, "Health of inputs, aids and navigators.", "", ""),
)

_NAVIGATOR = (
    TopicSpec("odometry", ODOMETRY, "Pose in the map frame of <navigator>/origin, twist in base_link.", "map", "m, m/s, rad/s"),
    TopicSpec("odometry_fused", ODOMETRY, "The same at the fusion horizon: what replay reproduces.", "map", "m, m/s, rad/s"),
    TopicSpec("fix", NAV_SAT_FIX, "Position, height above the ellipsoid, covariance ENU.", "base_link", "deg, m, m^2"),
    TopicSpec("wind", TWIST, "Velocity of the air mass, east north at the aircraft, low latency.", "map", "m/s"),
    TopicSpec("wind_fused", TWIST, "The same at the fusion horizon.", "map", "m/s"),
    TopicSpec("origin", NAV_SAT_FIX, "Geodetic origin of this navigator's map frame.", "map", "deg, m", True),
)

TOPICS: dict[str, TopicSpec] = {topic.name: topic for topic in _SENSORS}
"""Topics with a fixed name."""

NAVIGATOR_TOPICS: dict[str, TopicSpec] = {topic.name: topic for topic in _NAVIGATOR}
"""Last parts of the names every navigator publishes under its own name."""


def spec(name: str) -> TopicSpec:
    """Return the description of a topic.

    Parameters
    ----------
    name : str
        With or without the leading slash: one of :data:`TOPICS`, or ``<navigator>/<part>`` for :data:`NAVIGATOR_TOPICS`
        (``nav/odometry`` is the supervisor's).

    Raises
    ------
    ValueError
        For a name that is neither, with the nearest known one.
    """
    plain = source_of(name)
    if plain in TOPICS:
        return TOPICS[plain]
    head, _, last = plain.rpartition("/")
    if head and last in NAVIGATOR_TOPICS and head.split("/")[-1] not in _ROOMS:
        return replace(NAVIGATOR_TOPICS[last], name=plain)
    parts = ", ".join(NAVIGATOR_TOPICS)
    raise ValueError(f"Unknown topic '{name}'{nearest(plain, TOPICS)}; a navigator's topics are <navigator>/ followed by {parts}.")


def source_of(topic: str) -> str:
    """Return the source name of a topic: the name without leading slashes."""
    return topic.lstrip("/")


_ROOMS = {name.split("/")[0] for name in TOPICS if "/" in name}
