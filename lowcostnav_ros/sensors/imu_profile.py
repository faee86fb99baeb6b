"""IMU profiles: data-sheet numbers in data-sheet units, and the same numbers in SI for simulators and filters.

White noise comes in two conventions (Gebre-Egziabher 2004, chapters 3 and 5), and a profile states which one it uses by the
field it fills: ``noise_density_*`` is a spectral amplitude per root hertz; ``noise_per_sample_*`` is the standard deviation of
one sample at ``noise_rate_hz``, which is a density of ``sigma / sqrt(noise_rate_hz)``.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.documents import parse_yaml
from lowcostnav_ros.base.settings import SettingsError, from_mapping, group, setting
from lowcostnav_ros.base.units import DEGREE_PER_HOUR, MILLI_G


def _triple(description: str, unit: str, maximum: float | None = None) -> list:
    return setting([0.0, 0.0, 0.0], description, unit=unit, minimum=0.0, maximum=maximum)


@dataclass(frozen=True)
class GyroProfile:
    """Three rate gyros as their data sheet describes them; x, y, z per list, zero for "none" and for "constant" time constants."""

    noise_density_deg_per_h_per_rt_hz: list = _triple("White noise as spectral amplitude.", "deg/h/sqrt(Hz)")
    noise_per_sample_deg_per_s: list = _triple("White noise of one sample at noise_rate_hz.", "deg/s")
    turn_on_bias_deg_per_h: list = _triple("Turn-on to turn-on bias, 1 sigma.", "deg/h")
    bias_drift_deg_per_h: list = _triple("In-run bias drift (Gauss-Markov), 1 sigma.", "deg/h")
    bias_drift_tau_s: list = _triple("Correlation time of the bias drift.", "s")
    scale_factor_ppm: list = _triple("Scale factor error, 1 sigma.", "ppm", 200_000.0)
    scale_factor_tau_s: list = _triple("Correlation time of the scale factor, 0 for constant.", "s")
    range_deg_per_s: float = setting(0.0, "Full scale, 0 for unlimited.", unit="deg/s", minimum=0.0)
    range_options_deg_per_s: list = setting([], "Other full scales it can be had with.", unit="deg/s", minimum=0.0)
    bandwidth_hz: float = setting(0.0, "Bandwidth (-3 dB, second order), 0 for unlimited.", unit="Hz", minimum=0.0, maximum=10_000.0)
    resolution_deg_per_s: float = setting(0.0, "Smallest step, 0 for none.", unit="deg/s", minimum=0.0)
    g_sensitivity_deg_per_s_per_g: float = setting(0.0, "Rate error per specific force, 1 sigma.", unit="deg/s/g", minimum=0.0)
    misalignment_deg: float = setting(0.0, "Misalignment of the triad about each axis, 1 sigma.", unit="deg", minimum=0.0, maximum=10.0)
    warm_up_bias_deg_per_s: float = setting(0.0, "Bias at power-up that decays exponentially.", unit="deg/s", minimum=-10.0, maximum=10.0)
    warm_up_tau_s: float = setting(3600.0, "Time constant of the warm-up transient.", unit="s", minimum=1.0)
    scale_factor_ppm_per_k: list = setting([0.0] * 3, "Scale factor by temperature.", unit="ppm/K", minimum=-1e4, maximum=1e4)
    reference_c: float = setting(25.0, "Temperature at which the scale factor is one.", unit="degC", minimum=-60.0, maximum=100.0)


@dataclass(frozen=True)
class AccelerometerProfile:
    """Three accelerometers as their data sheet describes them; x, y, z per list."""

    noise_density_mg_per_rt_hz: list = _triple("White noise as spectral amplitude.", "mg/sqrt(Hz)")
    noise_per_sample_mg: list = _triple("White noise of one sample at noise_rate_hz.", "mg")
    turn_on_bias_mps2: list = _triple("Turn-on to turn-on bias, 1 sigma.", "m/s^2")
    bias_drift_mps2: list = _triple("In-run bias drift (Gauss-Markov), 1 sigma.", "m/s^2")
    bias_drift_tau_s: list = _triple("Correlation time of the bias drift.", "s")
    scale_factor_ppm: list = _triple("Scale factor error, 1 sigma.", "ppm", 200_000.0)
    scale_factor_tau_s: list = _triple("Correlation time of the scale factor, 0 for constant.", "s")
    range_g: float = setting(0.0, "Full scale, 0 for unlimited.", unit="g", minimum=0.0)
    range_options_g: list = setting([], "Other full scales it can be had with.", unit="g", minimum=0.0)
    bandwidth_hz: float = setting(0.0, "Bandwidth (-3 dB, RC section), 0 for unlimited.", unit="Hz", minimum=0.0, maximum=10_000.0)
    resolution_mg: float = setting(0.0, "Smallest step, 0 for none.", unit="mg", minimum=0.0)
    misalignment_deg: float = setting(0.0, "Misalignment of the triad about each axis, 1 sigma.", unit="deg", minimum=0.0, maximum=10.0)


@dataclass(frozen=True, slots=True, eq=False)
class TriadNoise:
    """Error model of three like sensors in SI (rad/s or m/s^2); every array has shape (3,).

    ``noise_density`` unit/sqrt(Hz); ``turn_on_sigma``, ``bias_sigma`` unit; ``bias_tau_s``, ``scale_tau_s`` seconds, ``inf`` where
    the error is constant; ``scale_sigma`` dimensionless.
    """

    noise_density: np.ndarray
    turn_on_sigma: np.ndarray
    bias_sigma: np.ndarray
    bias_tau_s: np.ndarray
    scale_sigma: np.ndarray
    scale_tau_s: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ImuNoise:
    """What a filter needs to know of an IMU, SI, every array of shape (3,), x y z.

    Attributes
    ----------
    gyro_noise_density, accel_noise_density
        rad/s/sqrt(Hz) and m/s^2/sqrt(Hz); the process noise PSD is the square.
    gyro_turn_on_sigma, accel_turn_on_sigma
        Constant part of the bias, rad/s and m/s^2.
    gyro_bias_sigma, accel_bias_sigma, gyro_bias_tau_s, accel_bias_tau_s
        Gauss-Markov part; sigma 0 and tau ``inf`` where there is none.
    gyro_scale_sigma, accel_scale_sigma, gyro_scale_tau_s, accel_scale_tau_s
        Scale factor error, dimensionless; tau ``inf`` for a constant.
    """

    gyro_noise_density: np.ndarray
    gyro_turn_on_sigma: np.ndarray
    gyro_bias_sigma: np.ndarray
    gyro_bias_tau_s: np.ndarray
    gyro_scale_sigma: np.ndarray
    gyro_scale_tau_s: np.ndarray
    accel_noise_density: np.ndarray
    accel_turn_on_sigma: np.ndarray
    accel_bias_sigma: np.ndarray
    accel_bias_tau_s: np.ndarray
    accel_scale_sigma: np.ndarray
    accel_scale_tau_s: np.ndarray


@dataclass(frozen=True)
class ImuProfile:
    """One IMU: name, origin of its numbers, gyros and accelerometers."""

    name: str = setting("ideal", "Name of the profile.")
    source: str = setting("", "Where the numbers come from.")
    rate_hz: float = setting(100.0, "Usual output rate.", unit="Hz", minimum=0.1, maximum=10_000.0)
    noise_rate_hz: float = setting(20.0, "Rate at which the per-sample noise figures hold.", unit="Hz", minimum=0.1, maximum=10_000.0)
    gyro: GyroProfile = group(GyroProfile)
    accelerometer: AccelerometerProfile = group(AccelerometerProfile)

    def __post_init__(self) -> None:
        for sensor, part in (("gyro", self.gyro), ("accelerometer", self.accelerometer)):
            for field, value in vars(part).items():
                if isinstance(value, list) and not field.startswith("range_options") and len(value) != 3:
                    raise SettingsError(f"Profile '{self.name}': '{sensor}.{field}' needs three numbers, x y z, got {len(value)}.")
        gyro, accel = self.gyro, self.accelerometer
        _one_convention(self.name, "gyro", gyro.noise_density_deg_per_h_per_rt_hz, gyro.noise_per_sample_deg_per_s)
        _one_convention(self.name, "accelerometer", accel.noise_density_mg_per_rt_hz, accel.noise_per_sample_mg)
        _drift_has_tau(self.name, "gyro", gyro.bias_drift_deg_per_h, gyro.bias_drift_tau_s)
        _drift_has_tau(self.name, "accelerometer", accel.bias_drift_mps2, accel.bias_drift_tau_s)

    @property
    def has_noise(self) -> bool:
        """Whether every sensor has white noise, without which no filter can fly on the numbers."""
        return bool(self.gyro_noise().noise_density.all() and self.accel_noise().noise_density.all())

    def gyro_noise(self, per_sample_as_density: bool = False) -> TriadNoise:
        """Error model of the gyros, rad/s; see :meth:`filter_noise` for the argument."""
        part = self.gyro
        per_sample = np.radians(part.noise_per_sample_deg_per_s)
        return TriadNoise(
            np.multiply(part.noise_density_deg_per_h_per_rt_hz, DEGREE_PER_HOUR) + self._density(per_sample, per_sample_as_density),
            np.multiply(part.turn_on_bias_deg_per_h, DEGREE_PER_HOUR),
            np.multiply(part.bias_drift_deg_per_h, DEGREE_PER_HOUR),
            _or_constant(part.bias_drift_tau_s),
            np.multiply(part.scale_factor_ppm, 1e-6),
            _or_constant(part.scale_factor_tau_s),
        )

    def accel_noise(self, per_sample_as_density: bool = False) -> TriadNoise:
        """Error model of the accelerometers, m/s^2; see :meth:`filter_noise` for the argument."""
        part = self.accelerometer
        per_sample = np.multiply(part.noise_per_sample_mg, MILLI_G)
        return TriadNoise(
            np.multiply(part.noise_density_mg_per_rt_hz, MILLI_G) + self._density(per_sample, per_sample_as_density),
            np.array(part.turn_on_bias_mps2),
            np.array(part.bias_drift_mps2),
            _or_constant(part.bias_drift_tau_s),
            np.multiply(part.scale_factor_ppm, 1e-6),
            _or_constant(part.scale_factor_tau_s),
        )

    def filter_noise(self, per_sample_as_density: bool = False) -> ImuNoise:
        """Return the numbers a navigation filter needs, all SI.

        Parameters
        ----------
        per_sample_as_density : bool
            Read per-sample figures as amplitudes per root hertz, as the covariance analyses of Gebre-Egziabher (2004), chapters
            5 to 7, do; the default divides them by the root of ``noise_rate_hz``, which is what the simulator produces.
        """
        gyro, accel = self.gyro_noise(per_sample_as_density), self.accel_noise(per_sample_as_density)
        return ImuNoise(*(getattr(triad, name) for triad in (gyro, accel) for name in TriadNoise.__dataclass_fields__))

    def _density(self, per_sample: np.ndarray, as_density: bool) -> np.ndarray:
        return per_sample if as_density else per_sample / np.sqrt(self.noise_rate_hz)


def imu_profile_from_text(text: str, where: str = "profile") -> ImuProfile:
    """Read a profile from YAML text; ``where`` names the source in a refusal.

    Raises
    ------
    SettingsError
        When the text is not YAML, a name is unknown, or a number is out of range.
    """
    values = parse_yaml(text, where)
    return from_mapping(ImuProfile, values if values is not None else {}, where)


def _or_constant(tau_s: list) -> np.ndarray:
    return np.array([tau if tau > 0.0 else np.inf for tau in tau_s])


def _one_convention(name: str, sensor: str, density: list, per_sample: list) -> None:
    if any(density) and any(per_sample):
        raise SettingsError(f"Profile '{name}': give the {sensor} noise either as a density or per sample, not both.")


def _drift_has_tau(name: str, sensor: str, sigma: list, tau_s: list) -> None:
    if any(s > 0.0 and t == 0.0 for s, t in zip(sigma, tau_s, strict=True)):
        raise SettingsError(f"Profile '{name}': the {sensor} bias drift needs a correlation time; put a constant into the turn-on bias.")
