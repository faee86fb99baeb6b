"""The approach to the Eastern Iowa Airport and its sensors: 700 s, as nine channels of a reference at 20 Hz and fixes at 1 Hz.

The thesis prints neither path nor errors of the stimulated flight: 250 ft/s and 5000 ft are ours, start of the descent at 500 s, 700 s and
the runway at 869 ft its own; attitude errors are Table 3's, accelerometer biases Table 3's less gravity, fixes wander by 30 ft over 200 s.
The world of ``earth="flat"`` is the thesis's, flat and at rest, feet by one radius; ``"round"`` is the ellipsoid, turning.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, Measurement, NavSolution
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.base.units import FOOT, STANDARD_GRAVITY
from lowcostnav_ros.calibration.reference_rest import gravity_b
from lowcostnav_ros.cores.carried import frame_acceleration
from lowcostnav_ros.cores.cascade import FEET_PER_G, CascadeCore, FlatFrame
from lowcostnav_ros.navigators.mems_ins.navigator import MemsIns
from lowcostnav_ros.physics.rotation import euler_to_dcm, eulers_to_quat
from lowcostnav_ros.physics.stochastic import GaussMarkov, simulate

NS, STEP_S, DURATION_S = 1_000_000_000, 0.05, 700.0
PLACE = math.radians(41.8847), math.radians(-91.7108)
SPEED, LEVEL, RUNWAY = 250.0, 5000.0, 869.0
DESCENT_S = 500.0
TURNS_S = ((150.0, 210.0, 1.5), (380.0, 440.0, -1.5))
ENTRY_S, ROUND_OUT_S = 4.0, 10.0
GRAVITY = FEET_PER_G
"""ft/s^2"""

MEAN = np.array([1.918154, -0.27554, 101.0921, 0.067538, -0.23315, -0.02538, 0.003692, 0.033308, 1.006249])
VARIANCE = np.array([0.000744, 0.008022, 1.083531, 0.103455, 0.186614, 0.155924, 3.23e-6, 6.9e-6, 1.67e-5])
"""Table 3: deg, deg/s, g; the accelerometers give +1 g on the down axis."""
BIAS_G = MEAN[6:9] - gravity_b(math.radians(MEAN[0]), math.radians(MEAN[1]), 1.0)
"""What of the means is no gravity: -1.12, -0.16, 6.82 mg."""
WANDER_FT, WANDER_S, WHITE_FT, LEAST_MIN = 30.0, 200.0, 5.0, 1e-4
"""Errors of the receiver; latitude and longitude come in steps of a ten-thousandth of a minute, height of a decimetre."""
LITERAL: dict[str, Any] = {
    "filter": "cascade",
    "accel_sign": "gravity_positive",
    "told_s": 0.1,
    "horizon.lag_s": 0.05,
    "horizon.output_period_s": 0.5,
    "horizon.stamps": "trust",
    "cascade.constants": "thesis",
    "cascade.match_delay": False,
    "cascade.step_s": 0.0,
    "cascade.watch": False,
    "cascade.velocity": "ins",
}
"""The filters exactly as printed, the sign of gravity put right."""
JOINT: dict[str, Any] = {"told_s": 0.5, "horizon.lag_s": 0.05, "horizon.output_period_s": 0.5}
SIGMA = np.radians(np.sqrt(VARIANCE[:3]))


@dataclass(frozen=True)
class Case:
    """One flight: settings beyond :data:`LITERAL` or, of the joint filter, :data:`JOINT`; the world; no fixes within ``outage_s``."""

    seed: int = 1
    changes: tuple[tuple[str, Any], ...] = ()
    joint: bool = False
    earth: str = "flat"
    outage_s: tuple[float, float] = (0.0, 0.0)
    gps_hz: float = 1.0


@dataclass(slots=True, eq=False)
class Path:
    """The true flight at 20 Hz: time, position (n, 3), ft NED with the height above the sea as -D, velocity, acceleration, Euler angles."""

    t_s: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    accel: np.ndarray
    euler: np.ndarray


def _ramps(t: np.ndarray, begin: float, end: float, size: float, entry: float) -> np.ndarray:
    """A value that rises from 0 to ``size`` and falls back, linearly within ``entry`` about begin and end."""
    return size * (np.clip((t - begin) / entry + 0.5, 0.0, 1.0) - np.clip((t - end) / entry + 0.5, 0.0, 1.0))


def _integral(values: np.ndarray) -> np.ndarray:
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * STEP_S)))


@lru_cache(maxsize=1)
def path() -> Path:
    """The flight."""
    t = np.arange(round(DURATION_S / STEP_S) + 1) * STEP_S
    rate = np.radians(sum(_ramps(t, a, b, degrees, ENTRY_S) for a, b, degrees in TURNS_S))
    yaw = math.radians(90.0) + _integral(rate)
    down = _ramps(t, DESCENT_S, DURATION_S + ROUND_OUT_S, (LEVEL - RUNWAY) / (DURATION_S - DESCENT_S), ROUND_OUT_S)
    velocity = np.column_stack((SPEED * np.cos(yaw), SPEED * np.sin(yaw), down))
    accel = np.column_stack((-velocity[:, 1] * rate, velocity[:, 0] * rate, np.gradient(down, STEP_S)))
    position = np.column_stack([_integral(v) for v in velocity.T])
    position[:, 2] -= LEVEL
    euler = np.column_stack((np.arctan(SPEED * rate / GRAVITY), -np.arctan(down / SPEED), yaw))
    return Path(t, position, velocity, accel, euler)


@dataclass(slots=True, eq=False)
class Flown:
    """What came of a case, feet: ``t_s`` (n,) of the solutions, ``error`` (n, 3) integrated less true NED, ``ins`` (n, 3) the same of the
    inertial solution; of the ``k`` fixes time, error at the epoch, velocity, acceleration and filtered acceleration (NaN: none yet),
    offsets z_a, z_p, biases b_a, b_p, and the error of the integrated solution then.  ``sigma`` (n, 3).
    """

    t_s: np.ndarray
    error: np.ndarray
    sigma: np.ndarray
    ins: np.ndarray
    fix_s: np.ndarray
    fix_error: np.ndarray
    accel: np.ndarray
    filtered: np.ndarray
    z_accel: np.ndarray
    z_position: np.ndarray
    b_accel: np.ndarray
    b_position: np.ndarray
    modes: tuple[str, ...]

    def rms(self, columns: str = "error", after_s: float = 0.0) -> np.ndarray:
        """RMS N, E, D, ft."""
        times = self.fix_s if columns == "fix_error" else self.t_s
        return np.sqrt(np.mean(getattr(self, columns)[times >= after_s] ** 2, axis=0))


def frame_of(earth: str) -> FlatFrame:
    """Feet and places about the airport; height zero of both is the sea."""
    return FlatFrame(*PLACE, 0.0, sphere=earth == "flat")


def samples(case: Case) -> list[Attitude]:
    """The reference: true attitude and white noise, Table 3."""
    flight, rng = path(), stream(case.seed, "njenga.reference")
    euler = flight.euler + SIGMA * rng.standard_normal((len(flight.t_s), 3))
    noise = np.sqrt(VARIANCE[6:9]) * rng.standard_normal((len(flight.t_s), 3))
    quats, cov, zero, frame = eulers_to_quat(euler), np.diag(SIGMA**2), np.zeros(3), frame_of(case.earth)
    out = []
    for k, t in enumerate(flight.t_s):
        fall = np.array([0.0, 0.0, GRAVITY])
        unit = GRAVITY
        if case.earth == "round":
            nav = np.concatenate((frame.from_ned(FOOT * flight.position[k]), FOOT * flight.velocity[k]))
            fall, unit = frame_acceleration(nav) / FOOT, STANDARD_GRAVITY / FOOT
        felt = euler_to_dcm(*flight.euler[k]).T @ (fall - flight.accel[k]) / unit  # g: gravity less acceleration
        out.append(Attitude(round(t * NS) + NS, "imu/data_fused", quats[k], cov, zero, STANDARD_GRAVITY * (felt + BIAS_G + noise[k])))
    return out


def receiver_error(count: int, step_s: float, seed: int) -> np.ndarray:
    """Errors of fixes (n, 3), ft, before they are rounded."""
    rng = stream(seed, "njenga.gps")
    wander, _ = simulate(GaussMarkov(WANDER_FT, WANDER_S), step_s, count, rng, WANDER_FT * rng.standard_normal(3))
    return wander + WHITE_FT * rng.standard_normal((count, 3))


def rounded(place: np.ndarray) -> np.ndarray:
    """A place as the receiver prints it."""
    step = math.radians(LEAST_MIN / 60.0)
    return np.array([round(place[0] / step) * step, round(place[1] / step) * step, round(place[2], 1)])


def fixes(case: Case) -> list[GpsPosition]:
    """The fixes."""
    flight, frame = path(), frame_of(case.earth)
    every = round(1.0 / (case.gps_hz * STEP_S))
    rows = np.arange(0, len(flight.t_s), every)
    error, cov = receiver_error(len(rows), every * STEP_S, case.seed), np.eye(3) * (33.0 * FOOT) ** 2
    out = []
    for row, off in zip(rows, error, strict=True):
        t = flight.t_s[row]
        if not case.outage_s[0] <= t < case.outage_s[1]:
            lat, lon, height = rounded(frame.from_ned(FOOT * (flight.position[row] + off))).tolist()
            out.append(GpsPosition(round(t * NS) + NS, "gps/fix", lat, lon, height, cov))
    return out


def settings_of(case: Case) -> Any:
    """Settings of a case."""
    return from_mapping(MemsIns.Settings, (JOINT if case.joint else LITERAL) | dict(case.changes))


def stream_of(case: Case) -> list[Measurement]:
    """Fixes and samples in order of time, a fix before the sample of its stamp: the offset is that of the epoch."""
    return sorted([*fixes(case), *samples(case)], key=lambda m: (m.stamp_ns, not isinstance(m, GpsPosition)))


def fly(case: Case) -> Flown:
    """Fly a case through the navigator."""
    navigator, flight, frame = MemsIns(settings_of(case)), path(), frame_of(case.earth)
    ins: list[np.ndarray] = []
    rows: list[tuple[float, list[np.ndarray]]] = []
    solutions: list[NavSolution] = []
    nan = np.full(3, np.nan)
    for item in stream_of(case):
        solutions += navigator.feed(item)
        core = navigator.core
        if isinstance(core, CascadeCore) and core.started:
            while len(ins) < len(solutions):
                ins.append(core.frame.from_ned(core.A[:, 0]))
        elif isinstance(core, CascadeCore) or not solutions:
            continue
        if not isinstance(item, GpsPosition):
            continue
        step = round((item.stamp_ns - NS) / NS / STEP_S)
        row = [frame.to_ned(item.lat, item.lon, item.height) / FOOT - flight.position[step]]
        if isinstance(core, CascadeCore) and core.gps is not None:
            parts = core.gps.accel, core.gps.filtered, core.accel_offset(), core.position_offset(), core.estimate[:3], core.estimate[3:]
            row += [nan if part is None else part / FOOT for part in parts]
        else:
            row += [nan] * 6
        rows.append((step * STEP_S, row))
    stamps = np.array([s.stamp_ns for s in solutions])
    at = np.round((stamps - NS) / NS / STEP_S).astype(int)
    true = flight.position[at]

    def off(places: Any) -> np.ndarray:
        return np.array([frame.to_ned(*place) for place in places]) / FOOT - true

    free = off(ins) if ins else np.full_like(true, np.nan)
    sigma = np.sqrt([s.cov_pos.diagonal() for s in solutions if s.cov_pos is not None]) / FOOT
    names = "fix_error", "accel", "filtered", "z_accel", "z_position", "b_accel", "b_position"
    columns = {name: np.array([row[k] for _, row in rows]) for k, name in enumerate(names)}
    own = flight.t_s[at], off(s.place for s in solutions), sigma, free, np.array([t for t, _ in rows])
    return Flown(*own, modes=tuple(s.mode for s in solutions), **columns)


def changed(case: Case, **changes: Any) -> Case:
    """A case with further settings, dots written as double underscores."""
    return replace(case, changes=case.changes + tuple((key.replace("__", "."), value) for key, value in changes.items()))
