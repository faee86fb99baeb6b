"""What an error of the magnetic field does to the heading, and the heading error model the navigators assume.

Gebre-Egziabher (2004), equations 3.48 and 3.82 to 3.86.  A heading error here is **measured minus true**, as in the source.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.calibration.allan import allan_chart
from lowcostnav_ros.calibration.allan_fit import fit_chart
from lowcostnav_ros.calibration.record import checked_record
from lowcostnav_ros.physics.rotation import euler_to_dcm, wrap
from lowcostnav_ros.physics.stochastic import GaussMarkov


@dataclass(frozen=True, slots=True)
class HeadingErrorModel:
    """Slow Gauss-Markov error plus white noise of a magnetic heading, rad and s.

    Attributes
    ----------
    slow : GaussMarkov
        Sigma 2.5 degrees, correlation time 120 s.
    white_sigma : float
        0.8 degrees at one heading per second.
    """

    slow: GaussMarkov = GaussMarkov(math.radians(2.5), 120.0)
    white_sigma: float = math.radians(0.8)


@dataclass(frozen=True, slots=True)
class HeadingErrorFit:
    """A heading error model out of residuals: mean, rad, and whether the record is long enough to show the correlation time."""

    model: HeadingErrorModel
    mean: float
    tau_observed: bool


def fit_heading_error(error: np.ndarray, rate_hz: float) -> HeadingErrorFit:
    """Fit white noise and a slow Gauss-Markov error to measured minus true headings, by their Allan variance.

    Parameters
    ----------
    error : ndarray, shape (n,)
        Rad, evenly spaced.
    rate_hz : float

    Raises
    ------
    CalibrationError
        For a record too short, with holes, or not finite.
    """
    error = checked_record(np.unwrap(error), rate_hz, "the heading error")
    fit = fit_chart(allan_chart(error, rate_hz))
    slow = GaussMarkov(fit.drift_sigma, max(fit.drift_tau_s, 1.0 / rate_hz))
    white = fit.white_density * math.sqrt(rate_hz)
    return HeadingErrorFit(HeadingErrorModel(slow, white), float(wrap(error.mean())), fit.drift_tau_observed)


def averaged_sigma(sample_sigma: float, samples: int) -> float:
    """Sigma of the mean of ``samples`` independent values: 3.5 degrees at 20 Hz are 0.8 degrees at 1 Hz (section 3.12)."""
    return sample_sigma / math.sqrt(samples)


def level_heading_error(heading: np.ndarray, error_x: float, error_y: float, horizontal: float) -> np.ndarray:
    """First-order heading error in level flight: -(dB_x sin + dB_y cos)/B_H, rad (equation 3.48).

    Parameters
    ----------
    heading : ndarray
        Magnetic heading, rad.
    error_x, error_y : float
        Field error on the forward and right axes.
    horizontal : float
        Horizontal field strength, same unit.
    """
    return -(error_x * np.sin(heading) + error_y * np.cos(heading)) / horizontal


def peak_heading_error(error_x: float, error_y: float, horizontal: float) -> float:
    """Greatest first-order heading error over all headings, rad."""
    return math.hypot(error_x, error_y) / horizontal


def two_axis_tilt_error(heading: float, roll: float, pitch: float, inclination: float) -> float:
    """Heading error, rad in (-pi, pi], of a compass that reads two body axes and is tilted (section 3.11.3, figure 3.16).

    Parameters
    ----------
    heading, roll, pitch : float
        Magnetic heading and tilt, rad.
    inclination : float
        Dip of the field, rad, positive down.
    """
    field_n = np.array([math.cos(inclination), 0.0, math.sin(inclination)])
    field_b = euler_to_dcm(roll, pitch, heading).T @ field_n
    return float(wrap(math.atan2(-field_b[1], field_b[0]) - heading))
