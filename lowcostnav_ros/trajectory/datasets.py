"""The ten-minute datasets LD, LD-gentle, HD and STR, with an IMU from the analytic derivatives.

Nothing here uses the strapdown code: specific force and rate follow from the derivatives of the profiles (equations 3-25, 3-26 inverted)
and are averaged over each interval by Boole's rule.  So the datasets are the independent truth the strapdown is tested against.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: sections 6.2, 7.1 and 7.4.1.  The thesis states limits only; the closed
forms are profiles that satisfy them.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import EARTH_RATE, gravity, radii
from lowcostnav_ros.physics.rotation import eulers_to_quat
from lowcostnav_ros.trajectory.profile import smooth_step, smooth_step_curvature, smooth_step_integral, smooth_step_rate
from lowcostnav_ros.trajectory.trajectory import Trajectory, integrate_position, piece_rows, stamps
from lowcostnav_ros.trajectory.truth_settings import TruthSettings

DURATION_S = 600.0
LAT_DEG, LON_DEG, HEIGHT_M = 38.7, -9.1, 500.0
_BANK_GRAVITY = 9.8  # the profile's own constant, roll = atan2(v_h psi_dot, 9.8)
_BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
_FINE = 8  # velocity samples per interval: position by Runge-Kutta at quarters, specific force at quarters


@dataclass(frozen=True, slots=True)
class Profile:
    """Prescribed motion and its derivatives at some times, each of shape (n,).

    Horizontal speed ``v_h``, heading ``psi`` and upward speed ``v_up``, SI and radians; ``_1`` and ``_2`` are time derivatives.
    """

    v_h: np.ndarray
    v_h_1: np.ndarray
    psi: np.ndarray
    psi_1: np.ndarray
    psi_2: np.ndarray
    v_up: np.ndarray
    v_up_1: np.ndarray


def low_dynamics(t: np.ndarray) -> Profile:
    """LD: a closed path of four 90-degree turns, 30 to 55 m/s, up to 4 m/s of climb."""
    w_h, w_up = 2.0 * math.pi / 75.0, 2.0 * math.pi / 150.0
    psi, psi_1, psi_2 = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for centre in (75.0, 225.0, 375.0, 525.0):
        x = (t - centre + 20.0) / 40.0
        psi += 0.5 * math.pi * smooth_step(x)
        psi_1 += 0.5 * math.pi / 40.0 * smooth_step_rate(x)
        psi_2 += 0.5 * math.pi / 1600.0 * smooth_step_curvature(x)
    v_h, v_h_1 = 42.5 + 12.5 * np.cos(w_h * t), -12.5 * w_h * np.sin(w_h * t)
    return Profile(v_h, v_h_1, psi, psi_1, psi_2, 4.0 * np.sin(w_up * t), 4.0 * w_up * np.cos(w_up * t))


def gentle(t: np.ndarray) -> Profile:
    """LD-gentle: one slow circle in ten minutes."""
    w_h, w_up, turn = 2.0 * math.pi / 300.0, 2.0 * math.pi / 150.0, 2.0 * math.pi / 600.0
    v_h, v_h_1 = 45.0 + 10.0 * np.cos(w_h * t), -10.0 * w_h * np.sin(w_h * t)
    still = np.zeros_like(t)
    return Profile(v_h, v_h_1, turn * t, still + turn, still, 4.0 * np.sin(w_up * t), 4.0 * w_up * np.cos(w_up * t))


def high_dynamics(t: np.ndarray) -> Profile:
    """HD: a widening ascending spiral, level loops with varying descent, a narrowing ascending spiral; 30 to 100 m/s."""
    x1, x2 = t / 200.0, (t - 400.0) / 200.0
    step1, step2 = smooth_step(x1), smooth_step(x2)
    rate1, rate2 = smooth_step_rate(x1) / 200.0, smooth_step_rate(x2) / 200.0
    degree = math.radians(1.0)
    psi = degree * (9.0 * t - 600.0 * smooth_step_integral(x1) + 600.0 * smooth_step_integral(x2))
    psi_1 = degree * (9.0 - 3.0 * step1 + 3.0 * step2)
    psi_2 = degree * 3.0 * (rate2 - rate1)
    v_up, v_up_1 = _high_dynamics_climb(t, step1, rate1)
    return Profile(30.0 + 70.0 * (step1 - step2), 70.0 * (rate1 - rate2), psi, psi_1, psi_2, v_up, v_up_1)


def _high_dynamics_climb(t: np.ndarray, climb: np.ndarray, climb_1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upward speed and its derivative: three phases, faded into each other by the gates a, b and out by c."""
    (a, a_1), (b, b_1), (c, c_1) = (_gate(t, begin, length) for begin, length in ((200.0, 10.0), (395.0, 10.0), (405.0, 195.0)))
    w = 2.0 * math.pi / 100.0
    sink, sink_1 = -3.0 + 2.0 * np.sin(w * (t - 200.0)), 2.0 * w * np.cos(w * (t - 200.0))
    v_up = 6.0 * climb * (1.0 - a) + sink * a * (1.0 - b) + 6.0 * b * (1.0 - c)
    first = 6.0 * (climb_1 * (1.0 - a) - climb * a_1)
    second = sink_1 * a * (1.0 - b) + sink * (a_1 * (1.0 - b) - a * b_1)
    return v_up, first + second + 6.0 * (b_1 * (1.0 - c) - b * c_1)


def _gate(t: np.ndarray, begin: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    x = (t - begin) / length
    return smooth_step(x), smooth_step_rate(x) / length


def straight(t: np.ndarray) -> Profile:
    """STR: uniform motion, which leaves yaw unobservable."""
    still = np.zeros_like(t)
    return Profile(still + 50.0, still, still + 0.3, still, still, still, still)


PROFILES: dict[str, Callable[[np.ndarray], Profile]] = {
    "LD": low_dynamics,
    "LD-gentle": gentle,
    "HD": high_dynamics,
    "STR": straight,
}


def attitude_of(p: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Euler angles (n, 3) roll, pitch, heading of a profile and their rates (n, 3), rad and rad/s."""
    speed2 = p.v_h**2 + p.v_up**2
    pitch_1 = (p.v_up_1 * p.v_h - p.v_up * p.v_h_1) / speed2
    side, side_1 = p.v_h * p.psi_1, p.v_h_1 * p.psi_1 + p.v_h * p.psi_2
    roll_1 = _BANK_GRAVITY * side_1 / (_BANK_GRAVITY**2 + side**2)
    angles = np.column_stack((np.arctan2(side, _BANK_GRAVITY), np.arctan2(p.v_up, p.v_h), p.psi))
    return angles, np.column_stack((roll_1, pitch_1, p.psi_1))


def velocity_of(p: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (n, 3) NED m/s of a profile and its derivative in n, m/s^2."""
    ch, sh = np.cos(p.psi), np.sin(p.psi)
    vel = np.column_stack((p.v_h * ch, p.v_h * sh, -p.v_up))
    forward, side = p.v_h_1, p.v_h * p.psi_1
    return vel, np.column_stack((forward * ch - side * sh, forward * sh + side * ch, -p.v_up_1))


def exact_imu(p: Profile, lat: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Specific force (n, 3) m/s^2 and angular rate (n, 3) rad/s in b at an instant, from the derivatives of the motion.

    f_b = C_bn (v_dot + (2 w_ie + w_en) x v - g) and w_ib_b = w_nb_b + C_bn (w_ie + w_en); ``lat`` (n,) rad, ``height`` (n,) m.
    """
    vel, vel_1 = velocity_of(p)
    angles, angles_1 = attitude_of(p)
    meridian, normal, down = _earth(lat, height)
    earth, transport = _frame_rates(lat, vel, meridian + height, normal + height)
    force_n = vel_1 + np.cross(2.0 * earth + transport, vel)
    force_n[:, 2] -= down
    C_bn = _dcm_bn(angles)
    force_b = np.einsum("nij,nj->ni", C_bn, force_n)
    return force_b, _euler_rates_to_body(angles, angles_1) + np.einsum("nij,nj->ni", C_bn, earth + transport)


@kernel
def _earth(lat, height):
    """Columns of meridian radius, normal radius (m) and gravity (m/s^2)."""
    out = np.empty((3, lat.size))
    for i in range(lat.size):
        out[0, i], out[1, i] = radii(lat[i])
        out[2, i] = gravity(lat[i], height[i])
    return out


def _frame_rates(lat: np.ndarray, vel: np.ndarray, along: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates of e relative to i and of n relative to e, (n, 3) rad/s, with the radii ``along`` the meridian and ``across`` it."""
    east = vel[:, 1] / across
    earth = EARTH_RATE * np.column_stack((np.cos(lat), np.zeros_like(lat), -np.sin(lat)))
    return earth, np.column_stack((east, -vel[:, 0] / along, -east * np.tan(lat)))


def _euler_rates_to_body(angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
    (cr, cp), (sr, sp) = np.cos(angles[:, :2]).T, np.sin(angles[:, :2]).T
    roll_1, pitch_1, psi_1 = rates.T
    return np.column_stack((roll_1 - psi_1 * sp, pitch_1 * cr + psi_1 * cp * sr, -pitch_1 * sr + psi_1 * cp * cr))


def _dcm_bn(angles: np.ndarray) -> np.ndarray:
    (cr, cp, ch), (sr, sp, sh) = np.cos(angles).T, np.sin(angles).T
    rows = (cp * ch, cp * sh, -sp, sr * sp * ch - cr * sh, sr * sp * sh + cr * ch, sr * cp)
    return np.array((*rows, cr * sp * ch + sr * sh, cr * sp * sh - sr * ch, cr * cp)).T.reshape(-1, 3, 3)


def build_dataset(settings: TruthSettings) -> Trajectory:
    """Dataset flight named by ``settings.name``; see :func:`lowcostnav_ros.trajectory.build`.

    It starts at 38.7 N 9.1 W, 500 m, in still air, and lasts 600 s; rate and time of the start come from the settings.

    Raises
    ------
    SettingsError
        For an unknown name or a duration beyond the ten minutes.
    """
    if settings.name not in PROFILES:
        raise SettingsError(f"There is no dataset '{settings.name}'{nearest(settings.name, PROFILES)}.")
    if settings.duration_s > DURATION_S:
        raise SettingsError(f"The datasets last {DURATION_S:g} s; ask for that or less, not {settings.duration_s:g} s.")
    profile, last = PROFILES[settings.name], round((settings.duration_s or DURATION_S) * settings.rate_hz)

    def pieces() -> Iterator[TruthBlock]:
        position = np.array([math.radians(LAT_DEG), math.radians(LON_DEG), HEIGHT_M])
        size = piece_rows(settings.rate_hz)
        for first in range(0, last, size):
            block, position = _piece(profile, settings, np.arange(first, min(first + size, last) + 1), position)
            yield block

    return Trajectory(settings.rate_hz, settings.start_ns, pieces)


def _piece(
    profile: Callable[[np.ndarray], Profile], settings: TruthSettings, rows: np.ndarray, position: np.ndarray
) -> tuple[TruthBlock, np.ndarray]:
    stamps_ns = stamps(settings.start_ns, settings.rate_hz, rows)
    t = (stamps_ns - settings.start_ns) * 1.0e-9
    fine = np.interp(np.arange(_FINE * (len(t) - 1) + 1) / _FINE, np.arange(len(t)), t)
    track = integrate_position(position[0], position[1], position[2], velocity_of(profile(fine))[0], np.diff(fine[::2]))
    quarters = profile(fine[::2])
    force, rate = (_boole(x) for x in exact_imu(quarters, track[:, 0].copy(), track[:, 2].copy()))
    quats = eulers_to_quat(attitude_of(quarters)[0])
    ends = slice(4, None, 4)
    vel = velocity_of(quarters)[0]
    lat, lon, height = track[ends].T.copy()
    return TruthBlock(stamps_ns[1:], lat, lon, height, vel[ends], quats[ends], force, rate, np.zeros_like(force)), track[-1]


def _boole(quarters: np.ndarray) -> np.ndarray:
    """Mean over each interval of values (4 n + 1, 3) at its quarters."""
    count = (len(quarters) - 1) // 4
    return sum(weight * quarters[j : j + 4 * count : 4] for j, weight in enumerate(_BOOLE))
