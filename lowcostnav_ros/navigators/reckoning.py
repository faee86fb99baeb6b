"""What the navigators share that are carried by attitude and air data: no inertial unit, GPS to learn by, outputs on a grid of stamps."""

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from lowcostnav_ros.aids.gps import PositionAid, VelocityAid
from lowcostnav_ros.base.measurements import AirVelocity, Attitude, Measurement, NavSolution
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.cores.reckoning_model import POS
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.unconfirmed import UnconfirmedSpeed
from lowcostnav_ros.navigators.base import Navigator

AIR = "air/velocity"
STEP_MPS = 8.0
"""An airspeed this far from its average of seconds is no gust: the step counts at once."""
UNCONFIRMED = 0.7
"""Share of a change of the airspeed without GPS that may be its error: nothing else shows the speed."""


class ReckoningNavigator(Navigator):
    """A navigator on a :class:`~lowcostnav_ros.cores.reckoning.ReckoningCore`.

    A subclass finds ``_fixes``, calls :meth:`_start_over` in ``_restart`` and has ``alert_nm`` and ``airspeed`` among its settings;
    ``gusts_mps`` is the change of its airspeed that is noise.
    """

    smooths = True
    needs = ("gps",)
    gusts_mps: ClassVar[float] = 0.0
    _fixes: list[PositionAid]
    _last_out_ns: int | None

    def _start_over(self, core: Any) -> None:
        """Fly a new core, of which nothing has been given out and no aid remembers anything."""
        self._take(core)
        self._last_out_ns = None
        self._unconfirmed = UnconfirmedSpeed(UNCONFIRMED, self.gusts_mps)
        self.restart_channels()
        for aid in self.aids:
            aid.restart()

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether a fix was accepted within the time-out."""
        return any(aid.is_fresh(stamp_ns) for aid in self._fixes)

    def _confirm_air(self, stamp_ns: int) -> None:
        """Know the airspeed less well where it has changed since GPS velocity last confirmed it."""
        confirmed = any(aid.is_fresh(stamp_ns) for aid in self.aids_of(VelocityAid))
        held = self.core.held
        speed = held.speed if abs(held.speed - held.steady_speed) > STEP_MPS else held.steady_speed
        gained = self._unconfirmed.take(stamp_ns, speed, confirmed=confirmed)
        rows = self.layout.get("airspeed_bias")
        if gained == 0.0 or rows is None:
            return
        for core in self._cores():
            core.settle()
            kalman.add_variance(core.P, rows, gained, core.history)

    def _cores(self) -> tuple[Any, ...]:
        """Its core, and others that the same air data carry."""
        return (self.core,)

    def start_at(self, stamp_ns: int, lat: float, lon: float, height: float, sigma_m: float = 10.0) -> None:
        """Begin at a given position (rad, rad, m above the ellipsoid) known to ``sigma_m`` per axis, instead of at the first fix."""
        self.core.start(stamp_ns, np.array([lat, lon, height]), sigma_m**2 * np.eye(3))
        self.set_origin(lat, lon, height)
        self._judge()

    @abstractmethod
    def _judge(self) -> None:
        """Find the mode and its reason."""

    @abstractmethod
    def _hold(self, item: Measurement, core: Any) -> bool:
        """Let a core hold what carries it; return whether this does."""

    @abstractmethod
    def _solution(self, core: Any) -> NavSolution:
        """The solution of a core."""

    def _stands(self, stamp_ns: int) -> bool:
        """Whether airspeed and GPS both say so: airspeed alone may be a blocked pitot tube."""
        ground = self.trust.checks.ground_speed(stamp_ns)
        return not self.core.held.airborne and (ground is None or ground < self.settings.airspeed.minimum_mps)

    def _advance(self, stamp_ns: int) -> None:
        """Move to ``stamp_ns``; the solution at a multiple of the output period goes out once all that bears its stamp is fused."""
        period, core = self.output_period_ns, self.core
        due = -(-core.t_ns // period) * period
        while due < stamp_ns:
            core.move(due)
            core.settle()
            if due != self._last_out_ns:
                for channel in self.clocked:
                    self.use_channel(channel, Measurement(due, self.name))
                self._before_output(due)
                self._judge()
                self.publish(self._solution(core))
                self._last_out_ns = due
            due += period
        core.move(stamp_ns)

    def _before_output(self, due_ns: int) -> None:
        """Called with all fused that bears the stamp of an output."""

    def _predict(self) -> NavSolution | None:
        if not self.core.started:
            return None
        core = self.core.branch()
        for item in self.horizon.ahead()[1]:
            if isinstance(item, Attitude | AirVelocity):
                core.move(item.stamp_ns)
                self._hold(item, core)
        core.move(self.horizon.newest_ns or core.t_ns)
        core.settle()
        return self._solution(core)

    def _without_gps(self, now_ns: int) -> str:
        """How long GPS has been gone, in words."""
        ages = [age for aid in self._fixes if (age := aid.status.age_s(now_ns)) is not None]
        return f"no GPS for {min(ages):.0f} s" if ages else "no GPS yet"

    def _alert(self) -> bool:
        return self.core.started and self.core.horizontal_sigma() > self.settings.alert_nm * NAUTICAL_MILE

    def _alert_words(self) -> str:
        """The alert as an end of the reason; empty without one."""
        if not self._alert():
            return ""
        return f"; ALERT: estimated error {self.core.horizontal_sigma() / NAUTICAL_MILE:.2f} NM is above {self.settings.alert_nm:g} NM"

    def _level(self) -> Level:
        return Level.ERROR if self._alert() else super()._level()

    def _position_sigmas(self) -> tuple[float, float, float]:
        """Sigmas of position north, east, down with what is doubted, m."""
        variance = self.core.P.diagonal()[POS] + self.doubt(self.core.t_ns).diagonal()[POS]
        north, east, down = np.sqrt(variance).tolist()
        return north, east, down

    def _wind_sigma(self) -> float:
        """Sigma of the wind, m/s."""
        wind = self.core.wind_covariance()
        return math.sqrt(wind[0, 0] + wind[1, 1])
