"""Initial attitude of an inertial navigator, standing or on the move."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.kernels import kernel
from lowcostnav_ros.navigators.inertial import DEG
from lowcostnav_ros.settings import setting

STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class AlignmentSettings:
    """How the first attitude is found."""

    still_s: float = setting(2.0, "Average this long when standing.", unit="s", minimum=0.2, maximum=600.0)
    still_speed_mps: float = setting(0.5, "Below this GPS speed the vehicle stands.", unit="m/s", minimum=0.0, maximum=5.0)
    moving_speed_mps: float = setting(5.0, "Above this GPS speed the track gives the heading.", unit="m/s", minimum=0.5, maximum=100.0)
    heading_deg: list = setting([], "True heading when standing without a magnetometer; empty: unknown.", unit="deg", minimum=-360.0)
    heading_sigma_deg: float = setting(3.0, "Sigma of that heading.", unit="deg", minimum=0.1, maximum=90.0)
    track_sigma_deg: float = setting(12.0, "Sigma of heading minus track (wind drift).", unit="deg", minimum=0.5, maximum=60.0)
    magnetic_sigma_deg: float = setting(5.0, "Sigma of a heading taken from the magnetometer.", unit="deg", minimum=0.5, maximum=60.0)
    tilt_sigma_deg: float = setting(2.0, "Sigma of roll and pitch found on the move.", unit="deg", minimum=0.05, maximum=30.0)


@kernel
def tilt_from_specific_force(f_b, f_n, heading):
    """Roll and pitch that turn ``f_b`` into ``f_n`` at a given heading (least squares in pitch, exact in roll when reachable).

    Parameters
    ----------
    f_b : ndarray (3,)
        Mean specific force, FRD, m/s^2.
    f_n : ndarray (3,)
        Specific force expected in NED: acceleration minus gravity, (0, 0, -g) when unaccelerated.
    heading : float
        Rad.

    Returns
    -------
    roll, pitch : float
        Rad.
    """
    c, s = np.cos(heading), np.sin(heading)
    ahead, right, down = c * f_n[0] + s * f_n[1], -s * f_n[0] + c * f_n[1], f_n[2]
    length = np.sqrt(f_b[1] ** 2 + f_b[2] ** 2)
    roll = np.arcsin(min(1.0, max(-1.0, right / max(length, 1e-9)))) - np.arctan2(f_b[1], -f_b[2])
    z = np.sin(roll) * f_b[1] + np.cos(roll) * f_b[2]
    pitch = np.arctan2(ahead * z - down * f_b[0], ahead * f_b[0] + down * z)
    return roll, pitch


def unit_error(specific_force_b: np.ndarray, angular_rate_b: np.ndarray) -> str:
    """Name the likely unit error of an inertial stream from its means, or return an empty string."""
    force, rate = float(np.linalg.norm(specific_force_b)), float(np.linalg.norm(angular_rate_b))
    if 0.5 < force < 1.5:
        return f"specific force {force:.2f}: looks like g, m/s^2 wanted"
    if not 0.5 * STANDARD_GRAVITY < force < 3.0 * STANDARD_GRAVITY:
        return f"specific force {force:.2f} m/s^2 is not one g: wrong unit or axes"
    if rate > 10.0:
        return f"angular rate {rate:.0f}: looks like deg/s, rad/s wanted"
    return ""


class Levelling:
    """Running mean of inertial samples over a window, and whether they look still."""

    def __init__(self, window_s: float) -> None:
        self.window_s = window_s
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._stamps = np.empty(0, dtype=np.int64)
        self._samples = np.empty((0, 6))

    def add(self, block) -> None:
        """Take an ImuBlock in, forget what is older than twice the window."""
        self._stamps = np.concatenate((self._stamps, block.stamps_ns))
        self._samples = np.concatenate((self._samples, np.hstack((block.specific_force_b, block.angular_rate_b))))
        keep = self._stamps > self._stamps[-1] - 2e9 * self.window_s
        self._stamps, self._samples = self._stamps[keep], self._samples[keep]

    def mean(self, seconds: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Mean specific force and rate over the last ``seconds``, None when less is held."""
        if len(self._stamps) < 3 or self._stamps[-1] - self._stamps[0] < 0.9e9 * seconds:
            return None
        rows = self._samples[self._stamps > self._stamps[-1] - round(1e9 * seconds)]
        mean = rows.mean(axis=0)
        return mean[:3], mean[3:]

    def still(self, seconds: float) -> bool:
        """Whether half-second means over the last ``seconds`` stay together (0.15 m/s^2, 1 deg/s)."""
        rows = self._samples[self._stamps > self._stamps[-1] - round(1e9 * seconds)]
        parts = np.array_split(rows, max(2, int(2 * seconds)))
        means = np.array([p.mean(axis=0) for p in parts if len(p)])
        spread = np.ptp(means, axis=0)
        return bool(spread[:3].max() < 0.15 and spread[3:].max() < 1.0 * DEG)
