"""Ionosphere: Klobuchar's vertical cosine, its slant factor, how wrong it may be; total electron content and two frequencies.

References
----------
IS-GPS-200, 20.3.3.5.2.5; RTCA DO-229, appendix J.2.3 for the residual error.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss.gps_time import week_and_tow
from lowcostnav_ros.gnss.signals import L1_HZ, SPEED_OF_LIGHT

_SHELL_M = 350.0e3
_EARTH_M = 6378136.3
_ELECTRONS = 40.3
"""m^3/s^2: e^2/(8 pi^2 epsilon_0 m_e)."""


@dataclass(frozen=True, slots=True)
class Klobuchar:
    """The eight broadcast coefficients: ``alpha`` s, s/semicircle, ... and ``beta`` s, s/semicircle, ..."""

    alpha: tuple[float, float, float, float]
    beta: tuple[float, float, float, float]

    def delay_m(self, lat: float, lon: float, azimuth: np.ndarray, elevation: np.ndarray, gps: int, hz: float = L1_HZ) -> np.ndarray:
        """Delay of the code, m, on slant paths (n,) in directions in rad, at a GPS time in ns; scales with 1/frequency^2."""
        _, tow_s = week_and_tow(gps)
        coefficients = np.array((*self.alpha, *self.beta))
        azimuth, elevation = np.atleast_1d(azimuth).astype(float), np.atleast_1d(elevation).astype(float)
        return (L1_HZ / hz) ** 2 * _delays(coefficients, lat, lon, azimuth, elevation, tow_s)


@kernel
def _delays(c, lat, lon, azimuth, elevation, tow_s):
    """The algorithm of IS-GPS-200, angles in semicircles as there."""
    out = np.empty(azimuth.size)
    for k in range(azimuth.size):
        el = elevation[k] / math.pi
        psi = 0.0137 / (el + 0.11) - 0.022
        phi = min(max(lat / math.pi + psi * math.cos(azimuth[k]), -0.416), 0.416)
        pierce_lon = lon / math.pi + psi * math.sin(azimuth[k]) / math.cos(phi * math.pi)
        magnetic = phi + 0.064 * math.cos((pierce_lon - 1.617) * math.pi)
        local_s = (43200.0 * pierce_lon + tow_s) % 86400.0
        slant = 1.0 + 16.0 * (0.53 - el) ** 3
        amplitude, period = 0.0, 0.0
        for n in range(4):
            amplitude += c[n] * magnetic**n
            period += c[4 + n] * magnetic**n
        x = 2.0 * math.pi * (local_s - 50400.0) / max(period, 72000.0)
        delay_s = 5.0e-9
        if abs(x) < 1.57:
            delay_s += max(amplitude, 0.0) * (1.0 - x * x / 2.0 + x**4 / 24.0)
        out[k] = slant * delay_s * SPEED_OF_LIGHT
    return out


def code_delay_m(electrons_per_m2: np.ndarray | float, hz: float = L1_HZ) -> np.ndarray | float:
    """Delay of the code, m, behind a total electron content along the path: 40.3 TEC/f^2 (Solimeno 2007, section 2.3.3).

    The carrier is advanced by as much; the delay in seconds is 40.3 TEC/(c f^2).  One TEC unit, 1e16 electrons/m^2, is 0.162 m on L1.
    """
    return _ELECTRONS * electrons_per_m2 / hz**2


def electron_content(code_m: np.ndarray | float, other_m: np.ndarray | float, hz: float, other_hz: float) -> np.ndarray | float:
    """Total electron content, electrons/m^2, from pseudoranges (or minus carrier ranges, their ambiguities known) on two frequencies."""
    return (np.asarray(code_m) - other_m) / (_ELECTRONS * (1.0 / hz**2 - 1.0 / other_hz**2))


def ionosphere_free_m(code_m: np.ndarray | float, other_m: np.ndarray | float, hz: float, other_hz: float) -> np.ndarray | float:
    """Pseudorange, m, from two frequencies with the ionosphere taken off: (f1^2 R1 - f2^2 R2)/(f1^2 - f2^2)."""
    return (hz**2 * np.asarray(code_m) - other_hz**2 * np.asarray(other_m)) / (hz**2 - other_hz**2)


def slant_factor(elevation: np.ndarray) -> np.ndarray:
    """Slant over vertical delay through a thin shell at 350 km: 1/sqrt(1 - (R cos El/(R + h))^2)."""
    return 1.0 / np.sqrt(1.0 - (_EARTH_M * np.cos(elevation) / (_EARTH_M + _SHELL_M)) ** 2)


def residual_sigma_m(delay_m: np.ndarray, lat: float, elevation: np.ndarray, bound: bool = False) -> np.ndarray:
    """1-sigma of what the broadcast model leaves, m.

    Half the delay, as the model is meant to take off at least half (IS-GPS-200).  With ``bound``, what integrity is computed with
    (DO-229): the larger of a fifth of the delay and 9, 4.5 or 6 m times the slant factor, at latitudes up to 20, up to 55 and above
    55 deg; geographic latitude stands in for geomagnetic.
    """
    if not bound:
        return 0.5 * np.asarray(delay_m)
    degrees = abs(math.degrees(lat))
    vertical = 9.0 if degrees <= 20.0 else 4.5 if degrees <= 55.0 else 6.0
    return np.maximum(np.asarray(delay_m) / 5.0, vertical * slant_factor(elevation))
