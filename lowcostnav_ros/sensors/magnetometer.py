"""Magnetometer simulator: the earth's field seen through hard iron, soft iron, scale factors and a misaligned triad.

``measured = C_m C_sf C_si (B_b + hard iron) + white noise`` (Gebre-Egziabher 2004, eq. 3.28), in body axes.  The earth's field
comes from the magnetic model, so declination is in it and nothing else has to add it.  A calibrated magnetometer delivers the
true field plus a constant residual per axis and the noise.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import MagneticField
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.base.units import GAUSS
from lowcostnav_ros.physics.geomagnetism import DatedModel, check_year, year_setting
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.sampling import SampleClock, to_body

TESLA_PER_MG = 1.0e-3 * GAUSS


@dataclass(frozen=True)
class MagnetometerSimulatorSettings(SimulatorSettings):
    """Settings of the magnetometer simulator, in milligauss (1 mG = 1e-7 T)."""

    rate_hz: float = setting(20.0, "Output rate.", unit="Hz", minimum=0.1, maximum=1000.0)
    decimal_year: float = year_setting("Date of the flight for the magnetic model")
    noise_mg: float = setting(1.0, "White noise of one sample, 1 sigma (1 typical, 5 poor).", unit="mG", minimum=0.01, maximum=100.0)
    calibrated: bool = setting(True, "Deliver the calibrated field; iron, scale and misalignment then have no effect.")
    calibration_residual_mg: float = setting(4.0, "Constant error left by calibration, 1 sigma.", unit="mG", minimum=0.0, maximum=100.0)
    hard_iron_mg: list = setting([60.0, -40.0, 30.0], "Permanent magnetism of the aircraft, x y z.", unit="mG", minimum=-5e3, maximum=5e3)
    soft_iron: list = setting([0.0] * 9, "Induced magnetism, 3x3 row by row, added to the identity.", minimum=-0.9, maximum=0.9)
    scale_factor: list = setting([0.02, -0.015, 0.01], "Scale factor error, x y z.", minimum=-0.9, maximum=5.0)
    misalignment_deg: list = setting([0.0, 0.0, 0.0], "Small rotation of the triad about x y z.", unit="deg", minimum=-10.0, maximum=10.0)

    def __post_init__(self) -> None:
        for name, count in (("hard_iron_mg", 3), ("soft_iron", 9), ("scale_factor", 3), ("misalignment_deg", 3)):
            if len(getattr(self, name)) != count:
                raise SettingsError(f"Magnetometer: '{name}' needs {count} numbers, got {len(getattr(self, name))}.")
        check_year(self.decimal_year)


@simulator("magnetometer", Settings=MagnetometerSimulatorSettings, truth=("truth/odometry",), topics=("imu/mag",), usual=2)
class MagnetometerSimulator:
    """Turn truth into magnetic field measurements; keeps its errors from call to call."""

    def __init__(self, settings: MagnetometerSimulatorSettings, source: str = "imu/mag") -> None:
        self.settings, self.source = settings, source
        self._clock = SampleClock(settings.rate_hz)
        self._model = DatedModel(settings.decimal_year)
        self._noise_rng = stream(settings.seed, "magnetometer.noise")
        self._matrix, self._offset = _distortion(settings)
        systematic = settings.calibration_residual_mg if settings.calibrated else 0.0
        variance = (settings.noise_mg**2 + systematic**2) * TESLA_PER_MG**2
        self._cov_b = np.eye(3) * variance

    def simulate(self, truth: TruthBlock) -> list[MagneticField]:
        """Return the field measurements that fall into ``truth``.

        The stated covariance holds the noise and, when calibrated, the residual; a raw magnetometer's hard and soft iron is not in it.
        """
        rows = self._clock.rows(truth.stamps_ns)
        if len(rows) == 0:
            return []
        self._model.follow(int(truth.stamps_ns[rows[0]]))
        model = self._model.model
        if model is None:
            raise SettingsError(f"Magnetometer: {self._model.remark}")
        field_n = np.array([model.field_n(truth.lat[k], truth.lon[k], truth.height[k]) for k in rows])
        field_b = to_body(truth.q_nb[rows], field_n)
        noise = self._noise_rng.standard_normal(field_b.shape) * self.settings.noise_mg * TESLA_PER_MG
        return [
            MagneticField(int(truth.stamps_ns[row]), self.source, self._matrix @ field + self._offset + white, self._cov_b)
            for row, field, white in zip(rows, field_b, noise, strict=True)
        ]


def distortion_matrix(settings: MagnetometerSimulatorSettings) -> np.ndarray:
    """Return ``C_m C_sf C_si`` (3, 3), the linear part of the uncalibrated error model."""
    dx, dy, dz = np.radians(settings.misalignment_deg)
    misalignment = np.array([[1.0, dz, -dy], [-dz, 1.0, dx], [dy, -dx, 1.0]])
    scale = np.diag(1.0 + np.array(settings.scale_factor))
    soft_iron = np.eye(3) + np.reshape(settings.soft_iron, (3, 3))
    return misalignment @ scale @ soft_iron


def _distortion(settings: MagnetometerSimulatorSettings) -> tuple[np.ndarray, np.ndarray]:
    """Return matrix and offset (tesla) of ``measured = matrix @ field + offset``."""
    if settings.calibrated:
        residual = settings.calibration_residual_mg * stream(settings.seed, "magnetometer.residual").standard_normal(3)
        return np.eye(3), residual * TESLA_PER_MG
    matrix = distortion_matrix(settings)
    return matrix, matrix @ np.array(settings.hard_iron_mg) * TESLA_PER_MG
