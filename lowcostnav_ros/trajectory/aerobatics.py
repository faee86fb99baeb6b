"""An aerobatic flight: loops, rolls, 5 g turns and inverted flight of a point mass that answers load factor and roll rate.

Velocity turns in the frame of the airflow with

    q_w = (n g + g_z) / V,    r_w = g_y / V,    dV/dt = f_x + g_x

for load factor n and gravity g resolved in that frame (flight without sideslip force; Stevens and Lewis 2016, section 2.6); the body x
axis is a constant incidence above the airflow.  Load factor and roll rate follow their commands through two equal lags, so that the
inertial sensors see continuous rates.
"""

import math
from collections.abc import Iterator

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import eulers_to_quat, quat_from_rotvec, quat_multiply, quat_to_dcm
from lowcostnav_ros.trajectory.trajectory import Trajectory, pieces_of_motion
from lowcostnav_ros.trajectory.truth_settings import TruthSettings
from lowcostnav_ros.trajectory.wind import Wind

HOLD, LOOP, ROLL = 0.0, 1.0, 2.0
PROGRAMME = np.array(
    [
        (HOLD, 0.0, 20.0),  # level
        (HOLD, 30.0, 15.0),
        (LOOP, 5.0, 30.0),  # g
        (HOLD, 0.0, 8.0),
        (ROLL, 120.0, 10.0),  # deg/s, right
        (HOLD, 0.0, 6.0),
        (HOLD, 78.463, 12.0),  # deg of bank: level turn at 5 g
        (HOLD, 0.0, 6.0),
        (HOLD, 180.0, 10.0),  # inverted
        (HOLD, 0.0, 6.0),
        (ROLL, -180.0, 10.0),
        (HOLD, -60.0, 15.0),
        (LOOP, 5.0, 30.0),
        (HOLD, 0.0, 20.0),
    ]
)
"""The figures, (kind, value, longest duration in s): a bank held in level flight, a loop at a load factor, one roll at a rate."""
LAG_S, FASTEST_ROLL, LARGEST_THRUST = 0.12, math.radians(150.0), 6.0


class AerobaticMotion:
    """The flight as functions of time (see :class:`~lowcostnav_ros.trajectory.trajectory.Motion`), tabled at half the sampling interval."""

    def __init__(self, settings: TruthSettings, seed: int) -> None:
        start = settings.start
        self.lat, self.lon, self.height = math.radians(start.lat_deg), math.radians(start.lon_deg), start.height_m
        self._wind = Wind(settings.wind, seed, start.height_m, start.airspeed_mps)
        self._per_s = 2 * settings.rate_hz
        heading = eulers_to_quat(np.array([[0.0, 0.0, math.radians(start.heading_deg)]]))[0]
        incidence = eulers_to_quat(np.array([[0.0, math.radians(settings.incidence_deg), 0.0]]))[0]
        steps = math.ceil(PROGRAMME[:, 2].sum() * self._per_s)
        self._table = _fly(PROGRAMME, heading, incidence, start.airspeed_mps, 1.0 / self._per_s, steps)
        self.duration_s = (len(self._table) - 1) / self._per_s

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity over ground (n, 3), ``q_nb`` (n, 4) and wind (n, 3) at ``t_s`` seconds."""
        rows = self._table[np.minimum(np.rint(t_s * self._per_s).astype(int), len(self._table) - 1)]
        wind = self._wind.at(t_s, self.height + rows[:, 7])
        return rows[:, 0:3] + wind, rows[:, 3:7], wind


@kernel
def _fly(programme, heading, incidence, speed, dt, steps):
    """Velocity through the air (3), q_nb (4) and height gained, one row a step."""
    out, q, v, height = np.zeros((steps + 1, 8)), heading.copy(), speed, 0.0
    n, n_lag, p, p_lag = 1.0, 1.0, 0.0, 0.0
    phase, since_s, turned, count = 0, 0.0, 0.0, 0
    for k in range(steps + 1):
        C = quat_to_dcm(q)
        out[k, 0:3], out[k, 3:7], out[k, 7] = v * C[:, 0], quat_multiply(q, incidence), height
        count = k + 1
        kind, value, longest_s = programme[phase]
        whole = 2.0 * np.pi - 2.0 * LAG_S * abs(p if kind == ROLL else n * STANDARD_GRAVITY / v)
        if since_s >= longest_s or (kind != HOLD and turned >= whole):
            phase, since_s, turned = phase + 1, 0.0, 0.0
            if phase == len(programme):
                break
            kind, value, longest_s = programme[phase]
        sine = min(max(-C[2, 0], -1.0), 1.0)
        cosine = np.sqrt(1.0 - sine * sine)
        bank = np.arctan2(C[2, 1], C[2, 2])
        n_wanted, p_wanted = value, 0.0
        if kind == ROLL:
            n_wanted, p_wanted = 0.3, value * np.pi / 180.0
        elif kind == HOLD:
            target = value * np.pi / 180.0
            off = (target - bank + np.pi) % (2.0 * np.pi) - np.pi
            p_wanted = min(max(2.0 * off, -FASTEST_ROLL), FASTEST_ROLL)
            climb = min(max(-height / (8.0 * v), -0.25), 0.25)
            level = cosine + v / STANDARD_GRAVITY * min(max(0.8 * (climb - np.arcsin(sine)), -0.3), 0.3)
            lift = np.cos(bank)
            n_wanted = min(max(level * lift / max(lift * lift, 0.03), -2.0), 6.0)
        n_lag += (n_wanted - n_lag) * dt / LAG_S
        n += (n_lag - n) * dt / LAG_S
        p_lag += (p_wanted - p_lag) * dt / LAG_S
        p += (p_lag - p) * dt / LAG_S
        g_x, g_y, g_z = C[2, 0] * STANDARD_GRAVITY, C[2, 1] * STANDARD_GRAVITY, C[2, 2] * STANDARD_GRAVITY
        rate = np.array([p, (n * STANDARD_GRAVITY - g_z) / v, g_y / v])
        thrust = min(max(speed - v, -LARGEST_THRUST), LARGEST_THRUST)
        q = quat_multiply(q, quat_from_rotvec(rate * dt))
        v = max(v + (thrust + g_x) * dt, 15.0)
        height -= v * C[2, 0] * dt
        since_s += dt
        turned += dt * (abs(p) if kind == ROLL else rate[1])
    return out[:count]


def build_aerobatics(settings: TruthSettings, seed: int) -> Trajectory:
    """The programme flown from the start of ``settings``; see :func:`lowcostnav_ros.trajectory.build`."""
    motion = AerobaticMotion(settings, seed)

    def pieces() -> Iterator:
        return pieces_of_motion(motion, settings.start_ns, settings.rate_hz, settings.duration_s or motion.duration_s)

    return Trajectory(settings.rate_hz, settings.start_ns, pieces)
