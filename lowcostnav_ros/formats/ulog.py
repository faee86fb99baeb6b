"""PX4 logs (ULog, .ulg): sensors, GPS, airspeed and what the autopilot itself believed."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.units import GAUSS
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.log import ATTITUDE_SIGMA, AUTOPILOT, FormatError, Log, date_log, read_bytes, stacked
from lowcostnav_ros.formats.vehicle import remark_type
from lowcostnav_ros.physics import atmosphere

MAGIC = b"ULog\x01\x12\x35"
_TOPICS = (
    "sensor_combined", "vehicle_air_data", "sensor_baro", "vehicle_magnetometer", "vehicle_gps_position", "sensor_gps", "airspeed",
    "airspeed_validated", "vehicle_attitude", "vehicle_local_position",
)  # fmt: skip

Columns = dict[str, np.ndarray]


def read(path: Path) -> Log:
    """Read a log.

    Raises
    ------
    FormatError
        For a file that is damaged beyond use, or the reading library missing.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise FormatError("Reading a PX4 log needs pyulog, which is not installed: pip install pyulog.") from None
    try:
        source: Any = str(path) if path.suffix == ".ulg" else io.BytesIO(read_bytes(path))
        ulog = ULog(source, message_name_filter_list=list(_TOPICS))
    except FormatError:
        raise
    except Exception as error:  # a damaged file makes the library raise errors of many types
        raise FormatError(f"{path} is damaged ({type(error).__name__}: {error}); get it again from the autopilot.") from error
    log = Log("PX4 ULog")
    data: dict[str, Columns] = {}
    for one in ulog.data_list:
        if one.multi_id == 0:
            data.setdefault(one.name, one.data)
        else:
            log.account.left_out[f"{one.name} instance {one.multi_id}"] += len(one.data["timestamp"])
    if ulog.file_corruption:
        log.account.remark("The log is damaged in places; what is whole was read.")
    if ulog.dropouts:
        lost = sum(one.duration for one in ulog.dropouts)
        log.account.remark(f"The autopilot lost data {len(ulog.dropouts)} times, {1e-3 * lost:.1f} s in all.")
    remark_type(log.account, int(ulog.initial_parameters.get("MAV_TYPE", 0)))
    _inertial(log, data)
    _pressure(log, data)
    _airspeed(log, data)
    times = _gps(log, data)
    _own_solution(log, data)
    date_log(log, *times)
    return log


def _stamps(columns: Columns) -> np.ndarray:
    """Time of validity, ns since the start."""
    return columns.get("timestamp_sample", columns["timestamp"]).astype(np.int64) * 1000


def _axes(columns: Columns, name: str) -> np.ndarray:
    return stacked(columns, *(f"{name}[{axis}]" for axis in range(3)))


def _inertial(log: Log, data: dict[str, Columns]) -> None:
    imu = data.get("sensor_combined")
    if imu is not None:
        force, rate = _axes(imu, "accelerometer_m_s2"), _axes(imu, "gyro_rad")
        log.add("imu/data_raw", _stamps(imu), "sensor_combined: m/s^2, rad/s, forward right down", force=force, rate=rate)
    mag, name = data.get("vehicle_magnetometer"), "vehicle_magnetometer"
    if mag is None and imu is not None and "magnetometer_ga[0]" in imu:
        mag, name = _changed(imu, "magnetometer_ga[0]", "magnetometer_ga[1]", "magnetometer_ga[2]"), "sensor_combined"
    if mag is not None:
        log.add("imu/mag", _stamps(mag), f"{name}: gauss", field=GAUSS * _axes(mag, "magnetometer_ga"), sigma=np.full(3, 5e-7))


def _changed(columns: Columns, *names: str) -> Columns:
    """The rows at which a slower sensor, repeated in the rows of a faster one, has a new value."""
    values = stacked(columns, *names)
    new = np.concatenate([[True], np.any(np.diff(values, axis=0) != 0.0, axis=1)]) if len(values) else np.zeros(0, bool)
    return {name: column[new] for name, column in columns.items()}


def _pressure(log: Log, data: dict[str, Columns]) -> None:
    air, baro, imu = data.get("vehicle_air_data"), data.get("sensor_baro"), data.get("sensor_combined")
    if air is not None and "baro_pressure_pa" in air:
        stamps, value, origin = _stamps(air), air["baro_pressure_pa"], "vehicle_air_data: Pa"
    elif baro is not None and "pressure" in baro and len(baro["pressure"]):
        hecto = np.median(baro["pressure"]) < 2000.0
        stamps, value = _stamps(baro), baro["pressure"] * (100.0 if hecto else 1.0)
        origin = f"sensor_baro: {'hPa' if hecto else 'Pa'}, by its size"
    elif imu is not None and "baro_alt_meter" in imu:
        rows = _changed(imu, "baro_alt_meter")
        stamps, value = _stamps(rows), atmosphere.pressure(rows["baro_alt_meter"].astype(float))
        origin = "sensor_combined: barometric height in m, made pressure by the standard atmosphere"
    else:
        return
    log.add("air/static_pressure", stamps, origin, value=value.astype(float), sigma=20.0)


def _airspeed(log: Log, data: dict[str, Columns]) -> None:
    for name in ("airspeed_validated", "airspeed"):
        air = data.get(name)
        if air is not None and np.any(air["true_airspeed_m_s"] > 0.0):
            tas = air["true_airspeed_m_s"].astype(float)
            log.add("air/velocity", _stamps(air), f"{name}: true airspeed in m/s", tas=np.where(tas >= 0.0, tas, np.nan), sigma=0.7)
            return


def _gps(log: Log, data: dict[str, Columns]) -> tuple[np.ndarray, np.ndarray]:
    gps = data.get("vehicle_gps_position", data.get("sensor_gps"))
    if gps is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    fixed = gps["fix_type"] >= 3
    if not fixed.all():
        log.account.refused["no fix"] += int((~fixed).sum())
    gps = {name: column[fixed] for name, column in gps.items()}
    stamps = _stamps(gps)
    if "latitude_deg" in gps:
        lat, lon, height = gps["latitude_deg"], gps["longitude_deg"], gps["altitude_ellipsoid_m"]
    else:
        lat, lon, height = 1e-7 * gps["lat"], 1e-7 * gps["lon"], 1e-3 * gps["alt_ellipsoid"]
    unknown = height == 0.0  # a receiver that does not state the ellipsoid height
    if unknown.any() and "alt" in gps:
        height = np.where(unknown, 1e-3 * gps["alt"] + undulation(np.radians(lat), np.radians(lon)), height)
        log.account.remark("The receiver states no ellipsoid height: heights above sea level are raised by the shipped geoid, 0.5 m RMS.")
    if not len(stamps):
        return stamps, stamps
    sigma = np.stack([gps["eph"], gps["eph"], gps["epv"]], axis=1).astype(float)
    origin = "GPS: 1e-7 deg, mm above the ellipsoid, sigmas eph and epv"
    log.add("gps/fix", stamps, origin, lat=np.radians(lat), lon=np.radians(lon), height=height, sigma=np.maximum(sigma, 0.3))
    valid = gps["vel_ned_valid"].astype(bool)
    if not valid.all():
        log.account.refused["gps/vel: marked as not valid"] += int((~valid).sum())
    velocity = stacked(gps, "vel_n_m_s", "vel_e_m_s", "vel_d_m_s")[valid]
    speed_sigma = np.clip(gps["s_variance_m_s"].astype(float), 0.05, None)[valid]
    log.add("gps/vel", stamps[valid], "GPS: m/s north east down", velocity=velocity, sigma=np.tile(speed_sigma[:, None], 3))
    known = gps["time_utc_usec"] > 10**15
    return stamps[known], gps["time_utc_usec"][known].astype(np.int64) * 1000


def _own_solution(log: Log, data: dict[str, Columns]) -> None:
    attitude, place = data.get("vehicle_attitude"), data.get("vehicle_local_position")
    q_nb = None if attitude is None else stacked(attitude, *(f"q[{k}]" for k in range(4)))
    if attitude is not None and q_nb is not None and not log.has("imu/data_raw"):
        names = ("rollspeed", "pitchspeed", "yawspeed")
        rate = stacked(attitude, *names) if names[0] in attitude else None
        origin = "vehicle_attitude: the autopilot's own, for want of inertial samples; sigmas assumed, 1 deg and 5 deg in heading"
        log.add_attitude(_stamps(attitude), origin, q_nb, rate, ATTITUDE_SIGMA)
    if place is None or not np.any(place["xy_global"]) or not log.has("gps/fix"):
        return
    known = place["xy_global"].astype(bool) & place["z_global"].astype(bool)
    place = {name: column[known] for name, column in place.items()}
    stamps = _stamps(place)
    if not len(stamps):
        return
    lat0, lon0 = np.radians(place["ref_lat"].astype(float)), np.radians(place["ref_lon"].astype(float))
    north, east = place["x"].astype(float), place["y"].astype(float)
    lat, lon = _projected(lat0, lon0, north, east)
    height = place["ref_alt"].astype(float) - place["z"] + undulation(lat, lon)
    fields = {"lat": lat, "lon": lon, "height": height, "velocity": stacked(place, "vx", "vy", "vz")}
    if attitude is not None and q_nb is not None:
        fields["quaternion"] = q_nb[np.clip(np.searchsorted(_stamps(attitude), stamps), 0, len(q_nb) - 1)]
    log.add(AUTOPILOT, stamps, "vehicle_local_position, vehicle_attitude: the autopilot's own solution, to compare with", **fields)


_SPHERE_M = 6_371_000.0
"""Radius of the autopilot's own map projection, which is inverted with it."""


def _projected(lat0: np.ndarray, lon0: np.ndarray, north: np.ndarray, east: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undo the autopilot's azimuthal equidistant projection on its sphere."""
    x, y = north / _SPHERE_M, east / _SPHERE_M
    c = np.hypot(x, y)
    scale = np.where(c > 0.0, np.sin(c) / np.where(c > 0.0, c, 1.0), 1.0)
    lat = np.arcsin(np.clip(np.cos(c) * np.sin(lat0) + x * scale * np.cos(lat0), -1.0, 1.0))
    lon = lon0 + np.arctan2(y * scale, np.cos(lat0) * np.cos(c) - np.sin(lat0) * x * scale)
    return lat, lon
