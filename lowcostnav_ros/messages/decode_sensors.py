"""One function per kind of sensor message: message object in, measurement out, :class:`Refusal` for what cannot be used."""

import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from lowcostnav_ros.base.measurements import (
    AirTemperature,
    AirVelocity,
    Attitude,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    Pressure,
    SlantRange,
    VorBearing,
)
from lowcostnav_ros.base.units import kelvin
from lowcostnav_ros.messages import checks
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.rules import DecodeRules, Refusal
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import quat_to_dcm

Notes = Counter[str]


def _xyz(vector) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _imu_vectors(message, rules: DecodeRules) -> tuple[np.ndarray, np.ndarray]:
    """Return checked (specific force, angular rate), FRD."""
    checks.covariance(message.angular_velocity_covariance, "angular rate", may_be_zero=True)
    rate, force = _xyz(message.angular_velocity), _xyz(message.linear_acceleration)
    checks.finite(rate, "angular rate")
    checks.magnitude(rate, rules.max_angular_rate, "angular rate implausible, degrees per second?")
    checks.finite(force, "specific force")
    checks.magnitude(force, rules.max_specific_force, "specific force implausible")
    return conv.swap_body(np.array(force)), conv.swap_body(np.array(rate))


def imu_raw(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> ImuBlock:
    """Turn a message object into a measurement; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules, "imu/data_raw")
    checks.covariance(message.linear_acceleration_covariance, "specific force", may_be_zero=True)
    force, rate = _imu_vectors(message, rules)
    return ImuBlock(stamp_ns, source, np.array([stamp_ns]), force[np.newaxis], rate[np.newaxis])


def attitude_from_imu(message, source: str = "imu/data", rules: DecodeRules | None = None) -> Attitude:
    """Turn an Imu message object with orientation into an attitude; see :func:`attitude`."""
    return attitude(message, checks.stamp_ns(message.header), source, rules or DecodeRules(), Counter())


def attitude(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> Attitude:
    """Turn an Imu message object with orientation into an attitude.

    Where the message has no acceleration (its covariance begins with -1) the specific force of unaccelerated flight stands in, and
    ``notes`` says so.

    Raises
    ------
    Refusal
        For anything implausible, by a fixed phrase.
    """
    checks.frame(source, message.header.frame_id, rules, "imu/data")
    cov = checks.covariance(message.orientation_covariance, "orientation", source == "truth/imu")
    cov_att = _or_default(cov, source, rules, notes, conv.swap_world_cov)
    q = message.orientation
    checks.quaternion(q.x, q.y, q.z, q.w)
    q_nb = conv.quat_from_ros(q.x, q.y, q.z, q.w)
    force, rate = _imu_vectors(message, rules)
    if message.linear_acceleration_covariance[0] == -1.0:
        notes[f"{source}: specific force absent, that of unaccelerated flight used"] += 1
        force = quat_to_dcm(q_nb).T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
    return Attitude(stamp_ns, source, q_nb, cov_att, rate, force)


def gps_attitude(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> Attitude:
    """Turn an Imu message object with nothing but an orientation into an attitude at no rate, unaccelerated; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    cov = checks.covariance(message.orientation_covariance, "orientation")
    cov_att = _or_default(cov, source, rules, notes, conv.swap_world_cov)
    q = message.orientation
    checks.quaternion(q.x, q.y, q.z, q.w)
    q_nb = conv.quat_from_ros(q.x, q.y, q.z, q.w)
    force = quat_to_dcm(q_nb).T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
    return Attitude(stamp_ns, source, q_nb, cov_att, np.zeros(3), force)


def _or_default(cov: np.ndarray | None, source: str, rules: DecodeRules, notes: Notes, swap: Callable) -> np.ndarray:
    """Return the covariance in our axes, the default where it is unknown, or refuse where there is none."""
    return swap(cov) if cov is not None else np.diag(_default(source, rules, notes))


def _default(source: str, rules: DecodeRules, notes: Notes) -> tuple[float, ...]:
    default = rules.default_variances.get(source)
    if default is None:
        raise Refusal("covariance is unknown and no default is set")
    notes[f"{source}: covariance unknown, default used"] += 1
    return default


def magnetic(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> MagneticField:
    """Turn a message object into a measurement; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    field = _xyz(message.magnetic_field)
    checks.finite(field, "magnetic field")
    _refuse_wrong_field_unit(math.hypot(*field), rules.mag_range)
    cov = checks.covariance(message.magnetic_field_covariance, "magnetic field")
    return MagneticField(stamp_ns, source, conv.swap_body(np.array(field)), _or_default(cov, source, rules, notes, conv.swap_body_cov))


def _refuse_wrong_field_unit(norm: float, allowed: tuple[float, float]) -> None:
    low, high = allowed
    if low <= norm <= high:
        return
    for unit, factor in (("gauss", 1e-4), ("microtesla", 1e-6), ("milligauss", 1e-7), ("nanotesla", 1e-9)):
        if low <= norm * factor <= high:
            raise Refusal(f"magnetic field implausible, {unit} instead of tesla?", f"{norm:g}")
    raise Refusal("magnetic field implausible", f"{norm:g} T")


def gps_fix(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> GpsPosition:
    """Turn a message object into a measurement; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    lat, lon, height = checks.geodetic(message)
    cov = checks.covariance(message.position_covariance, "position")
    if message.position_covariance_type == 0:
        cov = None
    return GpsPosition(stamp_ns, source, lat, lon, height, _or_default(cov, source, rules, notes, conv.swap_world_cov))


def _twist(message, what: str, limit: float) -> tuple[np.ndarray, np.ndarray | None]:
    velocity = _xyz(message.twist.twist.linear)
    checks.finite(velocity, what)
    checks.magnitude(velocity, limit, f"{what} implausible")
    flat = np.reshape(message.twist.covariance, (6, 6))[:3, :3].ravel()
    return np.array(velocity), checks.covariance(flat, what)


def gps_velocity(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> GpsVelocity:
    """Turn a message object into a measurement; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    velocity, cov = _twist(message, "velocity", 600.0)
    return GpsVelocity(stamp_ns, source, conv.swap_world(velocity), _or_default(cov, source, rules, notes, conv.swap_world_cov))


def air_velocity(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> AirVelocity:
    """Turn a message object into a measurement; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    velocity, cov = _twist(message, "airspeed", 400.0)
    if velocity[0] < -50.0:
        raise Refusal("airspeed is negative", f"{velocity[0]:g} m/s")
    return AirVelocity(stamp_ns, source, conv.swap_body(velocity), _or_default(cov, source, rules, notes, conv.swap_body_cov))


def pressure(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> Pressure:
    """Turn a message object into a measurement; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    value = message.fluid_pressure
    checks.finite((value,), "pressure")
    (_refuse_static if source.endswith("static_pressure") else _refuse_dynamic)(value)
    variance = checks.variance(message.variance, "pressure")
    return Pressure(stamp_ns, source, value, _default(source, rules, notes)[0] if variance is None else variance)


def _refuse_static(value: float) -> None:
    if value < 0.0:
        raise Refusal("pressure is negative", f"{value:g} Pa")
    if 120.0 < value < 1200.0:  # Pa would be above 30 km
        raise Refusal("pressure implausible, hectopascal instead of pascal?", f"{value:g}")
    if 10.0 < value <= 120.0:
        raise Refusal("pressure implausible, kilopascal or inches of mercury instead of pascal?", f"{value:g}")
    if not 5.0e3 <= value <= 1.2e5:
        raise Refusal("pressure implausible", f"{value:g} Pa")


def _refuse_dynamic(value: float) -> None:
    if value < -500.0:  # at rest a differential sensor scatters around zero; refusing half of that would bias the rest
        raise Refusal("pressure is negative", f"{value:g} Pa")
    if value > 5.0e4:
        raise Refusal("pressure implausible", f"{value:g} Pa")


def temperature(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> AirTemperature:
    """Turn a message object, degrees Celsius as the type says, into a measurement in kelvin; raises Refusal."""
    checks.frame(source, message.header.frame_id, rules)
    value = message.temperature
    checks.finite((value,), "temperature")
    if 150.0 <= value <= 350.0:
        raise Refusal("temperature implausible, kelvin instead of degrees Celsius?", f"{value:g}")
    if not -120.0 <= value <= 80.0:
        raise Refusal("temperature implausible", f"{value:g} deg C")
    variance = checks.variance(message.variance, "temperature")
    return AirTemperature(stamp_ns, source, kelvin(value), _default(source, rules, notes)[0] if variance is None else variance)


def _station(header) -> str:
    """Return the station ident a header carries as its frame id."""
    station = header.frame_id.strip()
    if not station.isalnum() or len(station) > 8:
        raise Refusal("station ident missing", f"frame_id '{header.frame_id}'")
    return station


def dme_range(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> SlantRange:
    """Turn a message object into a measurement; raises Refusal."""
    station = _station(message.header)
    checks.finite((message.range,), "range")
    if message.range < 0.0:
        raise Refusal("range is negative", f"{message.range:g} m")
    if message.range > rules.max_range_m or 0.0 < message.max_range < message.range:
        raise Refusal("range is beyond the station's maximum", f"{message.range:g} m")
    variance = checks.variance(message.variance, "range")
    return SlantRange(stamp_ns, source, station, message.range, _default(source, rules, notes)[0] if variance is None else variance)


TILTED = 1.0e-3
"""Sine of half a tilt beyond which an orientation is that of a body, not a bearing."""
WIDEST = 0.25
"""Variance of a bearing, rad^2 (29 deg), beyond which it was stated in square degrees."""


def vor_bearing(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Notes) -> VorBearing:
    """Turn a message object, a rotation about up by 90 degrees minus the radial, into a measurement; raises Refusal."""
    station = _station(message.header)
    q, position = message.pose.pose.orientation, _xyz(message.pose.pose.position)
    checks.quaternion(q.x, q.y, q.z, q.w)
    if math.hypot(q.x, q.y) > TILTED:
        raise Refusal("roll or pitch is not zero, not a bearing?", f"x {q.x:g}, y {q.y:g}")
    checks.finite(position, "position")
    if any(position):
        raise Refusal("position is not zero, not a bearing?", f"{position}")
    variance = _yaw_variance(message.pose.covariance)
    radial = float(conv.heading_of_yaw(2.0 * math.atan2(q.z, q.w)))
    return VorBearing(stamp_ns, source, station, radial, _default(source, rules, notes)[0] if variance is None else variance)


def _yaw_variance(flat: np.ndarray) -> float | None:
    """Return the last variance of a (36,) pose covariance, None where all is zero, which means unknown."""
    variance = float(flat[35])
    if variance == 0.0 and np.any(flat):
        raise Refusal("bearing covariance has a zero variance")
    variance = checks.variance(variance, "bearing")
    if variance is not None and variance > WIDEST:
        raise Refusal("bearing variance implausible, square degrees instead of square radians?", f"{variance:g}")
    return variance
