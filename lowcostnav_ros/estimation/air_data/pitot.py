"""What betrays a blocked, iced or swapped pitot-static system.

A tube and drain that are blocked hold the total pressure: the airspeed reads as an altimeter does, in a climb up, in a descent down, while
the sum of static and impact pressure stays.  With GPS there is a test that holds in every phase of flight: the airspeed cannot change by
more than the velocity over ground and the wind do, since |d|v - w|| <= |dv| + |dw|, nor lie below the ground speed less any wind.  In
level, steady cruise a tube blocked whole shows nothing until height, speed or wind change: what it reads is right until then.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import GpsVelocity, Pressure
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.estimation.aiding import Reason

BLOCKED = "pitot blocked: total pressure does not change with height"
UNMOVED = "airspeed changed without a motion: pitot blocked or iced"
TOO_SLOW = "airspeed below ground speed less any wind: pitot blocked"
SWAPPED = "impact pressure negative: pitot and static lines swapped?"
LOOK_NS = 500_000_000
FRESH_NS = 2_000_000_000
"""A GPS velocity older than this says nothing of the present."""
TRAPPED_NS = 12_000_000_000
TRAPPED_SHARE = 0.05
"""Share of the change of static pressure by which a total pressure that is held may change: a line that leaks or warms."""
LEAST_CHANGE_PA = 250.0
"""Change of static pressure, 21 m near the ground, below which nothing is said of the total."""
NEGATIVE_PA, NEGATIVE_IN_ROW = 100.0, 5
AGREES_NS = 5_000_000_000


@dataclass(frozen=True)
class PitotSettings:
    """How a pitot tube is doubted."""

    enabled: bool = setting(True, "Withhold an airspeed that contradicts the motion or holds the total pressure.")
    wind_change_mps: float = setting(10.0, "Largest change of wind within the window.", unit="m/s", minimum=2.0, maximum=60.0)
    window_s: float = setting(30.0, "Airspeed and motion are compared over this time.", unit="s", minimum=5.0, maximum=120.0)
    any_wind_mps: float = setting(50.0, "No wind is stronger.", unit="m/s", minimum=10.0, maximum=150.0)
    memory_s: float = setting(120.0, "A doubt that nothing renews ends after this.", unit="s", minimum=10.0, maximum=3600.0)


@dataclass(frozen=True, slots=True)
class Look:
    """State of the air data at one time: static and total pressure, Pa, TAS, m/s, velocity over ground (3,), m/s, None without GPS."""

    stamp_ns: int
    static: float
    total: float
    tas: float
    vel_n: np.ndarray | None


class PitotWatch:
    """Judges one pitot-static system; see the module head."""

    def __init__(self, settings: PitotSettings) -> None:
        self.settings = settings
        self._looks: deque[Look] = deque(maxlen=300)
        self._motion: GpsVelocity | None = None
        self._negative = 0
        self._doubt = ""
        self._reference: Look | None = None
        self._since_ns = self._agrees_since_ns = 0

    def see_motion(self, velocity: GpsVelocity) -> None:
        """Take a velocity over ground in; exact repetitions of a receiver say nothing new."""
        if self._motion is None or not np.array_equal(velocity.vel_n, self._motion.vel_n):
            self._motion = velocity

    def judge(self, stamp_ns: int, static: Pressure, impact: Pressure, tas: float) -> str:
        """Why an airspeed is not to be used; empty where nothing speaks against it."""
        if not self.settings.enabled:
            return ""
        self._negative = self._negative + 1 if impact.pressure_pa < -max(NEGATIVE_PA, 5.0 * impact.variance**0.5) else 0
        if self._negative >= NEGATIVE_IN_ROW:
            return Reason(SWAPPED, f"{impact.pressure_pa:.0f} Pa")
        moved = self._motion
        fresh = moved is not None and abs(stamp_ns - moved.stamp_ns) <= FRESH_NS
        now = Look(stamp_ns, static.pressure_pa, static.pressure_pa + impact.pressure_pa, tas, moved.vel_n if moved and fresh else None)
        if self._doubt:
            return self._still(now)
        found = self._find(now)
        if found:
            self._doubt, self._since_ns, self._agrees_since_ns = found, stamp_ns, stamp_ns
            return found
        if not self._looks or stamp_ns - self._looks[-1].stamp_ns >= LOOK_NS:
            self._looks.append(now)
        while self._looks and stamp_ns - self._looks[0].stamp_ns > 1e9 * self.settings.window_s:
            self._looks.popleft()
        return ""

    def _find(self, now: Look) -> str:
        if now.vel_n is not None:
            ground = float(np.hypot(now.vel_n[0], now.vel_n[1]))
            if now.tas < ground - self.settings.any_wind_mps:
                self._reference = None
                return Reason(TOO_SLOW, f"{now.tas:.0f} m/s at {ground:.0f} m/s over ground")
            for look in self._looks:
                if look.vel_n is not None and self._unexplained(look, now) > self.settings.wind_change_mps:
                    self._reference = look
                    return Reason(UNMOVED, f"from {look.tas:.0f} to {now.tas:.0f} m/s in {1e-9 * (now.stamp_ns - look.stamp_ns):.0f} s")
        return self._trapped(now)

    def _unexplained(self, look: Look, now: Look) -> float:
        """Change of airspeed beyond that of the velocity over ground, m/s."""
        assert look.vel_n is not None and now.vel_n is not None, "only looks with GPS are compared"
        return abs(now.tas - look.tas) - float(np.linalg.norm(now.vel_n - look.vel_n))

    def _trapped(self, now: Look) -> str:
        """The total pressure stays while the static pressure changes; a GPS velocity that changes with the airspeed clears it."""
        past = [look for look in self._looks if now.stamp_ns - look.stamp_ns <= TRAPPED_NS]
        if not past or now.stamp_ns - past[0].stamp_ns < TRAPPED_NS - 2 * LOOK_NS:
            return ""
        static, total = np.array([look.static for look in past]), np.array([look.total for look in past])
        change = float(np.ptp(static))
        if change < LEAST_CHANGE_PA or float(np.ptp(total)) > TRAPPED_SHARE * change or now.total - now.static < 30.0:
            return ""
        if now.vel_n is not None and past[0].vel_n is not None and self._unexplained(past[0], now) <= 0.0:
            return ""
        self._reference = past[0]
        return Reason(BLOCKED, f"static pressure by {change:.0f} Pa, total by {np.ptp(total):.0f} Pa")

    def _still(self, now: Look) -> str:
        """Keep a doubt until airspeed and motion have agreed for a while with what they were before it."""
        look, reason = self._reference, self._doubt
        if now.vel_n is not None and look is not None and look.vel_n is not None:
            agrees = self._unexplained(look, now) < 0.5 * self.settings.wind_change_mps
        elif now.vel_n is not None:
            agrees = now.tas >= float(np.hypot(now.vel_n[0], now.vel_n[1])) - self.settings.any_wind_mps
        else:
            moved = 0.0 if look is None else max(abs(now.static - look.static), LEAST_CHANGE_PA)
            agrees = look is not None and abs(now.total - look.total) > 4.0 * TRAPPED_SHARE * moved
        if not agrees:
            self._agrees_since_ns = now.stamp_ns
            is_certain = look is None and now.vel_n is not None
            if is_certain or now.stamp_ns - self._since_ns < 1e9 * self.settings.memory_s:
                return reason
        elif now.stamp_ns - self._agrees_since_ns < AGREES_NS:
            return reason
        self._doubt, self._reference = "", None
        self._looks.clear()
        return ""
