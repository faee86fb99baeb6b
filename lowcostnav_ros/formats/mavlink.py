"""MAVLink 1 and 2: a PX4 or ArduPilot autopilot as the sensor box, live or from a telemetry log (.tlog).

The first autopilot that is heard is the source; others in the stream are left out.  Of several inertial messages the best is used:
HIGHRES_IMU, SCALED_IMU, then RAW_IMU, which ArduPilot sends in the same units, then SCALED_IMU2 and 3.  Stamps count from the autopilot's
start; SYSTEM_TIME gives UTC.  AIRSPEED, of the sensor, goes before VFR_HUD.  The eight bytes of time before each frame of a telemetry log
are skipped: they are the ground station's clock.
"""

import math
import struct
from binascii import crc_hqx
from collections.abc import Callable, Iterator

import numpy as np

from lowcostnav_ros.base.measurements import (
    UNKNOWN_VARIANCE,
    AirVelocity,
    Attitude,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    Measurement,
    Pressure,
)
from lowcostnav_ros.base.units import GAUSS, HECTOPASCAL, MILLI_G
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.air import RATIO_SIGMA, true_airspeed
from lowcostnav_ros.formats.framing import MORE, Protocol
from lowcostnav_ros.formats.log import ATTITUDE_SIGMA, AUTOPILOT, own_solution
from lowcostnav_ros.formats.mavlink_messages import CHECK_BYTES, LAYOUTS
from lowcostnav_ros.formats.parser import BOOT, Parser
from lowcostnav_ros.formats.vehicle import remark_type
from lowcostnav_ros.messages.kinds.imu import unaccelerated
from lowcostnav_ros.physics.rotation import euler_to_quat

_ARDUPILOT, _NO_AUTOPILOT, _PITOT, _UNHEALTHY = 3, 8, 16, 1
_RANK = {"HIGHRES_IMU": 5, "SCALED_IMU": 4, "RAW_IMU": 3, "SCALED_IMU2": 2, "SCALED_IMU3": 1}
_HELD_NS = 2 * 10**9
_UNIX_US = 10**15
_MAG_SIGMA_T = 5.0e-7
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def check_sum(body: bytes) -> int:
    """X.25 check sum: the CRC of the standard library, whose bits run the other way."""
    register = crc_hqx(body.translate(_REVERSED), 0xFFFF)
    return int(f"{register:016b}"[::-1], 2)


def _length_1(buffer: bytearray, start: int) -> int:
    return buffer[start + 1] + 8 if len(buffer) > start + 1 else MORE


def _length_2(buffer: bytearray, start: int) -> int:
    return buffer[start + 1] + 12 + 13 * (buffer[start + 2] & 1) if len(buffer) > start + 2 else MORE


def _is_sound_1(frame: bytes) -> bool:
    check = CHECK_BYTES.get(frame[5])
    return check is not None and check_sum(frame[1:-2] + bytes((check,))) == int.from_bytes(frame[-2:], "little")


def _is_sound_2(frame: bytes) -> bool:
    check, end = CHECK_BYTES.get(int.from_bytes(frame[7:10], "little")), 10 + frame[1]
    return check is not None and check_sum(frame[1:end] + bytes((check,))) == int.from_bytes(frame[end : end + 2], "little")


MAVLINK_1 = Protocol("MAVLink 1", b"\xfe", _length_1, _is_sound_1)
MAVLINK_2 = Protocol("MAVLink 2", b"\xfd", _length_2, _is_sound_2)

Message = dict[str, float]


class MavlinkParser(Parser):
    """Messages of one autopilot; its attitude comes as ``imu/data_fused``, its position as a solution of :data:`AUTOPILOT`."""

    protocols = (MAVLINK_1, MAVLINK_2)
    clock = BOOT

    def __init__(self) -> None:
        super().__init__()
        self._system: int | None = None
        self._is_ardupilot = self._has_pitot = False
        self._boot_ns = 0
        self._pitot_ns: int | None = None
        self._inertial: tuple[int, int] = (0, 0)
        self._static_pa: float | None = None
        self._slower: dict[str, tuple[float, ...]] = {}  # a slower sensor's value is repeated in the messages of a faster one
        self._attitude: np.ndarray | None = None
        self._handlers: dict[int, Callable[[Message], Iterator[Measurement]]] = {
            0: self._heartbeat, 1: self._status, 2: self._system_time, 24: self._gps, 29: self._pressure, 30: self._attitude_of,
            33: self._position, 74: self._hud, 295: self._airspeed,
        }  # fmt: skip

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Turn one frame into measurements."""
        one = protocol == MAVLINK_1.name
        system, number = (frame[3], frame[5]) if one else (frame[5], int.from_bytes(frame[7:10], "little"))
        payload = frame[6:-2] if one else frame[10 : 10 + frame[1]]
        layout = LAYOUTS.get(number)
        if layout is None:
            self.account.left_out[f"MAVLink message {number}"] += 1
            return
        try:
            message = layout.read(payload)
            if number == 0 and self._system is None and message["autopilot"] != _NO_AUTOPILOT:
                self._system = system
            if system != self._system:
                self.account.left_out["messages before the first heartbeat" if self._system is None else "another system"] += 1
                return
            if not all(map(math.isfinite, message.values())):
                self.account.refused[f"{layout.name} with a field that is not finite"] += 1
                return
            yield from self._inertial_of(layout.name, message) if layout.name in _RANK else self._handlers[number](message)
        except (struct.error, ValueError, OverflowError):
            self.account.refused[f"{layout.name} with a content that is none"] += 1

    def stepped_back(self) -> None:
        """An autopilot that was started anew: UTC is not known until it says so again."""
        self._newest.clear()
        self._inertial = (0, 0)
        self.utc_offset_ns = None

    def _heartbeat(self, message: Message) -> Iterator[Measurement]:
        self._is_ardupilot = message["autopilot"] == _ARDUPILOT
        remark_type(self.account, int(message["type"]))
        yield from ()

    def _status(self, message: Message) -> Iterator[Measurement]:
        self._has_pitot = bool(int(message["present"]) & _PITOT)
        yield from ()

    def _system_time(self, message: Message) -> Iterator[Measurement]:
        if message["time_unix_usec"] > _UNIX_US and message["time_boot_ms"]:
            offset_ns = int(message["time_unix_usec"]) * 1000 - int(message["time_boot_ms"]) * 1_000_000
            if self.utc_offset_ns is None:
                self.utc_offset_ns = offset_ns
            elif abs(offset_ns - self.utc_offset_ns) > 10**9:
                jump_s = 1e-9 * (offset_ns - self.utc_offset_ns)
                self.account.remark(f"SYSTEM_TIME changed by {jump_s:+.1f} s against the autopilot's own clock.")
        yield from ()

    def _micros(self, message: Message) -> int:
        """Boot time, ns, of a message whose time is in us, since the start or, by its size, since 1970."""
        time = int(message["time_usec"])
        if time > _UNIX_US:
            return 1000 * time - self.utc_offset_ns if self.utc_offset_ns is not None else self._boot_ns
        return 1000 * time or self._boot_ns

    def _inertial_of(self, name: str, message: Message) -> Iterator[Measurement]:
        rank, last_rank = _RANK[name], self._inertial[0]
        stamp_ns = int(message["time_boot_ms"]) * 1_000_000 if "time_boot_ms" in message else self._micros(message)
        if (name == "RAW_IMU" and not self._is_ardupilot) or (rank < last_rank and stamp_ns - self._inertial[1] < _HELD_NS):
            self.account.left_out[name] += 1
            return
        self._inertial, self._boot_ns = (rank, stamp_ns), stamp_ns
        force, rate, field = (np.array([message[axis + what] for axis in "xyz"]) for what in ("acc", "gyro", "mag"))
        high = name == "HIGHRES_IMU"
        if not high:
            force, rate, field = force * MILLI_G, rate * 1e-3, field * 1e-3
        updated = int(message.get("updated", 0)) if high else 0
        used = f"{name}: {'m/s^2, rad/s' if high else 'mg, mrad/s'}, forward right down"
        if np.any(force) and self.is_new("imu/data_raw", stamp_ns):
            self.account.origins["imu/data_raw"] = used
            yield ImuBlock.of("imu/data_raw", np.array([stamp_ns]), force[np.newaxis], rate[np.newaxis])
        is_fresh, self._slower["imu/mag"] = tuple(field) != self._slower.get("imu/mag"), tuple(field)
        if np.any(field) and is_fresh and (not updated or updated & 0b111000000) and self.is_new("imu/mag", stamp_ns):
            self.account.origins["imu/mag"] = f"{name}: {'gauss' if high else 'milligauss'}"
            yield MagneticField(stamp_ns, "imu/mag", field * GAUSS, _MAG_SIGMA_T**2 * np.eye(3))
        if high and message["abs_pressure"] and (not updated or updated & 0b1000000000):
            yield from self._static("HIGHRES_IMU", stamp_ns, message["abs_pressure"])

    def _static(self, name: str, stamp_ns: int, hectopascal: float) -> Iterator[Measurement]:
        self._static_pa = hectopascal * HECTOPASCAL
        is_fresh, self._slower["air/static_pressure"] = (hectopascal,) != self._slower.get("air/static_pressure"), (hectopascal,)
        if is_fresh and self.is_new("air/static_pressure", stamp_ns):
            self.account.origins["air/static_pressure"] = f"{name}: hPa"
            yield Pressure(stamp_ns, "air/static_pressure", self._static_pa, 20.0**2)

    def _pressure(self, message: Message) -> Iterator[Measurement]:
        if self._inertial[0] != _RANK["HIGHRES_IMU"]:
            yield from self._static("SCALED_PRESSURE", int(message["time_boot_ms"]) * 1_000_000, message["press_abs"])

    def _gps(self, message: Message) -> Iterator[Measurement]:
        if message["fix_type"] < 2 or not (message["lat"] or message["lon"]):
            self.account.refused["no fix"] += 1
            return
        if abs(message["lat"]) > 9e8 or abs(message["lon"]) > 1.8e9:
            raise ValueError
        stamp_ns = self._micros(message)
        if not self.is_new("gps/fix", stamp_ns):
            return
        lat, lon = math.radians(1e-7 * message["lat"]), math.radians(1e-7 * message["lon"])
        height = 1e-3 * message["alt_ellipsoid"] or 1e-3 * message["alt"] + float(undulation(lat, lon))
        stated = message["h_acc"] > 0.0
        level = 1e-3 * message["h_acc"] if stated else 2.5 * (0.01 * message["eph"] if message["eph"] < 65535 else 2.0)
        up = 1e-3 * message["v_acc"] if stated else 1.7 * level
        cov = np.diag([0.5 * level**2, 0.5 * level**2, up**2 if message["fix_type"] > 2 else 1.0e8])
        how = "mm above the ellipsoid" if message["alt_ellipsoid"] else "mm above sea level + shipped geoid"
        sigmas = "h_acc, v_acc" if stated else "the dilution times 2.5 m"
        self.account.origins["gps/fix"] = f"GPS_RAW_INT: 1e-7 deg, {how}, sigmas of {sigmas}"
        yield GpsPosition(stamp_ns, "gps/fix", lat, lon, height, cov)
        if message["vel"] < 65535 and (message["cog"] < 36001 or message["vel"] < 50):
            speed, towards = 0.01 * message["vel"], math.radians(0.01 * message["cog"]) if message["cog"] < 36001 else 0.0
            sigma = 1e-3 * message["vel_acc"] or 0.3
            self.account.origins["gps/vel"] = "GPS_RAW_INT: cm/s and track in 0.01 deg; no vertical velocity"
            vel_n = np.array([speed * math.cos(towards), speed * math.sin(towards), 0.0])
            yield GpsVelocity(stamp_ns, "gps/vel", vel_n, np.diag([sigma**2, sigma**2, UNKNOWN_VARIANCE]))

    def _attitude_of(self, message: Message) -> Iterator[Measurement]:
        stamp_ns = int(message["time_boot_ms"]) * 1_000_000
        self._boot_ns = max(self._boot_ns, stamp_ns)
        self._attitude = euler_to_quat(message["roll"], message["pitch"], message["yaw"])
        if self.is_new("imu/data_fused", stamp_ns):
            rate = np.array([message["rollspeed"], message["pitchspeed"], message["yawspeed"]])
            self.account.origins["imu/data_fused"] = "ATTITUDE: the autopilot's own, rad, taken as 1 deg and 5 deg in heading"
            yield Attitude(stamp_ns, "imu/data_fused", self._attitude, np.diag(ATTITUDE_SIGMA**2), rate, unaccelerated(self._attitude))

    def _position(self, message: Message) -> Iterator[Measurement]:
        stamp_ns = int(message["time_boot_ms"]) * 1_000_000
        if (message["lat"] or message["lon"]) and abs(message["lat"]) <= 9e8 and self.is_new(AUTOPILOT, stamp_ns):
            lat, lon = math.radians(1e-7 * message["lat"]), math.radians(1e-7 * message["lon"])
            height = 1e-3 * message["alt"] + float(undulation(lat, lon))
            vel_n = 0.01 * np.array([message["vx"], message["vy"], message["vz"]])
            self.account.origins.setdefault(AUTOPILOT, "GLOBAL_POSITION_INT, ATTITUDE: the autopilot's own solution, to compare with")
            row = {"lat": lat, "lon": lon, "height": height, "velocity": vel_n, "quaternion": self._attitude}
            yield own_solution(stamp_ns, row)

    def _airspeed(self, message: Message) -> Iterator[Measurement]:
        if message["id"]:
            self.account.left_out["AIRSPEED of a further sensor"] += 1
        elif int(message["flags"]) & _UNHEALTHY:
            self.account.refused["AIRSPEED of a sensor reported unhealthy"] += 1
        else:
            self._pitot_ns = self._boot_ns
            yield from self._true("AIRSPEED", message["airspeed"])

    def _hud(self, message: Message) -> Iterator[Measurement]:
        if self._pitot_ns is not None and self._boot_ns - self._pitot_ns < _HELD_NS:
            self.account.left_out["VFR_HUD beside AIRSPEED"] += 1
        elif self._has_pitot:
            yield from self._true("VFR_HUD", message["airspeed"])
        else:
            self.account.left_out["VFR_HUD airspeed without a pitot"] += 1

    def _true(self, name: str, cas: float) -> Iterator[Measurement]:
        if self._static_pa is None or not 0.0 <= cas < 300.0 or not self._boot_ns:
            self.account.left_out[f"{name} airspeed without a static pressure, or out of range"] += 1
        elif self.is_new("air/velocity", self._boot_ns):
            tas = true_airspeed(cas, self._static_pa)
            self.account.origins["air/velocity"] = f"{name}: calibrated airspeed in m/s, made true by pressure and standard temperature"
            cov = np.diag([1.0 + (RATIO_SIGMA * tas) ** 2, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
            yield AirVelocity(self._boot_ns, "air/velocity", np.array([tas, 0.0, 0.0]), cov)
