"""Calibration results as the YAML that profiles and nodes load: text only, written by whoever owns the file."""

import math
from collections.abc import Mapping

from lowcostnav_ros.base.units import DEGREE, DEGREE_PER_HOUR, MILLI_G
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerCalibration, MagnetometerFit
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

GYRO_UNITS = {"rad/s": 1.0, "deg/s": DEGREE, "deg/h": DEGREE_PER_HOUR}
ACCELEROMETER_UNITS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": MILLI_G}


def profile_text(numbers: Mapping[str, tuple[float, float, float]], units: Mapping[str, str], rate_hz: float, source: str) -> str:
    """IMU profile of identified sensors.

    Parameters
    ----------
    numbers : mapping of column to (density, drift sigma, drift correlation time)
        unit/sqrt(Hz), unit, s.
    units : mapping of column to str
        One of :data:`GYRO_UNITS` or :data:`ACCELEROMETER_UNITS`.
    rate_hz : float
        Rate of the recording, Hz.
    source : str
        Where the numbers come from.

    Raises
    ------
    CalibrationError
        When the unit of a column is unknown, or there are neither one nor three columns of a quantity.
    """
    lines = [
        f"# Identified from a recording at rest: {source}.",
        "# One recording cannot show the turn-on bias: compare several power-ups and add it.",
        "name: identified",
        f"source: '{source.replace(chr(39), chr(39) * 2)}'",
        f"rate_hz: {rate_hz:.6g}",
    ]
    unknown = [name for name in numbers if units[name] not in GYRO_UNITS | ACCELEROMETER_UNITS]
    if unknown:
        raise CalibrationError(f"The unit of {', '.join(unknown)} is not known, so no profile can be written; give --unit.")
    gyros = _in_si(numbers, units, GYRO_UNITS)
    if gyros:
        lines += _block("gyro", gyros, "noise_density_deg_per_h_per_rt_hz", DEGREE_PER_HOUR, "bias_drift_deg_per_h", DEGREE_PER_HOUR)
    accels = _in_si(numbers, units, ACCELEROMETER_UNITS)
    if accels:
        lines += _block("accelerometer", accels, "noise_density_mg_per_rt_hz", MILLI_G, "bias_drift_mps2", 1.0)
    return "\n".join(lines) + "\n"


def calibration_text(calibration: MagnetometerCalibration, fit: MagnetometerFit, source: str) -> str:
    """Magnetometer calibration as a ROS parameter file, with its quality in the comments."""
    rows = ", ".join(_number(v) for v in calibration.matrix)
    return "\n".join(
        [
            f"# Magnetometer calibration ({fit.method}) from {source}: {fit.samples} samples, residual {fit.residual_rms:.3f} uT RMS.",
            f"# Coverage: {fit.coverage}.",
            f"# Hard iron sigma {', '.join(f'{v:.3f}' for v in fit.hard_iron_sigma)} uT; field = matrix (measured - hard iron), body axes.",
            *(f"# Note: {warning}" for warning in fit.warnings),
            "/**:",
            "  ros__parameters:",
            "    magnetometer:",
            f"      hard_iron_ut: [{', '.join(_number(v) for v in calibration.hard_iron_ut)}]",
            f"      matrix: [{rows}]",
            "",
        ]
    )


def _in_si(numbers: Mapping[str, tuple], units: Mapping[str, str], known: Mapping[str, float]) -> list[tuple[float, float, float]]:
    chosen = [(d * known[units[n]], s * known[units[n]], tau) for n, (d, s, tau) in numbers.items() if units[n] in known]
    if len(chosen) == 1:
        return chosen * 3
    if len(chosen) not in (0, 3):
        raise CalibrationError(f"A profile needs one or three columns of a quantity, got {len(chosen)}; choose them with --column.")
    return chosen


def _block(title: str, axes: list[tuple], density_name: str, density_unit: float, drift_name: str, drift_unit: float) -> list[str]:
    density = [d / density_unit for d, _, _ in axes]
    drift = [s / drift_unit if tau > 0.0 else 0.0 for _, s, tau in axes]
    tau_s = [tau if s > 0.0 else 0.0 for _, s, tau in axes]
    rows = {density_name: density, drift_name: drift, "bias_drift_tau_s": tau_s}
    return [f"{title}:", *(f"  {name}: [{', '.join(_number(v) for v in row)}]" for name, row in rows.items())]


def _number(value: float) -> str:
    """Seven digits, always with a decimal point, which YAML 1.1 needs to read a number with an exponent."""
    if not math.isfinite(value):
        raise CalibrationError("A number of the result is not finite; the data cannot carry this calibration.")
    text = f"{value:.7g}"
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text if "." in text or "e" in text else text + ".0"
