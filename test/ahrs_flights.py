"""A steady coordinated turn in closed form, as measurements: what the tests of the attitude reference fly."""

import math

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity, GpsVelocity, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.navigators.ahrs.navigator import AhrsSettings
from lowcostnav_ros.physics.magnetic_heading import MagneticReference
from lowcostnav_ros.physics.rotation import euler_to_dcm

T0 = 1_780_000_000_000_000_000
PLACE_DEG = (37.69, -121.82)
GRAVITY = 9.80
DEG = math.pi / 180.0
UNKNOWN = 1.0e6


def settings(**changes) -> AhrsSettings:
    """Settings of a small test: the place is known, the sensors are good."""
    values = {"place.lat_lon_deg": list(PLACE_DEG), "imu.gyro_turn_on_dps": 0.1, "imu.accel_turn_on_mg": 2.0}
    values["imu.gyro_noise_dps_rthz"] = 0.01
    return from_mapping(AhrsSettings, values | {k.replace("__", "."): v for k, v in changes.items()})


class Turn:
    """Level turn at constant speed and bank (zero bank: straight), heading ``heading0`` at ``T0``; the earth does not turn here."""

    def __init__(self, bank_deg: float = 0.0, speed: float = 50.0, heading0_deg: float = 40.0, pitch_deg: float = 0.0) -> None:
        self.bank, self.pitch, self.speed, self.heading0 = bank_deg * DEG, pitch_deg * DEG, speed, heading0_deg * DEG
        self.turn_rate = GRAVITY * math.tan(self.bank) / speed if speed else 0.0
        self.field_n = MagneticReference(2026.5, []).model.field_n(PLACE_DEG[0] * DEG, PLACE_DEG[1] * DEG, 0.0)

    def heading(self, t: float) -> float:
        """Rad at ``t`` seconds after T0."""
        return self.heading0 + self.turn_rate * t

    def dcm(self, t: float) -> np.ndarray:
        """C_nb."""
        return euler_to_dcm(self.bank, self.pitch, self.heading(t))

    def velocity(self, t: float) -> np.ndarray:
        """NED, m/s."""
        return self.speed * np.array([math.cos(self.heading(t)), math.sin(self.heading(t)), 0.0])

    def imu(self, start_s: float, stop_s: float, rate_hz: int = 100, gyro_bias=(0.0, 0.0, 0.0)) -> ImuBlock:
        """Exact samples: in a steady turn rate and specific force are constant in body axes."""
        n = round((stop_s - start_s) * rate_hz)
        stamps = T0 + round(start_s * 1e9) + (np.arange(1, n + 1) * 1_000_000_000) // rate_hz
        C = self.dcm(0.0)
        inward = self.speed * self.turn_rate * np.array([-math.sin(self.heading0), math.cos(self.heading0), 0.0])
        force = C.T @ (inward - np.array([0.0, 0.0, GRAVITY]))
        rate = C.T @ np.array([0.0, 0.0, self.turn_rate]) + np.array(gyro_bias)
        return ImuBlock.of("imu/data_raw", stamps, np.tile(force, (n, 1)), np.tile(rate, (n, 1)))

    def measurements(
        self, start_s: float, stop_s: float, sources: tuple[str, ...] = ("gps", "mag", "air"), gyro_bias=(0.0, 0.0, 0.0)
    ) -> list[Measurement]:
        """IMU in blocks of 0.1 s; GPS velocity and airspeed at 5 Hz, field at 10 Hz, in order of stamps."""
        found: list[Measurement] = []
        for k in range(round(start_s * 10), round(stop_s * 10)):
            t = 0.1 * (k + 1)
            stamp = T0 + 100_000_000 * (k + 1)
            found.append(self.imu(0.1 * k, t, gyro_bias=gyro_bias))
            if "mag" in sources:
                found.append(MagneticField(stamp, "imu/mag", self.dcm(t).T @ self.field_n, np.eye(3) * 1e-14))
            if "gps" in sources and k % 2:
                found.append(GpsVelocity(stamp, "gps/vel", self.velocity(t), np.eye(3) * 0.01))
            if "air" in sources and k % 2:
                found.append(AirVelocity(stamp, "air/velocity", np.array([self.speed, 0.0, 0.0]), np.diag([7.0, UNKNOWN, UNKNOWN])))
        return found
