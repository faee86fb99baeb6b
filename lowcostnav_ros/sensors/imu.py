"""IMU simulator: what a low-cost inertial measurement unit makes of the true specific force and angular rate.

Per axis (Solimeno 2007, eq. 5-18..5-23; Gebre-Egziabher 2004, eq. 3.2-3.3):
``measured = true + turn-on bias + bias drift + scale factor * true + white noise``, then, where the profile has them,
bandwidth, misalignment, g-sensitivity, warm-up transient, scale factor by temperature, clipping and quantisation.  Noise densities of a
data sheet are those of the output, so the low-pass acts on the motion alone.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.base.units import MILLI_G
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.sensors.bandwidth import LowPass
from lowcostnav_ros.sensors.drift import DriftBank, slow_error
from lowcostnav_ros.sensors.imu_profile import ImuProfile, TriadNoise
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.sampling import SampleClock, means_between


@dataclass(frozen=True)
class ImuSimulatorSettings(SimulatorSettings):
    """Settings of the IMU simulator; the data-sheet numbers are in the profile."""

    profile: str = setting("automotive", "Name of the IMU profile (config/profiles) or path of a profile file.")
    rate_hz: float = setting(100.0, "Output rate; a divisor of the rate of the truth.", unit="Hz", minimum=1.0, maximum=2000.0)
    turn_on_bias: bool = setting(True, "Simulate the turn-on biases; off: a unit calibrated before the flight.")
    clipping: bool = setting(True, "Clip at the full scale of the profile.")
    quantisation: bool = setting(True, "Round to the resolution of the profile.")
    gyro_range_deg_per_s: float = setting(0.0, "Full scale of the gyros, 0 for the profile's usual one.", unit="deg/s", minimum=0.0)
    accel_range_g: float = setting(0.0, "Full scale of the accelerometers, 0 for the profile's usual one.", unit="g", minimum=0.0)
    bandwidth: bool = setting(False, "Simulate the bandwidth of the profile.")
    misalignment: bool = setting(False, "Simulate the misalignment of the profile.")
    g_sensitivity: bool = setting(False, "Simulate the g-sensitivity of the gyros.")
    warm_up: bool = setting(False, "Simulate the bias transient after power-up.")
    temperature_c: list = setting([], "Of the unit at power-up and once warm; empty: no effect.", unit="degC", minimum=-60.0, maximum=100.0)

    def __post_init__(self) -> None:
        if len(self.temperature_c) not in (0, 2):
            raise SettingsError(f"IMU: 'temperature_c' takes two numbers, at power-up and once warm, or none, got {self.temperature_c}.")


class _Triad:
    """Three like sensors: random errors, then the limits of the converter."""

    def __init__(self, noise: TriadNoise, settings: ImuSimulatorSettings, name: str, misalignment_rad: float) -> None:
        dt_s = 1.0 / settings.rate_hz
        seed = settings.seed
        sigma = np.concatenate((noise.turn_on_sigma * settings.turn_on_bias, noise.bias_sigma, noise.scale_sigma))
        tau_s = np.concatenate((np.full(3, np.inf), noise.bias_tau_s, noise.scale_tau_s))
        self._drift = DriftBank([slow_error(s, t) for s, t in zip(sigma, tau_s, strict=True)], dt_s, stream(seed, f"{name}.drift"))
        self._sample_sigma = noise.noise_density / np.sqrt(dt_s)
        self._noise_rng = stream(seed, f"{name}.noise")
        angles = misalignment_rad * stream(seed, f"{name}.misalignment").standard_normal(3)
        self._angles = angles if settings.misalignment else np.zeros(3)

    def corrupt(self, true: np.ndarray) -> np.ndarray:
        """Return the measured values (n, 3) before clipping; ``true`` (n, 3) in the same unit."""
        errors = self._drift.draw(len(true))
        seen = true - np.cross(self._angles, true)  # the triad is turned by the angles, so it sees the vector turned back
        white = self._sample_sigma * self._noise_rng.standard_normal(true.shape)
        return seen + errors[:, 0:3] + errors[:, 3:6] + errors[:, 6:9] * seen + white


@simulator("imu", Settings=ImuSimulatorSettings, truth=("truth/imu",), topics=("imu/data_raw",), needs="profile", usual=1)
class ImuSimulator:
    """Turn truth into the samples of one IMU; keeps its errors from call to call.

    Parameters
    ----------
    settings : ImuSimulatorSettings
    profile : ImuProfile
        The unit to simulate.
    source : str
        Source name of the measurements.
    """

    def __init__(self, settings: ImuSimulatorSettings, profile: ImuProfile, source: str = "imu/data_raw") -> None:
        self.settings, self.profile, self.source = settings, profile, source
        gyro, accel = profile.gyro, profile.accelerometer
        self._clock = SampleClock(settings.rate_hz)
        self._total, self._count = np.zeros(6), 0
        self._gyros = _Triad(profile.gyro_noise(), settings, "imu.gyro", np.radians(gyro.misalignment_deg))
        self._accels = _Triad(profile.accel_noise(), settings, "imu.accelerometer", np.radians(accel.misalignment_deg))
        g_sensitivity = np.radians(gyro.g_sensitivity_deg_per_s_per_g) / STANDARD_GRAVITY
        self._g_sensitivity = g_sensitivity * stream(settings.seed, "imu.gyro.g_sensitivity").standard_normal(3) * settings.g_sensitivity
        self._start_ns: int | None = None
        self._gyro_range = _full_scale("gyro", settings.gyro_range_deg_per_s, gyro.range_deg_per_s, gyro.range_options_deg_per_s, "deg/s")
        self._accel_range = _full_scale("accelerometer", settings.accel_range_g, accel.range_g, accel.range_options_g, "g")
        limits = ((accel.bandwidth_hz, 1), (gyro.bandwidth_hz, 2))  # an RC section and a second-order filter (Solimeno 2007, appendix C)
        self._low_passes = [LowPass(hz, order) if settings.bandwidth and hz > 0.0 else None for hz, order in limits]

    def simulate(self, truth: TruthBlock) -> list[ImuBlock]:
        """Return one block with the samples that fall into ``truth``, or nothing when none does.

        Each sample is the mean over the interval since the previous sample, as an integrating IMU delivers it.
        """
        rows = self._clock.rows(truth.stamps_ns)
        if len(truth) and self._start_ns is None:
            self._start_ns = int(truth.stamps_ns[0])
        motion = zip(self._low_passes, (truth.specific_force_b, truth.angular_rate_b), strict=True)
        both = np.hstack([true if low is None else low.mean_output(truth.stamps_ns, true) for low, true in motion])
        means, self._count = means_between(both, rows, self._total, self._count)
        if len(rows) == 0:
            return []
        stamps_ns = truth.stamps_ns[rows]
        force, rate = means[:, 0:3], means[:, 3:6]
        decay = self._decay(stamps_ns)
        measured_rate = self._gyros.corrupt(rate) + force * self._g_sensitivity + self._warm_up(decay)
        if self.settings.temperature_c:
            measured_rate = measured_rate + self._scale_change(decay) * rate
        return [ImuBlock.of(self.source, stamps_ns, self._limit_force(self._accels.corrupt(force)), self._limit_rate(measured_rate))]

    def _decay(self, stamps_ns: np.ndarray) -> np.ndarray:
        """What is left (n, 1) of the warming up; zero where nothing of it is simulated."""
        if not (self.settings.warm_up or self.settings.temperature_c):
            return np.zeros((len(stamps_ns), 1))
        elapsed_s = (stamps_ns - self._start_ns) * 1e-9
        # one by one: a vector unit may round otherwise
        return np.array([[math.exp(-t / self.profile.gyro.warm_up_tau_s)] for t in elapsed_s])

    def _warm_up(self, decay: np.ndarray) -> np.ndarray:
        return np.radians(self.profile.gyro.warm_up_bias_deg_per_s) * decay * self.settings.warm_up

    def _scale_change(self, decay: np.ndarray) -> np.ndarray:
        """Scale factor error (n, 3) at the temperature that the unit has (Gebre-Egziabher 2004, section 3.3.1)."""
        (cold_c, warm_c), gyro = self.settings.temperature_c, self.profile.gyro
        above_k = warm_c + (cold_c - warm_c) * decay - gyro.reference_c
        return 1e-6 * np.array(gyro.scale_factor_ppm_per_k) * above_k

    def _limit_rate(self, rate: np.ndarray) -> np.ndarray:
        gyro = self.profile.gyro
        return self._convert(rate, np.radians(self._gyro_range), np.radians(gyro.resolution_deg_per_s))

    def _limit_force(self, force: np.ndarray) -> np.ndarray:
        accel = self.profile.accelerometer
        return self._convert(force, self._accel_range * STANDARD_GRAVITY, accel.resolution_mg * MILLI_G)

    def _convert(self, values: np.ndarray, full_scale: float, step: float) -> np.ndarray:
        """Clip and round as the converter of the unit does; 0 switches either off."""
        if self.settings.clipping and full_scale > 0.0:
            values = np.clip(values, -full_scale, full_scale)
        if self.settings.quantisation and step > 0.0:
            values = np.round(values / step) * step
        return values


def _full_scale(sensor: str, wanted: float, usual: float, options: list, unit: str) -> float:
    """Full scale to fly with; one that the data sheet does not offer is refused."""
    if wanted == 0.0 or wanted == usual:
        return usual
    if wanted not in options:
        offered = ", ".join(f"{value:g}" for value in sorted({usual, *options} - {0.0})) or "none"
        raise SettingsError(f"A full scale of {wanted:g} {unit} is not on the {sensor}'s data sheet; it offers {offered} {unit}.")
    return wanted
