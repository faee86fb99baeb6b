"""Initial attitude of an inertial navigator: levelling, track, a given heading, the earth's rate, or another navigator's state."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock, NavSolution
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, CORE, POS, VEL
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.physics.earth import EARTH_RATE, STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import wrap


@dataclass(frozen=True)
class AlignmentSettings:
    """How the first attitude is found."""

    still_s: float = setting(2.0, "Average this long when standing.", unit="s", minimum=0.2, maximum=600.0)
    still_speed_mps: float = setting(0.5, "Below this GPS speed the vehicle stands.", unit="m/s", minimum=0.0, maximum=5.0)
    moving_speed_mps: float = setting(5.0, "Above this GPS speed the track gives the heading.", unit="m/s", minimum=0.5, maximum=100.0)
    heading_deg: list = setting([], "True heading at the start, without a magnetometer; empty: unknown.", unit="deg", minimum=-360.0)
    heading_sigma_deg: float = setting(3.0, "Sigma of that heading.", unit="deg", minimum=0.1, maximum=90.0)
    track_sigma_deg: float = setting(12.0, "Sigma of heading minus track (wind drift).", unit="deg", minimum=0.5, maximum=60.0)
    magnetic_sigma_deg: float = setting(5.0, "Sigma of a heading taken from the magnetometer.", unit="deg", minimum=0.5, maximum=60.0)
    any_heading: bool = setting(
        False, "The track is no heading (helicopter, multirotor, boat): without a compass all headings are tried until motion shows one."
    )
    tilt_sigma_deg: float = setting(2.0, "Sigma of roll and pitch found on the move.", unit="deg", minimum=0.05, maximum=30.0)
    gyrocompass: bool = setting(False, "Find the heading from the earth's rate when standing, before all else; still_s of minutes.")
    gyrocompass_limit_deg: float = setting(5.0, "Worse than this sigma it is refused.", unit="deg", minimum=0.01, maximum=45.0)
    master: str = setting("", "Odometry to take the first state from (transfer alignment), such as other/odometry; empty for none.")
    master_sigma_deg: float = setting(0.5, "How far the two units' axes may be apart.", unit="deg", minimum=0.001, maximum=10.0)


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


def transferred(solution: NavSolution, sigma_deg: float) -> tuple[np.ndarray, np.ndarray] | None:
    """State (10,) and core covariance (9, 9) from another navigator's solution, None where it lacks position, velocity or attitude.

    The units are taken as standing side by side with parallel axes but for ``sigma_deg``; a metre and a decimetre per second are allowed
    for the distance between them.
    """
    vel_n, q_nb, cov_vel, cov_att = solution.vel_n, solution.q_nb, solution.cov_vel, solution.cov_att
    if not solution.has_position or vel_n is None or q_nb is None or cov_vel is None or cov_att is None:
        return None
    nav = np.array([*solution.place, *vel_n, *q_nb])
    cov = np.zeros((CORE, CORE))
    cov[POS, POS] = solution.place_cov + np.eye(3) * 1.0**2
    cov[VEL, VEL] = cov_vel + np.eye(3) * 0.1**2
    cov[ATT, ATT] = cov_att + np.eye(3) * (sigma_deg * DEGREE) ** 2
    return (nav, cov) if np.isfinite(nav).all() and np.isfinite(cov).all() else None


def agrees_with_track(heading: float, track: float, choice: AlignmentSettings) -> bool:
    """Whether a given heading may be that of a vehicle on this track (rad): a number left over from another start may not."""
    return bool(abs(wrap(heading - track)) <= 3.0 * DEGREE * np.hypot(choice.heading_sigma_deg, choice.track_sigma_deg))


def gyrocompass(force_b: np.ndarray, rate_b: np.ndarray) -> float:
    """Heading, rad, of a vehicle at rest: the level direction in which its gyros measure the earth's rate.

    Parameters
    ----------
    force_b, rate_b : ndarray, shape (3,)
        Mean specific force, m/s^2, and angular rate, rad/s, FRD.

    References
    ----------
    Solimeno (2007), section 3.6: heading = atan2(-w_y', w_x') with w' the levelled rate.
    """
    roll, pitch = tilt_from_specific_force(force_b, np.array([0.0, 0.0, -STANDARD_GRAVITY]), 0.0)
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    level_x = cp * rate_b[0] + sp * (sr * rate_b[1] + cr * rate_b[2])
    level_y = cr * rate_b[1] - sr * rate_b[2]
    return float(np.arctan2(-level_y, level_x))


def gyrocompass_sigma(layout: Layout, lat: float, seconds: float) -> tuple[float, str]:
    """Sigma of a heading from the earth's rate, rad, and what limits it in words.

    sigma^2 = (bias^2 + noise^2 / seconds) / (Omega cos lat)^2 + (tilt tan lat)^2: the gyros' bias and white noise against the horizontal
    part of the earth's rate, and the tilt the accelerometers' bias leaves, through which the vertical part is measured.

    Parameters
    ----------
    layout : Layout
        Error state of the navigator: what its filter expects of the sensors.
    lat : float
        Rad.
    seconds : float
        Length of the average.
    """

    def start_sigma(*names: str) -> float:
        return float(np.sqrt(sum(np.max(layout.sigma0[layout[name]]) ** 2 for name in names if name in layout)))

    bias, tilt = start_sigma("gyro_bias", "gyro_drift"), start_sigma("accel_bias", "accel_drift") / STANDARD_GRAVITY
    noise = float(np.sqrt(np.max(layout.psd[ATT]) / seconds))
    horizontal = max(EARTH_RATE * np.cos(lat), 1e-12)
    sigma = float(np.hypot(np.hypot(bias, noise) / horizontal, tilt * np.tan(lat)))
    bias, noise, horizontal = (rate * 3600.0 / DEGREE for rate in (bias, noise, horizontal))
    return sigma, f"gyro bias {bias:.3g} deg/h and noise {noise:.3g} deg/h against {horizontal:.3g} deg/h of earth's rate"


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
    """Mean of inertial samples over a window, and whether they look still."""

    def __init__(self, window_s: float) -> None:
        self.window_s = window_s
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._blocks = deque[ImuBlock]()

    def add(self, block: ImuBlock) -> None:
        """Take an ImuBlock in, forget what is older than twice the window; samples are looked at when asked for, which is seldom."""
        self._blocks.append(block)
        while self._blocks[0].stamps_ns[-1] <= block.stamps_ns[-1] - 2e9 * self.window_s:
            self._blocks.popleft()

    def _held(self) -> tuple[np.ndarray, np.ndarray]:
        """Stamps (n,) and samples (n, 6), force before rate."""
        held = ImuBlock.joined(self._blocks)
        held = held[held.stamps_ns > held.stamps_ns[-1] - 2e9 * self.window_s]
        self._blocks = deque([held])
        return held.stamps_ns, np.hstack((held.specific_force_b, held.angular_rate_b))

    def mean(self, seconds: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Mean specific force and rate over the last ``seconds``, None when less is held."""
        stamps, samples = self._held() if self._blocks else (np.empty(0), np.empty((0, 6)))
        if len(stamps) < 3 or stamps[-1] - stamps[0] < 0.9e9 * seconds:
            return None
        mean = samples[stamps > stamps[-1] - round(1e9 * seconds)].mean(axis=0)
        return mean[:3], mean[3:]

    def still(self, seconds: float) -> bool:
        """Whether half-second means over the last ``seconds`` stay together (0.15 m/s^2, 1 deg/s)."""
        stamps, samples = self._held()
        parts = np.array_split(samples[stamps > stamps[-1] - round(1e9 * seconds)], max(2, int(2 * seconds)))
        means = np.array([p.mean(axis=0) for p in parts if len(p)])
        spread = np.ptp(means, axis=0)
        return bool(spread[:3].max() < 0.15 and spread[3:].max() < 1.0 * DEGREE)
