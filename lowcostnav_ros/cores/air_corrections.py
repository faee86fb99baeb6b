"""The air corrections core: position carried by airspeed, airflow angles, attitude and wind, each with its error as a state.

Eggers (1995) estimates ten corrections with GPS velocity at 1 Hz and feeds what they give to a second filter of position and velocity.
Here position is a state beside the corrections, so that one filter has all of it: the errors of the velocity are then correlated in time as
they are, through their states, instead of white.  The dynamics are in :mod:`~lowcostnav_ros.cores.air_corrections_model`.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores import air_corrections_model as model
from lowcostnav_ros.cores.noise_levels import NoiseLevels
from lowcostnav_ros.cores.reckoning import (
    AirspeedSettings,
    HeadingSettings,
    HeldInputs,
    ReckoningCore,
    ReckoningSettings,
    WindSettings,
    core_blocks,
)
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout, along_way, gauss_markov, random_walk
from lowcostnav_ros.physics.rotation import quat_to_euler

AXES = ("north", "east", "down")
COLUMNS = {
    "misalignment": model.ZETA,
    "heading_offset": model.ZETA + 2,
    "level_bias": model.PITCH,
    "airspeed_scale": model.SCALE,
    "airspeed_bias": model.BIAS,
    "wind": model.WIND,
    "wind_mean": model.WIND,
    "gust": model.WIND,
    "airflow": model.INCIDENCE,
}
"""Correction that the first state of each block adds to; further states to those after it."""


@dataclass(frozen=True)
class LevelSettings:
    """Errors of pitch and bank that come in."""

    misalignment_deg: float = setting(0.5, "Slow error of the vertical per axis, Gauss-Markov.", unit="deg", minimum=0.01, maximum=20.0)
    misalignment_tau_s: float = setting(150.0, "Its correlation time (erection).", unit="s", minimum=1.0, maximum=1e5)
    pitch_bias_deg: float = setting(2.0, "Constant error of pitch (and incidence); 0: no states.", unit="deg", minimum=0.0)
    bank_bias_deg: float = setting(0.5, "Constant error of bank, sigma; 0: no state (nine instead of ten).", unit="deg", minimum=0.0)


@dataclass(frozen=True)
class AirflowSettings:
    """Incidence and sideslip where no vane measures them."""

    incidence_deg: float = setting(2.0, "Change of incidence, Gauss-Markov sigma; 0: none.", unit="deg", minimum=0.0, maximum=20.0)
    sideslip_deg: float = setting(1.5, "Sideslip, Gauss-Markov sigma; 0: none.", unit="deg", minimum=0.0, maximum=20.0)
    tau_s: float = setting(5.0, "Correlation time of both.", unit="s", minimum=0.1, maximum=1000.0)
    updraught_mps: float = setting(0.7, "Vertical wind, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=50.0)
    updraught_tau_s: float = setting(60.0, "Its correlation time.", unit="s", minimum=0.1, maximum=1000.0)


@dataclass(frozen=True)
class AirCorrectionsSettings:
    """What the core is made of."""

    model: ClassVar[str] = "full"
    learn_s: float = setting(
        200.0, "Memory of the sigmas of wind, turbulence and heading error learned from GPS velocity; 0: as set.", unit="s", minimum=0.0
    )
    ground_walk_mps: float = setting(5.0, "Unknown motion below minimum airspeed, sigma at 1 Hz.", unit="m/s", minimum=0.0, maximum=50.0)
    reference_mps: float = setting(50.0, "Airspeed about which scale and bias are estimated.", unit="m/s", minimum=0.0, maximum=300.0)
    noise_mps: float = setting(0.1, "White noise of the velocity of one sample.", unit="m/s", minimum=0.0, maximum=10.0)
    heading: HeadingSettings = group(HeadingSettings, noise_deg=0.3)
    level: LevelSettings = group(LevelSettings)
    airspeed: AirspeedSettings = group(AirspeedSettings)
    wind: WindSettings = group(WindSettings)
    airflow: AirflowSettings = group(AirflowSettings)


def correction_blocks(settings: AirCorrectionsSettings) -> list[Block]:
    """Position and the corrections: misalignment, biases of heading, pitch and bank, airspeed scale and bias, wind, airflow."""
    heading, level, airspeed, wind, airflow = settings.heading, settings.level, settings.airspeed, settings.wind, settings.airflow
    tilt, tilt_s = level.misalignment_deg * DEGREE, level.misalignment_tau_s
    turn, turn_s = max(heading.bias_deg, 1e-6) * DEGREE, heading.bias_tau_s
    blocks = [
        Block("core", tuple(f"position_{axis}_m" for axis in AXES), Kind.CORE, (10.0,) * 3, np.inf, (0.0,) * 3),
        gauss_markov("misalignment", _labels("misalignment", "rad"), Kind.FREE, (tilt, tilt, turn), (tilt_s, tilt_s, turn_s)),
    ]
    if heading.offset_deg > 0.0:
        blocks.append(random_walk("heading_offset", ["heading_offset_rad"], Kind.FREE, heading.offset_deg * DEGREE))
    biases = [(name, s * DEGREE) for name, s in (("pitch", level.pitch_bias_deg), ("bank", level.bank_bias_deg)) if s > 0.0]
    if biases and biases[0][0] == "pitch":  # bank alone has no column of its own: nothing observes it without pitch
        blocks.append(random_walk("level_bias", [f"{name}_bias_rad" for name, _ in biases], Kind.FREE, [s for _, s in biases]))
    if airspeed.scale > 0.0:
        blocks.append(random_walk("airspeed_scale", ["airspeed_scale"], Kind.FREE, airspeed.scale))
    if airspeed.bias_mps > 0.0:
        blocks.append(gauss_markov("airspeed_bias", ["airspeed_bias_mps"], Kind.FREE, airspeed.bias_mps, airspeed.bias_tau_s))
    sigma, tau_s = (wind.sigma_mps, wind.sigma_mps, airflow.updraught_mps), (wind.tau_s, wind.tau_s, airflow.updraught_tau_s)
    varying = gauss_markov("wind", _labels("wind_variation", "mps"), Kind.WIND, sigma, tau_s)
    blocks.append(replace(varying, distance_m=1e3 * wind.distance_km or np.inf))
    if wind.mean_mps > 0.0:
        blocks.append(random_walk("wind_mean", _labels("wind_mean", "mps")[:2], Kind.WIND, wind.mean_mps))
    if wind.gust_mps > 0.0:
        blocks.append(along_way("gust", _labels("gust", "mps")[:2], Kind.WIND, wind.gust_mps, wind.gust_distance_m))
    angles = airflow.incidence_deg * DEGREE, airflow.sideslip_deg * DEGREE
    if max(angles) > 0.0:
        blocks.append(gauss_markov("airflow", ("incidence_rad", "sideslip_rad"), Kind.FREE, angles, airflow.tau_s))
    return blocks


def _labels(name: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}_{unit}" for axis in AXES)


def columns_of(layout: Layout) -> np.ndarray:
    """Correction (n,) that each state adds to, -1 for none."""
    out = np.full(layout.size, -1, dtype=np.int64)
    for name, first in COLUMNS.items():
        rows = layout.get(name)
        if rows is not None:
            out[rows] = first + np.arange(rows.stop - rows.start)
    return out


@dataclass(slots=True)
class HeldAir(HeldInputs):
    """As held for dead reckoning; ``measured`` (2,): incidence and sideslip are, each by a vane."""

    measured: np.ndarray = field(default_factory=lambda: np.zeros(2, bool))

    def take_air(self, air: AirVelocity, settings: AirspeedSettings) -> None:
        """Hold a new air-relative velocity, and which of its angles a vane has measured."""
        HeldInputs.take_air(self, air, settings)
        self.measured = np.array([air.cov_b[2, 2] < UNKNOWN_VARIANCE, air.cov_b[1, 1] < UNKNOWN_VARIANCE])


class AirCorrectionsCore(ReckoningCore):
    """Mean and covariance, and the attitude and air data that carry them; as :class:`~lowcostnav_ros.cores.reckoning.ReckoningCore`.

    Attributes
    ----------
    column : ndarray of int64, shape (n,)
        Correction that each state adds to.
    """

    settings: Any
    held: HeldAir

    def __init__(self, settings: Any, layout: Layout) -> None:
        super().__init__(settings, layout)
        self.held = HeldAir()
        self._plain = Layout(core_blocks(ReckoningSettings(heading=settings.heading, airspeed=settings.airspeed, wind=settings.wind)))
        self.levels = NoiseLevels(self._plain, settings.learn_s)
        self._sums = np.zeros((4, model.COUNT))
        self._all = columns_of(layout)
        self.ranging[3] = 1.0  # no vertical velocity is there
        self.column = self._all
        self._expect(self._all == model.ZETA + 2, self._all == model.BIAS)

    def learn(self, vel_n: np.ndarray, noise: np.ndarray) -> None:
        """As dead reckoning, by its plainer model of the same wind and heading; a vertical wind is none of it."""
        self._plain.pace(self.held.speed)
        super().learn(vel_n, noise)
        wind, gust, heading = (self.levels.factors.get(name, 1.0) for name in ("wind", "gust", "heading_bias"))
        factors = {"wind": [wind, wind, 1.0], "gust": [gust] * 2, "misalignment": [1.0, 1.0, heading]}
        self.layout.set_levels({name: np.array(each) for name, each in factors.items() if name in self.layout})

    def _used(self) -> np.ndarray:
        """Columns of the states; an angle that a vane measures has no state."""
        measured, column = self.held.measured, self._all
        if measured.any():
            column = column.copy()
            for k, angle in enumerate((model.INCIDENCE, model.SLIP)):
                if measured[k]:
                    column[column == angle] = -1
        return column

    def move(self, to_ns: int) -> None:
        """Move the mean to ``to_ns`` with what is held; the covariance follows in :meth:`settle`."""
        if to_ns <= self.t_ns:
            return
        held, dt = self.held, 1e-9 * (to_ns - self.t_ns)
        self.column = self._used()
        euler = quat_to_euler(held.attitude((self.t_ns + to_ns) // 2)[0])
        flies = held.airborne and held.vel_b[0] > 0.0
        own = self.nav, self.estimate, self.column, self.layout.rate
        model.move(*own, euler, held.vel_b, self.settings.reference_mps, flies, dt, self._sums)
        self._sums[3, 1:4] += self.settings.noise_mps**2 * dt * min(dt, 1.0) + self._walk() * dt
        self.t_ns = to_ns

    def settle(self) -> None:
        """Carry the covariance to the time of the mean."""
        if self._sums[3, 0] <= 0.0:
            return
        if self.layout.is_paced:
            self.layout.pace(self.held.speed)
        track = kalman.NO_TRACK if self.history is None else self.history.begin(self.P)
        model.carry(self.P, self._sums, self.column, self.layout.rate, self.layout.psd, track)
        if self.history is not None:
            self.history.end(self.P)

    def corrections(self) -> np.ndarray:
        """All corrections (12,), each the sum of its states."""
        return model.summed(self.estimate, self.column)

    def totals(self) -> np.ndarray:
        """Wind north, east, heading correction, airspeed scale error, airspeed bias (5,)."""
        y = self.corrections()
        return np.array([y[model.WIND], y[model.WIND + 1], y[model.ZETA + 2], y[model.SCALE] - 1.0, y[model.BIAS]])

    def sigmas(self) -> np.ndarray:
        """Sigmas (3,) of heading, rad, airspeed scale and airspeed bias, m/s, each the sum of its states."""
        rows = ((self._all == k).astype(float) for k in (model.ZETA + 2, model.SCALE, model.BIAS))
        return np.array([math.sqrt(max(float(row @ self.P @ row), 0.0)) for row in rows])

    def velocity(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity over ground (3,), m/s NED, now, its derivative (3, n) by the error states, and what they do not explain of it."""
        settings, held, n = self.settings, self.held, self.layout.size
        q_nb, swing = held.attitude(self.t_ns)
        out, G = np.zeros(3), np.zeros((3, n))
        if held.airborne and held.vel_b[0] > 0.0:
            column = self._used()
            y = model.summed(self.estimate, column)
            out, H = model.ground_velocity(quat_to_euler(q_nb), held.vel_b, y, settings.reference_mps, True)
            G = model.spread(H, column)
        noise = (settings.noise_mps**2 + settings.airspeed.noise_mps**2) * np.eye(3)
        noise += (math.hypot(settings.heading.noise_deg * DEGREE, swing) * held.speed) ** 2 * np.eye(3)
        if self.timed_out() or not held.airborne:
            noise += held.fastest**2 * np.diag([1.0, 1.0, 0.1])
        return out, G, noise

    def _walk(self) -> float:
        """Density of the unknown motion, m^2/s: that of dead reckoning, and white noise of heading and airspeed, sigma at 1 Hz."""
        settings, walk = self.settings, super()._walk()
        if not self.held.airborne:
            return walk
        return walk + settings.airspeed.noise_mps**2 + (settings.heading.noise_deg * DEGREE * self.held.speed) ** 2
