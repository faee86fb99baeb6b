"""Errors of the inertial sensors: settings as a data sheet states them, and the state blocks that model them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.units import DEGREE, MILLI_G
from lowcostnav_ros.calibration.imu_look import ImuLook
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov, random_walk
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.mounting import MOUNTING, check_mounting
from lowcostnav_ros.sensors.imu_profile import ImuNoise

XYZ = "xyz"
CONSTANT_S = 1e6
"""Correlation time of an error that the data sheet calls constant."""
PerAxis = float | list
"""One number for all axes, or three, x y z."""


def _axes(
    default: float, description: str, unit: str, minimum: float = 0.0, maximum: float | None = None, within: float | None = None
) -> Any:
    return setting(default, description, unit=unit, minimum=minimum, maximum=maximum, per_axis=True, within=within)


@dataclass(frozen=True)
class ImuSettings:
    """Inertial sensor errors as a data sheet states them, each one number or three (x y z, FRD); the defaults are a vibrating-gyro unit
    of automotive grade.
    """

    profile: str = setting("", "IMU profile (config/profiles, a file, or auto: by what it shows): sets those below left at their defaults.")
    gyro_noise_dps_rthz: PerAxis = _axes(0.012, "Gyro white noise.", "deg/s/sqrt(Hz)", 1e-7, 10.0, within=4)
    gyro_bias_dps: PerAxis = _axes(0.05, "Gyro in-run bias, Gauss-Markov sigma.", "deg/s", maximum=10.0, within=3)
    gyro_bias_tau_s: PerAxis = _axes(300.0, "Correlation time of the gyro bias.", "s", 1.0)
    gyro_turn_on_dps: PerAxis = _axes(0.1, "Gyro turn-on bias sigma.", "deg/s", maximum=10.0)
    gyro_scale_ppm: PerAxis = _axes(0.0, "Gyro scale-factor sigma; 0: no states.", "ppm", maximum=1e5)
    gyro_scale_tau_s: PerAxis = _axes(18000.0, "Correlation time of the gyro scale factors.", "s", 1.0)
    accel_noise_mg_rthz: PerAxis = _axes(0.25, "Accelerometer white noise.", "milli-g/sqrt(Hz)", 1e-6, 1e3, within=4)
    accel_bias_mg: PerAxis = _axes(1.2, "Accelerometer in-run bias, Gauss-Markov sigma.", "milli-g", maximum=1e3, within=3)
    accel_bias_tau_s: PerAxis = _axes(100.0, "Correlation time of the accelerometer bias.", "s", 1.0)
    accel_turn_on_mg: PerAxis = _axes(5.0, "Accelerometer turn-on bias sigma.", "milli-g", maximum=1e3)
    accel_scale_ppm: PerAxis = _axes(0.0, "Accelerometer scale-factor sigma; 0: no states.", "ppm", maximum=1e5)
    accel_scale_tau_s: PerAxis = _axes(18000.0, "Correlation time of the accelerometer scale factors.", "s", 1.0)
    mounting_deg: list = MOUNTING
    lever_arm_m: list = setting(
        [0.0] * 3, "IMU relative to base_link, of which the solutions are, forward, right, down.", unit="m", minimum=-100.0, maximum=100.0
    )

    def __post_init__(self) -> None:
        check_mounting(self.mounting_deg, "imu.mounting_deg")
        if len(self.lever_arm_m) != 3:
            raise SettingsError(f"'imu.lever_arm_m' needs three numbers, forward, right, down, got {len(self.lever_arm_m)}.")


def of_axes(value: PerAxis) -> np.ndarray:
    """x, y, z (3,) of a setting that holds one number for all axes or three."""
    return np.full(3, value, dtype=float)


def typical(value: PerAxis) -> float:
    """Root mean square over the axes, for what needs one number only (a threshold, a first tilt)."""
    return float(np.sqrt(np.mean(of_axes(value) ** 2))) if isinstance(value, list) else value


def imu_settings(noise: ImuNoise) -> ImuSettings:
    """Filter settings of an IMU profile's numbers, axis by axis; an error that is constant gets the correlation time of twelve days."""

    def axes(values: np.ndarray, unit: float = 1.0) -> PerAxis:
        listed = [float(v) / unit if np.isfinite(v) else CONSTANT_S for v in values]
        return listed[0] if len(set(listed)) == 1 else listed

    return ImuSettings(
        gyro_noise_dps_rthz=axes(noise.gyro_noise_density, DEGREE),
        gyro_bias_dps=axes(noise.gyro_bias_sigma, DEGREE),
        gyro_bias_tau_s=axes(noise.gyro_bias_tau_s),
        gyro_turn_on_dps=axes(noise.gyro_turn_on_sigma, DEGREE),
        gyro_scale_ppm=axes(noise.gyro_scale_sigma, 1e-6),
        gyro_scale_tau_s=axes(noise.gyro_scale_tau_s),
        accel_noise_mg_rthz=axes(noise.accel_noise_density, MILLI_G),
        accel_bias_mg=axes(noise.accel_bias_sigma, MILLI_G),
        accel_bias_tau_s=axes(noise.accel_bias_tau_s),
        accel_turn_on_mg=axes(noise.accel_turn_on_sigma, MILLI_G),
        accel_scale_ppm=axes(noise.accel_scale_sigma, 1e-6),
        accel_scale_tau_s=axes(noise.accel_scale_tau_s),
    )


AUTO, MARGIN = "auto", 1.5
"""Name of the profile that is seen; what is seen in a few seconds is doubted by so much."""
SCALED = 1.0 / 3.0, 30.0
"""Biases follow white noise, within these factors of the usual ones: a quiet unit may have a large bias all the same."""


def as_seen(imu: ImuSettings, look: ImuLook) -> ImuSettings:
    """Settings by what a unit shows: noise as seen, biases in proportion, turn-on biases at least as large as they are at rest.

    Values that are not the usual ones stay.
    """
    usual, values = ImuSettings(), dict[str, Any]()
    noise = {"gyro": ("dps", DEGREE, look.gyro_noise), "accel": ("mg", MILLI_G, look.accel_noise)}
    rest = {"gyro": float(np.abs(look.mean_rate).max()), "accel": abs(float(np.linalg.norm(look.mean_force)) - STANDARD_GRAVITY)}
    for sensor, (unit, scale, density) in noise.items():
        name, bias, turn_on = f"{sensor}_noise_{unit}_rthz", f"{sensor}_bias_{unit}", f"{sensor}_turn_on_{unit}"
        seen = min(max(MARGIN * float(density.max()) / scale, 1e-4), 10.0)
        factor = min(max(seen / getattr(usual, name), SCALED[0]), SCALED[1])
        felt = min(MARGIN * rest[sensor] / scale, 10.0 if unit == "dps" else 1e3) if look.is_at_rest else 0.0
        values |= {name: seen, bias: factor * getattr(usual, bias), turn_on: max(factor * getattr(usual, turn_on), felt)}
    return replace(imu, **{name: value for name, value in values.items() if getattr(imu, name) == getattr(usual, name)})


def times_the_profile(imu: ImuSettings, look: ImuLook) -> dict[str, float]:
    """How many times the settings' white noise each sensor shows, by its worst axis."""
    gyro, accel = of_axes(imu.gyro_noise_dps_rthz) * DEGREE, of_axes(imu.accel_noise_mg_rthz) * MILLI_G
    return {"gyro": float((look.gyro_noise / gyro).max()), "accelerometer": float((look.accel_noise / accel).max())}


def core_block(imu: ImuSettings) -> Block:
    """The nine core states; their psd entries are the sensors' white noise, resolved in b when used."""
    labels = (
        *("position_north_m", "position_east_m", "position_down_m"),
        *("velocity_north_mps", "velocity_east_mps", "velocity_down_mps"),
        *("attitude_north_rad", "attitude_east_rad", "attitude_down_rad"),
    )
    accel = (of_axes(imu.accel_noise_mg_rthz) * MILLI_G) ** 2
    gyro = (of_axes(imu.gyro_noise_dps_rthz) * DEGREE) ** 2
    return Block("core", labels, Kind.CORE, (10.0,) * 3 + (1.0,) * 3 + (0.1,) * 3, np.inf, (0.0, 0.0, 0.0, *accel, *gyro))


def bias_blocks(imu: ImuSettings, *, split_turn_on: bool = False) -> list[Block]:
    """Accelerometer and gyro biases, and scale factors where the data sheet gives them.

    One Gauss-Markov block per sensor whose start sigma holds the turn-on bias (15 states), or, with ``split_turn_on``, a random
    constant beside the drift (the thesis's 27).  A Gauss-Markov state would pull a turn-on bias toward zero with its own correlation
    time, so in the short form the drift is a random walk with the drift's short-term growth, 2 sigma^2 / tau.
    """
    blocks = []
    accel = (imu.accel_bias_mg, imu.accel_turn_on_mg, imu.accel_bias_tau_s)
    gyro = (imu.gyro_bias_dps, imu.gyro_turn_on_dps, imu.gyro_bias_tau_s)
    sensors = (("accel", "mps2", Kind.ACCEL_BIAS, MILLI_G, accel), ("gyro", "radps", Kind.GYRO_BIAS, DEGREE, gyro))
    for name, unit, kind, scale, values in sensors:
        sigma, turn_on, tau = of_axes(values[0]) * scale, of_axes(values[1]) * scale, of_axes(values[2])
        labels = [f"{name}_bias_{axis}_{unit}" for axis in XYZ]
        if split_turn_on:
            blocks.append(gauss_markov(f"{name}_drift", [f"{name}_drift_{axis}_{unit}" for axis in XYZ], kind, sigma, tau))
            blocks.append(random_walk(f"{name}_bias", labels, kind, turn_on))
        elif turn_on.any():
            blocks.append(random_walk(f"{name}_bias", labels, kind, np.hypot(turn_on, sigma), sigma * np.sqrt(2.0 / tau)))
        else:
            blocks.append(gauss_markov(f"{name}_bias", labels, kind, sigma, tau))
    for name, kind, ppm, tau_s in (
        ("accel", Kind.ACCEL_SCALE, of_axes(imu.accel_scale_ppm), imu.accel_scale_tau_s),
        ("gyro", Kind.GYRO_SCALE, of_axes(imu.gyro_scale_ppm), imu.gyro_scale_tau_s),
    ):
        if ppm.any():
            blocks.append(gauss_markov(f"{name}_scale", [f"{name}_scale_{axis}" for axis in XYZ], kind, 1e-6 * ppm, tau_s))
    return blocks
