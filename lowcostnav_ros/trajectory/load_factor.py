"""A flight from load factor, roll and thrust alone, and what attitude reference and air data see of it (Eggers 1995, routine ``hcref``).

No aerodynamics: lift turns the velocity, thrust is a factor on speed, gravity acts along the path, incidence goes with the load factor.
Speeds are in any unit u, ``gravity`` in u/s.  NED; sideslip is positive with the nose to the right of the air velocity, as in the thesis.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel

INCIDENCE_PER_G = 0.035
"""Incidence, rad per g of lift."""


@dataclass(frozen=True)
class AirSeen:
    """What is seen of the flight, columns of n steps: magnetic heading (as it comes, not wrapped), pitch, bank, rad; forward airspeed;
    incidence, sideslip, rad; and the true air velocity (n, 3)."""

    heading: np.ndarray
    pitch: np.ndarray
    bank: np.ndarray
    airspeed: np.ndarray
    incidence: np.ndarray
    sideslip: np.ndarray
    velocity: np.ndarray

    def __len__(self) -> int:
        return len(self.heading)


@kernel
def _unit(v):
    return v / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _angle(cosine):
    return math.acos(min(1.0, max(-1.0, cosine)))


@kernel
def step(state, bank, lift, roll, slip, factor, variation, dt, gravity, seen):
    """One step of ``dt`` s: the velocity ``state`` (3,) moves in place, ``seen`` (6,) is filled; returns the new bank, rad."""
    down = np.array([0.0, 0.0, 1.0])
    speed = math.sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2)
    ahead = state / speed
    below = _unit(down - ahead[2] * ahead)
    bank += roll
    lifted = -math.cos(bank) * lift * below - math.sin(bank) * lift * np.cross(ahead, below)
    v = state + gravity * dt * (lifted + down)
    v = v * (speed / math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)) * factor
    v = v + gravity * dt * ahead[2] * ahead
    speed = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    ahead = v / speed
    across = _unit(lifted - (ahead[0] * lifted[0] + ahead[1] * lifted[1] + ahead[2] * lifted[2]) * ahead)
    below = _unit(down - ahead[2] * ahead)
    bank = _turned(across, below, ahead)
    size = math.sqrt(lifted[0] ** 2 + lifted[1] ** 2 + lifted[2] ** 2)
    incidence = INCIDENCE_PER_G * size
    right = _unit(np.cross(ahead, lifted))
    nose = _unit(v + speed * math.tan(incidence) * lifted / size + speed * math.tan(slip) * right)
    level = _unit(np.array([nose[0], nose[1], 0.0]))
    heading = _angle(level[0])
    if nose[1] < 0.0:
        heading = 2.0 * math.pi - heading
    pitch = _angle(nose[0] * level[0] + nose[1] * level[1])
    if nose[2] > 0.0:
        pitch = -pitch
    along = nose[0] * lifted[0] + nose[1] * lifted[1] + nose[2] * lifted[2]
    seen[0], seen[1] = heading - variation, pitch
    seen[2] = _turned(_unit(lifted - along * nose), _unit(down - nose[2] * nose), nose)
    seen[3] = abs(nose[0] * v[0] + nose[1] * v[1] + nose[2] * v[2])
    seen[4], seen[5] = incidence, slip
    state[:] = v
    return bank


@kernel
def _turned(lifted, below, axis):
    """Bank, rad: from straight up to the lift, about an axis, all units normal to it."""
    bank = _angle(-(below[0] * lifted[0] + below[1] * lifted[1] + below[2] * lifted[2]))
    off = np.cross(lifted, below) - axis
    return -bank if math.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2) > 1.0 else bank


@kernel
def _fly(lift, roll, slip, factor, state, bank, variation, dt, gravity):
    n = lift.shape[0]
    seen, velocity = np.empty((n, 6)), np.empty((n, 3))
    for k in range(n):
        bank = step(state, bank, lift[k], roll[k], slip[k], factor[k], variation, dt, gravity, seen[k])
        velocity[k] = state
    return seen, velocity


@kernel
def _fly_in_envelope(n, state, dt, gravity, scale, trim, variation):
    seen, velocity, bank = np.empty((n, 6)), np.empty((n, 3)), 0.0
    for k in range(n):
        t = k * dt
        speed = math.sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2)
        climb = math.asin(-state[2] / speed)
        wanted = math.radians(60.0) * scale * math.sin(2.0 * math.pi * t / 47.0)
        climb_wanted = math.radians(25.0) * scale * math.sin(2.0 * math.pi * t / 73.0)
        speed_wanted = trim * (1.0 + 0.3 * scale * math.sin(2.0 * math.pi * t / 131.0))
        roll = min(max(wanted - bank, -0.5 * dt), 0.5 * dt)
        rate = min(max((climb_wanted - climb) / 3.0, -0.15), 0.15)
        lift = min(max((math.cos(climb) + speed * rate / gravity) / max(math.cos(bank + roll), 0.35), -0.5), 5.0)
        factor = min(max(1.0 + ((speed_wanted - speed) / 8.0 + gravity * math.sin(climb)) * dt / speed, 0.9), 1.1)
        slip = math.radians(1.0) * scale * math.sin(2.0 * math.pi * t / 37.0)
        bank = step(state, bank, lift, roll, slip, factor, variation, dt, gravity, seen[k])
        velocity[k] = state
    return seen, velocity


def fly(
    lift: np.ndarray,
    roll: np.ndarray,
    velocity: np.ndarray,
    *,
    slip: float | np.ndarray = 0.0,
    factor: float | np.ndarray = 1.0,
    bank: float = 0.0,
    variation: float = 0.0,
    dt: float = 1.0,
    gravity: float = 9.80665,
) -> AirSeen:
    """Fly commands.

    Parameters
    ----------
    lift : ndarray, shape (n,)
        Load factor, g; not zero.
    roll : ndarray, shape (n,)
        Change of bank in each step, rad.
    velocity : ndarray, shape (3,)
        Air velocity at the start, NED.
    slip, factor : float or ndarray (n,)
        Sideslip, rad, nose right positive; factor on speed in each step (thrust).
    bank, variation : float
        Bank at the start, magnetic variation (east positive), rad.
    dt, gravity : float
        Step, s; in units of speed per second.
    """
    n = len(lift)
    a, b, c, d = (np.ascontiguousarray(np.broadcast_to(np.asarray(one, float), n)) for one in (lift, roll, slip, factor))
    return _seen(*_fly(a, b, c, d, np.array(velocity, float), float(bank), float(variation), float(dt), float(gravity)))


def fly_in_envelope(
    n: int, *, dt: float = 1.0, gravity: float = 9.80665, speed: float = 150.0, scale: float = 1.0, variation: float = 0.0
) -> AirSeen:
    """Fly slow sines: bank 60 deg, climb 25 deg, speed by 30 per cent, sideslip 1 deg, all times ``scale``; it starts east."""
    start, numbers = np.array([0.0, float(speed), 0.0]), map(float, (dt, gravity, scale, speed, variation))
    return _seen(*_fly_in_envelope(n, start, *numbers))


def _seen(seen: np.ndarray, path: np.ndarray) -> AirSeen:
    heading, pitch, bank, airspeed, incidence, slip = np.ascontiguousarray(seen.T)
    return AirSeen(heading, pitch, bank, airspeed, incidence, slip, path)
