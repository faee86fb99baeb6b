"""ArduPilot's own logs, binary (.bin) and as text (.log): the file describes its messages itself, columns are cut out with numpy."""

from collections import defaultdict
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.units import GAUSS
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.air import RATIO_SIGMA, true_airspeed
from lowcostnav_ros.formats.log import ATTITUDE_SIGMA, AUTOPILOT, FormatError, Log, date_log, read_bytes, stacked
from lowcostnav_ros.formats.vehicle import remark_firmware
from lowcostnav_ros.gnss.gps_time import WEEK_NS, unix_ns
from lowcostnav_ros.physics.rotation import euler_to_quat

MAGIC = b"\xa3\x95"
TEXT_MAGIC = b"FMT, 128,"
_FMT, _FMT_SIZE = 128, 89
_TYPES = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8", "n": "S4", "N": "S16",
    "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "u1", "q": "<i8", "Q": "<u8", "g": "<f2",
}  # fmt: skip
_FACTORS = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
_MESSAGES = ("IMU", "MAG", "BARO", "GPS", "GPA", "ARSP", "ATT", "NKF1", "XKF1", "POS", "AHR2")

Columns = dict[str, np.ndarray]


def read(path: Path) -> Log:
    """Read a log; raises FormatError for one that holds no message that can be used."""
    raw = read_bytes(path)
    log = Log("ArduPilot dataflash")
    data = _text(raw, log) if raw.startswith(TEXT_MAGIC) else _binary(raw, log)
    data = {name: _first_instance(name, columns, log) for name, columns in data.items()}
    if not data:
        raise FormatError(f"{path} holds no sensor's message; check that logging was on (LOG_BITMASK) when it was recorded.")
    remark_firmware(log.account, raw)
    _inertial(log, data)
    _air(log, data)
    times = _gps(log, data)
    _own_solution(log, data)
    date_log(log, *times)
    return log


def _binary(raw: bytes, log: Log) -> dict[str, Columns]:
    sizes = bytearray(256)
    sizes[_FMT] = _FMT_SIZE
    formats: dict[int, tuple[str, str, list[str]]] = {}
    starts: dict[int, list[int]] = defaultdict(list)
    at, skipped, end = 0, 0, len(raw) - 3
    while at <= end:
        size = sizes[raw[at + 2]] if raw[at] == 0xA3 and raw[at + 1] == 0x95 else 0
        if not size or at + size > len(raw):
            found = raw.find(MAGIC, at + 1)
            skipped += (found if found > 0 else len(raw)) - at
            at = found if found > 0 else len(raw)
            continue
        kind = raw[at + 2]
        if kind == _FMT:
            described, length = raw[at + 3], raw[at + 4]
            name, packed, named = (raw[at + a : at + b].split(b"\0")[0].decode("ascii", "replace") for a, b in ((5, 9), (9, 25), (25, 89)))
            sizes[described], formats[described] = length, (name, packed, named.split(","))
        else:
            starts[kind].append(at)
        at += size
    if skipped:
        log.account.remark(f"{skipped} bytes belong to no message and were skipped.")
    data = {}
    for kind, places in starts.items():
        name, packed, names = formats[kind]
        if name in _MESSAGES:
            columns = _columns(raw, np.array(places), sizes[kind], packed, names)
            if columns is None:
                log.account.refused[f"{name} whose description does not fit its size"] += len(places)
            else:
                data[name] = columns
        else:
            log.account.left_out[name] += len(places)
    return data


def _columns(raw: bytes, places: np.ndarray, size: int, packed: str, names: list[str]) -> Columns | None:
    try:
        layout = np.dtype([(name, _TYPES[letter]) for name, letter in zip(names, packed, strict=True)])
    except (KeyError, ValueError):
        return None
    if layout.itemsize + 3 != size:
        return None
    rows = np.frombuffer(raw, np.uint8)[places[:, None] + np.arange(3, size)].copy().view(layout)[:, 0]
    return {name: rows[name] * _FACTORS.get(letter, 1) for name, letter in zip(names, packed, strict=True) if letter not in "anNZ"}


def _text(raw: bytes, log: Log) -> dict[str, Columns]:
    formats: dict[str, list[str]] = {}
    rows: dict[str, list[list[float]]] = defaultdict(list)
    for line in raw.decode("latin-1").splitlines():
        name, *cells = (cell.strip() for cell in line.split(","))
        if name == "FMT" and len(cells) > 4:
            formats[cells[2]] = cells[4:]
        elif name in _MESSAGES and len(cells) == len(formats.get(name, ())):
            try:
                rows[name].append([float(cell) for cell in cells])
            except ValueError:
                log.account.refused[f"{name} with a field that is no number"] += 1
        else:
            log.account.left_out[name[:8]] += 1
    return {name: dict(zip(formats[name], np.array(values).T, strict=True)) for name, values in rows.items()}


def _first_instance(name: str, columns: Columns, log: Log) -> Columns:
    """The rows of the first sensor of a kind, where later versions write several under one name."""
    instance = columns.get("I", columns.get("C"))
    if instance is None or not len(instance):
        return columns
    first = instance == instance.min()
    if not first.all():
        log.account.left_out[f"{name} of a further instance"] += int((~first).sum())
    return {key: column[first] for key, column in columns.items()}


def _stamps(columns: Columns) -> np.ndarray:
    """Time of writing, ns since the start: in us, in older versions in ms."""
    if "SampleUS" in columns and np.all(columns["SampleUS"] > 0):
        return columns["SampleUS"].astype(np.int64) * 1000
    return columns["TimeUS"].astype(np.int64) * 1000 if "TimeUS" in columns else columns["TimeMS"].astype(np.int64) * 1_000_000


def _inertial(log: Log, data: dict[str, Columns]) -> None:
    if (imu := data.get("IMU")) is not None:
        force, rate = stacked(imu, "AccX", "AccY", "AccZ"), stacked(imu, "GyrX", "GyrY", "GyrZ")
        log.add("imu/data_raw", _stamps(imu), "IMU: m/s^2, rad/s, forward right down", force=force, rate=rate)
    if (mag := data.get("MAG")) is not None:
        field = 1e-3 * GAUSS * stacked(mag, "MagX", "MagY", "MagZ")
        log.add("imu/mag", _stamps(mag), "MAG: milligauss, offsets of the autopilot applied", field=field, sigma=np.full(3, 5e-7))


def _air(log: Log, data: dict[str, Columns]) -> None:
    baro, airspeed = data.get("BARO"), data.get("ARSP")
    if baro is None or "Press" not in baro:
        return
    stamps, static = _stamps(baro), baro["Press"].astype(float)
    log.add("air/static_pressure", stamps, "BARO: Pa", value=static, sigma=20.0)
    if airspeed is None or not np.any(airspeed["Airspeed"] > 3.0):
        return
    at = _stamps(airspeed)
    calibrated = np.maximum(airspeed["Airspeed"].astype(float), 0.0)
    tas = np.array(true_airspeed(calibrated, np.interp(at, stamps, static)))
    origin = "ARSP: calibrated airspeed in m/s, made true by BARO and the standard temperature"
    log.add("air/velocity", at, origin, tas=tas, sigma=np.hypot(0.7, RATIO_SIGMA * tas))


def _gps(log: Log, data: dict[str, Columns]) -> tuple[np.ndarray, np.ndarray]:
    gps = data.get("GPS")
    if gps is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    fixed = gps["Status"] >= 3
    if not fixed.all():
        log.account.refused["no fix"] += int((~fixed).sum())
    gps = {name: column[fixed] for name, column in gps.items()}
    stamps, n = _stamps(gps), int(fixed.sum())
    if not n:
        return stamps, stamps
    lat, lon = np.radians(gps["Lat"]), np.radians(gps["Lng"])
    height = gps["Alt"] + undulation(lat, lon)
    accuracy = data.get("GPA")
    if accuracy is not None and "HAcc" in accuracy and len(accuracy["HAcc"]):
        row = np.clip(np.searchsorted(_stamps(accuracy), stamps), 0, len(accuracy["HAcc"]) - 1)
        floors = (("HAcc", 0.3), ("VAcc", 0.5), ("SAcc", 0.1))
        level, up, speed = (np.maximum(accuracy[name][row].astype(float), least) for name, least in floors)
        stated = "sigmas of GPA"
    else:
        level, speed, stated = 2.5 * np.clip(gps["HDop"].astype(float), 0.5, 50.0), np.full(n, 0.3), "sigmas of the dilution times 2.5 m"
        up = 1.7 * level
    sigma = np.stack([level / np.sqrt(2.0), level / np.sqrt(2.0), up], axis=1)
    origin = f"GPS: 1e-7 deg, m above sea level + shipped geoid, {stated}"
    log.add("gps/fix", stamps, origin, lat=lat, lon=lon, height=height, sigma=sigma)
    track, ground = np.radians(gps["GCrs"].astype(float)), gps["Spd"].astype(float)
    velocity = np.stack([ground * np.cos(track), ground * np.sin(track), gps["VZ"].astype(float)], axis=1)
    log.add("gps/vel", stamps, "GPS: m/s, track in deg, down", velocity=velocity, sigma=np.tile(speed[:, None], 3))
    week, ms = gps["GWk"].astype(np.int64), gps["GMS"].astype(np.int64)
    known = week > 1024
    utc = np.array([unix_ns(w * WEEK_NS + t * 1_000_000) for w, t in zip(week[known].tolist(), ms[known].tolist(), strict=True)], np.int64)
    return stamps[known], utc


def _own_solution(log: Log, data: dict[str, Columns]) -> None:
    attitude, place, filtered = data.get("ATT"), data.get("POS", data.get("AHR2")), data.get("XKF1", data.get("NKF1"))
    q_nb = None
    if attitude is not None and len(attitude["Roll"]):
        q_nb = np.array([euler_to_quat(*row) for row in np.radians(stacked(attitude, "Roll", "Pitch", "Yaw"))])
    if attitude is not None and q_nb is not None and not log.has("imu/data_raw"):
        origin = "ATT: the autopilot's own, deg, for want of inertial samples; sigmas assumed, 1 deg and 5 deg in heading"
        log.add_attitude(_stamps(attitude), origin, q_nb, None, ATTITUDE_SIGMA)
    if place is None or filtered is None or not log.has("gps/fix"):
        return
    there = (place["Lat"] != 0.0) | (place["Lng"] != 0.0)
    place = {name: column[there] for name, column in place.items()}
    stamps, lat, lon = _stamps(place), np.radians(place["Lat"].astype(float)), np.radians(place["Lng"].astype(float))
    velocity = np.stack([np.interp(stamps, _stamps(filtered), filtered[name]) for name in ("VN", "VE", "VD")], axis=1)
    fields = {"lat": lat, "lon": lon, "height": place["Alt"] + undulation(lat, lon), "velocity": velocity}
    if attitude is not None and q_nb is not None:
        fields["quaternion"] = q_nb[np.clip(np.searchsorted(_stamps(attitude), stamps), 0, len(q_nb) - 1)]
    log.add(AUTOPILOT, stamps, "position, EKF velocity and ATT: the autopilot's own solution, to compare with", **fields)
