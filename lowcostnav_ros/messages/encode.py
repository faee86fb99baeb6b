"""Measurements, solutions and truth to message objects (:func:`encode`) and CDR bytes (:func:`encode_cdr`)."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.base.units import celsius
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.gnss_cloud import cloud_of
from lowcostnav_ros.messages.store import STORE, to_cdr
from lowcostnav_ros.physics.earth import LocalFrame

_T = STORE.types
Header, Time = _T["std_msgs/msg/Header"], _T["builtin_interfaces/msg/Time"]
Vector3, Quaternion, Point = (_T[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion", "Point"))
Pose, PoseWithCovariance = _T["geometry_msgs/msg/Pose"], _T["geometry_msgs/msg/PoseWithCovariance"]
Twist, TwistWithCovariance = _T["geometry_msgs/msg/Twist"], _T["geometry_msgs/msg/TwistWithCovariance"]
PoseStamped = _T[topics.POSE]
TwistStamped, Odometry, Imu, NavSatFix = _T[topics.TWIST], _T[topics.ODOMETRY], _T[topics.IMU], _T[topics.NAV_SAT_FIX]
NavSatStatus = _T["sensor_msgs/msg/NavSatStatus"]
MagneticField, FluidPressure, Temperature, Range = (
    _T[name] for name in (topics.MAGNETIC_FIELD, topics.FLUID_PRESSURE, topics.TEMPERATURE, topics.RANGE)
)
Clock = _T[topics.CLOCK]
DiagnosticArray, DiagnosticStatus, KeyValue = (_T[f"diagnostic_msgs/msg/{x}"] for x in ("DiagnosticArray", "DiagnosticStatus", "KeyValue"))

_ABSENT = np.array([-1.0] + [0.0] * 8)
_UNKNOWN = np.zeros(9)
_NO_TURN = Quaternion(0.0, 0.0, 0.0, 1.0)
_NORTH_LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def time_of(stamp_ns: int) -> object:
    """Return a builtin_interfaces/Time of integer nanoseconds."""
    return Time(int(stamp_ns) // 1_000_000_000, int(stamp_ns) % 1_000_000_000)


def _header(stamp_ns: int, frame_id: str) -> object:
    return Header(time_of(stamp_ns), frame_id)


def _vector(xyz: np.ndarray) -> object:
    return Vector3(*map(float, xyz))


def _flu(vector_b: np.ndarray) -> object:
    return Vector3(float(vector_b[0]), -float(vector_b[1]), -float(vector_b[2]))


def _quaternion(q_nb: np.ndarray) -> object:
    return Quaternion(*conv.quat_to_ros(q_nb))


def imu_raw(stamp_ns: int, specific_force_b: np.ndarray, angular_rate_b: np.ndarray, frame_id: str = "imu_link") -> object:
    """Build an ``imu/data_raw`` message of one sample (m/s^2 and rad/s, FRD): orientation absent, covariances unknown."""
    return Imu(_header(stamp_ns, frame_id), _NO_TURN, _ABSENT, _flu(angular_rate_b), _UNKNOWN, _flu(specific_force_b), _UNKNOWN)


def imu_raw_cdr(block: m.ImuBlock, frame_id: str = "imu_link") -> list[bytes]:
    """Return the CDR bytes of every sample of a block: what ``to_cdr(imu_raw(...))`` gives, made in columns."""
    sample = np.frombuffer(to_cdr(imu_raw(0, np.zeros(3), np.zeros(3), frame_id)), np.uint8)
    start = len(sample) - 37 * 8
    n = len(block)
    table = np.tile(sample, (n, 1))
    table[:, 4:8] = (block.stamps_ns // 1_000_000_000).astype("<i4")[:, np.newaxis].view(np.uint8)
    table[:, 8:12] = (block.stamps_ns % 1_000_000_000).astype("<u4")[:, np.newaxis].view(np.uint8)
    for first, columns in ((13, block.angular_rate_b), (25, block.specific_force_b)):
        values = np.ascontiguousarray(conv.swap_body(columns), dtype="<f8")
        table[:, start + 8 * first : start + 8 * (first + 3)] = values.view(np.uint8).reshape(n, 24)
    flat, size = table.tobytes(), len(sample)
    return [flat[k : k + size] for k in range(0, n * size, size)]


def imu_attitude(attitude: m.Attitude, specific_force_known: bool = True) -> object:
    """Build an ``imu/data`` message of an attitude; ``specific_force_known=False`` marks the acceleration absent."""
    force_cov = _UNKNOWN if specific_force_known else _ABSENT
    return _imu(attitude.stamp_ns, attitude.q_nb, attitude.cov_att, attitude.angular_rate_b, attitude.specific_force_b, force_cov)


def gps_attitude(attitude: m.Attitude) -> object:
    """Build a ``gps/attitude`` message: orientation and its covariance, angular velocity and acceleration marked absent."""
    cov, none = np.ravel(conv.swap_world_cov(attitude.cov_att)), np.zeros(3)
    orientation = _quaternion(attitude.q_nb)
    return Imu(_header(attitude.stamp_ns, "base_link"), orientation, cov, _flu(none), _ABSENT, _flu(none), _ABSENT)


def imu_from_solution(solution: m.NavSolution) -> object:
    """Build an ``imu/data`` message from a solution that has an attitude: attitude, its covariance, corrected rate and specific force.

    Raises
    ------
    ValueError
        For a solution without attitude or rates.
    """
    if solution.q_nb is None or solution.cov_att is None or solution.angular_rate_b is None:
        raise ValueError(f"Solution of {solution.source} has no attitude and rate, so it cannot become an Imu message.")
    force, force_cov = (np.zeros(3), _ABSENT) if solution.specific_force_b is None else (solution.specific_force_b, _UNKNOWN)
    return _imu(solution.stamp_ns, solution.q_nb, solution.cov_att, solution.angular_rate_b, force, force_cov)


def _imu(stamp_ns: int, q_nb: np.ndarray, cov_att: np.ndarray, rate: np.ndarray, force: np.ndarray, force_cov: np.ndarray) -> object:
    cov = np.ravel(conv.swap_world_cov(cov_att))
    return Imu(_header(stamp_ns, "base_link"), _quaternion(q_nb), cov, _flu(rate), _UNKNOWN, _flu(force), force_cov)


def magnetic_field(measurement: m.MagneticField) -> object:
    """Build an ``imu/mag`` message."""
    cov = np.ravel(conv.swap_body_cov(measurement.cov_b))
    return MagneticField(_header(measurement.stamp_ns, "imu_link"), _flu(measurement.field_b), cov)


def nav_sat_fix(stamp_ns: int, lat: float, lon: float, height: float, cov_n: np.ndarray | None, frame_id: str, status: int = 0) -> object:
    """Build a NavSatFix of a position (rad, rad, m above the ellipsoid) with its NED covariance, or None for unknown.

    ``status`` is -1 for no fix, 0 for a fix, 1 and 2 for satellite- and ground-based augmentation.
    """
    cov = _UNKNOWN if cov_n is None else np.ravel(conv.swap_world_cov(cov_n))
    kind = 0 if cov_n is None else 3
    state = NavSatStatus(status, 1)
    return NavSatFix(_header(stamp_ns, frame_id), state, math.degrees(lat), math.degrees(lon), float(height), cov, kind)


def origin_fix(stamp_ns: int, origin: LocalFrame) -> object:
    """Build the ``<navigator>/origin`` message of a map frame."""
    return nav_sat_fix(stamp_ns, origin.lat, origin.lon, origin.height, None, "map")


def fix_from_solution(solution: m.NavSolution) -> object:
    """Build a navigator's NavSatFix; status -1 with zeros where the solution has no position."""
    if solution.lat is None:
        return nav_sat_fix(solution.stamp_ns, 0.0, 0.0, 0.0, None, "base_link", status=-1)
    return nav_sat_fix(solution.stamp_ns, solution.lat, solution.lon, solution.height, solution.cov_pos, "base_link")


def twist_stamped(stamp_ns: int, frame_id: str, linear: np.ndarray, cov: np.ndarray) -> object:
    """Build a TwistWithCovarianceStamped of a linear velocity and its (3, 3) covariance, both already in the message's axes."""
    full = np.zeros((6, 6))
    full[:3, :3] = cov
    full[3:, 3:] = np.eye(3) * m.UNKNOWN_VARIANCE
    twist = Twist(_vector(linear), Vector3(0.0, 0.0, 0.0))
    return TwistStamped(_header(stamp_ns, frame_id), TwistWithCovariance(twist, full.ravel()))


def gps_velocity(measurement: m.GpsVelocity) -> object:
    """Build a ``gps/vel`` message, ENU."""
    cov = conv.swap_world_cov(measurement.cov_n)
    return twist_stamped(measurement.stamp_ns, "gps", conv.swap_world(measurement.vel_n), cov)


def air_velocity(measurement: m.AirVelocity) -> object:
    """Build an ``air/velocity`` message, FLU."""
    cov = conv.swap_body_cov(measurement.cov_b)
    return twist_stamped(measurement.stamp_ns, "base_link", conv.swap_body(measurement.vel_b), cov)


def wind_message(stamp_ns: int, wind_n: np.ndarray, cov_wind: np.ndarray | None) -> object:
    """Build a wind message, ENU, from (2,) or (3,) NED components; the vertical variance is unknown where it has two."""
    wind, cov = np.zeros(3), np.diag([0.0, 0.0, m.UNKNOWN_VARIANCE])
    n = len(wind_n)
    wind[:n] = wind_n
    cov[:n, :n] = 0.0 if cov_wind is None else cov_wind
    return twist_stamped(stamp_ns, "map", conv.swap_world(wind), conv.swap_world_cov(cov))


def fluid_pressure(measurement: m.Pressure) -> object:
    """Build a pressure message, Pa."""
    return FluidPressure(_header(measurement.stamp_ns, "base_link"), float(measurement.pressure_pa), float(measurement.variance))


def temperature(measurement: m.AirTemperature) -> object:
    """Build an ``air/temperature`` message, degrees Celsius as its type says."""
    return Temperature(_header(measurement.stamp_ns, "base_link"), celsius(float(measurement.temperature_k)), float(measurement.variance))


def dme_range(measurement: m.SlantRange, max_range_m: float = 400.0e3) -> object:
    """Build a ``dme/range`` message; the station ident is the frame id, ``max_range_m`` its service range."""
    header = _header(measurement.stamp_ns, measurement.station)
    return Range(header, 0, 0.0, 0.0, max_range_m, float(measurement.range_m), float(measurement.variance))


def vor_bearing(measurement: m.VorBearing) -> object:
    """Build a ``vor/bearing`` message: the station ident is the frame id, yaw (0 east, left positive) 90 degrees minus the radial."""
    half = 0.5 * float(conv.yaw_of_heading(measurement.bearing_rad))
    pose = Pose(Point(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, math.sin(half), math.cos(half)))
    variances = [m.UNKNOWN_VARIANCE] * 5 + [float(measurement.variance)]
    return PoseStamped(_header(measurement.stamp_ns, measurement.station), PoseWithCovariance(pose, np.diag(variances).ravel()))


def odometry_from_solution(solution: m.NavSolution, origin: LocalFrame) -> object:
    """Build an Odometry message of a solution in the map frame of ``origin``.

    Pose in ENU of the origin's tangent plane (attitude and covariances turned into it), twist in base_link FLU.  What the solution does
    not have gets a variance of ``conversions.NOT_ESTIMATED`` and zeros; without attitude the twist is forward = north, left = west.
    """
    eye = np.eye(3) * conv.NOT_ESTIMATED
    has_pos, has_att, has_vel = solution.lat is not None, solution.q_nb is not None, solution.vel_n is not None
    q_nb = solution.q_nb if has_att else _NORTH_LEVEL
    place = (solution.lat, solution.lon, solution.height) if has_pos else (origin.lat, origin.lon, origin.height)
    cov_pos, cov_att = solution.cov_pos if has_pos else eye, solution.cov_att if has_att else eye
    position, q_map, cov_pos, cov_att = conv.map_from_local(*place, q_nb, cov_pos, cov_att, origin.origin_e, origin.C_le)
    vel_n, cov_vel = (solution.vel_n, solution.cov_vel) if has_vel else (np.zeros(3), eye)
    velocity, cov_vel = conv.body_velocity(vel_n, cov_vel, q_nb)
    has_rate = solution.angular_rate_b is not None
    rate = _flu(solution.angular_rate_b) if has_rate else Vector3(0.0, 0.0, 0.0)
    pose = Pose(Point(*position.tolist()), _quaternion(q_map))
    return Odometry(
        _header(solution.stamp_ns, "map"),
        "base_link",
        PoseWithCovariance(pose, _two_blocks(cov_pos, cov_att)),
        TwistWithCovariance(Twist(Vector3(*velocity.tolist()), rate), _two_blocks(cov_vel, _UNKNOWN_RATE if has_rate else eye)),
    )


_UNKNOWN_RATE = np.eye(3) * m.UNKNOWN_VARIANCE


def _two_blocks(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    full = np.zeros((6, 6))
    full[:3, :3] = upper
    full[3:, 3:] = lower
    return full.ravel()


def wind_from_solution(solution: m.NavSolution) -> object | None:
    """Build a navigator's wind message, None where it has no wind."""
    return None if solution.wind_n is None else wind_message(solution.stamp_ns, solution.wind_n, solution.cov_wind)


def truth_imu(block: TruthBlock, row: int) -> object:
    """Build a ``truth/imu`` message: ideal inertial sample with the true attitude, covariances exactly zero."""
    zero = np.zeros((3, 3))
    return _imu(block.stamps_ns[row], block.q_nb[row], zero, block.angular_rate_b[row], block.specific_force_b[row], _UNKNOWN)


def truth_odometry(block: TruthBlock, row: int, origin: LocalFrame) -> object:
    """Build a ``truth/odometry`` message in the map frame of ``origin``, covariances exactly zero."""
    zero = np.zeros((3, 3))
    solution = m.NavSolution(
        int(block.stamps_ns[row]),
        "truth",
        float(block.lat[row]),
        float(block.lon[row]),
        float(block.height[row]),
        np.ascontiguousarray(block.vel_n[row]),
        np.ascontiguousarray(block.q_nb[row]),
        block.angular_rate_b[row],
        cov_pos=zero,
        cov_vel=zero,
        cov_att=zero,
    )
    message = odometry_from_solution(solution, origin)
    message.twist.covariance[:] = 0.0
    return message


def truth_wind(block: TruthBlock, row: int) -> object:
    """Build a ``truth/wind`` message, covariance exactly zero."""
    return wind_message(block.stamps_ns[row], block.wind_n[row], np.zeros((3, 3)))


def clock(stamp_ns: int) -> object:
    """Build a ``/clock`` message."""
    return Clock(time_of(stamp_ns))


def diagnostics(stamp_ns: int, statuses: Sequence[tuple[str, int, str, dict[str, object]]]) -> object:
    """Build a DiagnosticArray.

    Parameters
    ----------
    stamp_ns : int
    statuses : sequence of (name, level, message, values)
        ``level`` is 0 ok, 1 warning, 2 error, 3 stale; ``values`` becomes key/value text, floats with six digits.
    """
    array = []
    for name, level, text, values in statuses:
        array.append(DiagnosticStatus(level, name, text, "", [KeyValue(key, _text(value)) for key, value in values.items()]))
    return DiagnosticArray(_header(stamp_ns, ""), array)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


_BUILDERS: dict[type, Callable] = {
    m.Attitude: imu_attitude,
    m.MagneticField: magnetic_field,
    m.GpsVelocity: gps_velocity,
    m.AirVelocity: air_velocity,
    m.Pressure: fluid_pressure,
    m.AirTemperature: temperature,
    m.SlantRange: dme_range,
    m.VorBearing: vor_bearing,
    m.GnssEpoch: cloud_of,
}


def encode(measurement: m.Measurement) -> object:
    """Build the message object of any sensor measurement (an :class:`ImuBlock` must hold one sample; see :func:`encode_cdr`)."""
    if isinstance(measurement, m.GpsPosition):
        return nav_sat_fix(measurement.stamp_ns, measurement.lat, measurement.lon, measurement.height, measurement.cov_n, "gps")
    if isinstance(measurement, m.ImuBlock) and len(measurement) == 1:
        return imu_raw(measurement.stamp_ns, measurement.specific_force_b[0], measurement.angular_rate_b[0])
    if isinstance(measurement, m.Attitude) and measurement.source == "gps/attitude":
        return gps_attitude(measurement)
    builder = _BUILDERS.get(type(measurement))
    if builder is None:
        raise TypeError(f"A {type(measurement).__name__} from {measurement.source} has no message of its own.")
    return builder(measurement)


def encode_cdr(measurement: m.Measurement) -> Iterator[tuple[int, str, str, bytes]]:
    """Yield (stamp_ns, topic, message type, CDR bytes) of a sensor measurement, one per sample of an :class:`ImuBlock`."""
    if isinstance(measurement, m.ImuBlock):
        rows = zip(measurement.stamps_ns.tolist(), imu_raw_cdr(measurement), strict=True)
        yield from ((stamp, measurement.source, topics.IMU, raw) for stamp, raw in rows)
        return
    message = encode(measurement)
    yield measurement.stamp_ns, measurement.source, message.__msgtype__, to_cdr(message)
