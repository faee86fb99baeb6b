"""A simple autopilot for a light aircraft: heading or bank, height and airspeed, with the gains of a Cessna 172.

Heading error makes a bank command, limited in angle and in rate; bank error makes aileron.  Height error makes a climb rate, climb
rate error a pitch command, pitch error elevator.  Airspeed error makes throttle.  Rudder cancels sideslip.
"""

import math
from dataclasses import dataclass

from lowcostnav_ros.base.units import STANDARD_GRAVITY

ROLL_RATE = math.radians(8.0)
"""Largest rate of the bank command, rad/s."""
CLIMB_ACCELERATION = 1.0
"""Largest rate of the climb command, m/s^2."""
MAX_CLIMB = 4.0
"""Largest climb command, m/s: what the aircraft can do near the sea at its best speed."""
MAX_DESCENT = 6.0
"""Largest descent command, m/s."""
SLOW_BY = 3.0
"""Airspeed below its target, m/s, at which climbing begins to give way; twice that far it has given way entirely."""
_BANK_PER_HEADING = 1.2
_CLIMB_PER_HEIGHT = 0.15


@dataclass(slots=True)
class Wanted:
    """What guidance asks for: SI, radians; heights above the ellipsoid; ``heading_error`` may exceed a half turn.

    ``bank_ahead`` is the bank a circle takes, added to what the heading error asks for.
    """

    heading_error: float
    bank_ahead: float
    max_bank: float
    height: float
    climb: float
    airspeed: float


@dataclass(slots=True)
class Seen:
    """What the autopilot sees of the aircraft, SI and radians."""

    roll: float
    pitch: float
    roll_rate: float
    pitch_rate: float
    sideslip: float
    airspeed: float
    height: float
    climb: float


class Autopilot:
    """Control law with its integrators.

    Parameters
    ----------
    elevator, aileron, throttle : float
        Trimmed commands the integrators begin from, -1 to 1 (throttle 0 to 1).
    pitch : float
        Trimmed pitch, rad.
    """

    def __init__(self, elevator: float, aileron: float, throttle: float, pitch: float) -> None:
        self._bank = self._climb = 0.0
        self._aileron, self._elevator, self._throttle, self._pitch = aileron, elevator, throttle, pitch

    def step(self, want: Wanted, see: Seen, dt: float) -> tuple[float, float, float, float]:
        """Commands (aileron, elevator, rudder, throttle) in JSBSim's normalised sense, for the next ``dt`` seconds."""
        stiffness = min(1.5, (50.0 / max(see.airspeed, 20.0)) ** 2)  # control power grows with dynamic pressure
        aileron = self._lateral(want, see, dt) * stiffness
        elevator = self._vertical(want, see, dt) * stiffness
        rudder = _limit(-1.0 * see.sideslip * stiffness, 1.0)
        return _limit(aileron, 1.0), _limit(elevator, 1.0), rudder, self._speed(want, see, dt)

    def _lateral(self, want: Wanted, see: Seen, dt: float) -> float:
        target = _limit(want.bank_ahead + _BANK_PER_HEADING * want.heading_error, want.max_bank)
        self._bank += _limit(target - self._bank, ROLL_RATE * dt)
        error = self._bank - see.roll
        self._aileron = _limit(self._aileron + 0.25 * error * dt, 0.3)
        return self._aileron + 2.0 * error - 0.35 * see.roll_rate

    def _vertical(self, want: Wanted, see: Seen, dt: float) -> float:
        target = want.climb + _CLIMB_PER_HEIGHT * (want.height - see.height)
        slow = want.airspeed - see.airspeed
        highest = MAX_CLIMB * min(1.0, max(0.0, 2.0 - slow / SLOW_BY))
        target = min(highest, max(-MAX_DESCENT, target))
        self._climb += _limit(target - self._climb, CLIMB_ACCELERATION * dt)
        missing = (self._climb - see.climb) / see.airspeed
        self._pitch = min(0.3, max(-0.2, self._pitch + 0.2 * missing * dt))
        pitch_error = self._pitch + 0.5 * missing - see.pitch
        self._elevator = _limit(self._elevator - 2.5 * pitch_error * dt, 0.8)
        turning = STANDARD_GRAVITY / see.airspeed * math.tan(_limit(see.roll, 1.0)) * math.sin(see.roll)  # pitch rate of a level turn
        return self._elevator - 4.0 * pitch_error + 0.8 * (see.pitch_rate - turning)

    def _speed(self, want: Wanted, see: Seen, dt: float) -> float:
        error = want.airspeed - see.airspeed
        output = self._throttle + 0.06 * error + 0.06 * self._climb
        if 0.0 < output < 1.0 or error * (output - 0.5) < 0.0:  # an integrator must not wind up against the stop
            self._throttle += 0.008 * error * dt
        return min(1.0, max(0.0, output))


def _limit(value: float, bound: float) -> float:
    return min(bound, max(-bound, value))
