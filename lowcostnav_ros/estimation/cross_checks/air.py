"""Airspeed against the speed over ground: a blocked pitot tube, a wrong unit."""

from lowcostnav_ros.estimation.cross_checks.latch import Latch

STRONGEST_WIND_MPS = 30.0
SCALE = 0.15
STILL_AIR, FLYING_MPS = 0.25, 15.0
"""An airspeed below this share of the speed over ground is blocked, from such a speed on: no wind carries an aircraft so."""


class AirspeedCheck(Latch):
    """Airspeed and speed over ground, m/s."""

    def __init__(self, air: str, ground: str) -> None:
        super().__init__("airspeed and ground speed disagree", (air, ground), "m/s")

    def compare(self, stamp_ns: int, airspeed: float, ground: float) -> None:
        """Compare the two."""
        apart = abs(airspeed - ground)
        blocked = airspeed < STILL_AIR * ground and ground > FLYING_MPS
        disagrees = blocked or apart > STRONGEST_WIND_MPS + SCALE * max(airspeed, ground)
        advice = "pitot tube blocked, or air data failed" if airspeed < ground else "check the unit of the airspeed"
        self.judge(stamp_ns, disagrees, apart, self.parties[0], advice)
