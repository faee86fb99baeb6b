"""A recorded flight as truth: smooth, self-consistent motion close to what was really flown.

A recording is noisy, and its position is not the integral of its velocity.  So velocity is smoothed by splines, the slow part
of what then separates its integral from the recorded position is added to it, and position is integrated anew.  The result is
within the receiver's noise of the recording and is exact motion: velocity is the derivative of position, and twice differentiable.
"""

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_lsq_spline

from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, radii
from lowcostnav_ros.physics.rotation import eulers_to_quat
from lowcostnav_ros.trajectory.trajectory import Trajectory, integrate_position, pieces_of_motion
from lowcostnav_ros.trajectory.truth_settings import TruthSettings
from lowcostnav_ros.trajectory.wind import Wind

COLUMNS = ("t", "lat_deg", "lon_deg", "height_m", "vn", "ve", "vd")
EULER_COLUMNS = ("roll_deg", "pitch_deg", "heading_deg")
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
LONGEST_GAP_S = 5.0
"""Longest gap of a recording that splines may bridge."""
VELOCITY_S = 1.0
"""Knot spacing of velocity: slow enough to pass over receiver noise, fast enough for a light aircraft's turns."""
CORRECTION_S = 20.0
"""Knot spacing of the slow correction of velocity."""
SLOWEST = 5.0
"""Ground speed, m/s, below which the direction of motion does not give the heading."""
_LEAST_ROWS = 8


def read_recording(path: str | Path) -> dict[str, np.ndarray]:
    """Read the columns of a recorded flight from a CSV file with a header line.

    Returns
    -------
    dict of str to ndarray
        ``t`` s, ``lat_deg``, ``lon_deg``, ``height_m`` above the ellipsoid, ``vn``, ``ve``, ``vd`` m/s and, when present,
        ``roll_deg``, ``pitch_deg``, ``heading_deg`` or ``qw``, ``qx``, ``qy``, ``qz`` (FRD to NED).

    Raises
    ------
    SettingsError
        When the file cannot be read, lacks a column, holds something that is not a number, runs backwards or has long gaps.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SettingsError(f"The recording {path} cannot be read ({error}); give a CSV file with a header line.") from None
    if len(rows) < _LEAST_ROWS:
        raise SettingsError(f"The recording {path} has {len(rows)} rows; at least {_LEAST_ROWS} are needed.")
    for name in COLUMNS:
        if name not in rows[0]:
            raise SettingsError(f"The recording {path} has no column '{name}'{nearest(name, [k for k in rows[0] if k])}.")
    wanted = [*COLUMNS, *(n for n in EULER_COLUMNS + QUATERNION_COLUMNS if n in rows[0])]
    columns = {name: _numbers(path, rows, name) for name in wanted}
    _check_times(path, columns["t"])
    return columns


def _numbers(path: str | Path, rows: list[dict], name: str) -> np.ndarray:
    out = np.empty(len(rows))
    for k, row in enumerate(rows):
        try:
            out[k] = float(row[name])
        except (TypeError, ValueError):
            out[k] = math.nan
        if not math.isfinite(out[k]):
            raise SettingsError(f"The recording {path}, line {k + 2}: '{name}' is {row[name]!r}; correct or remove the line.")
    return out


def _check_times(path: str | Path, t: np.ndarray) -> None:
    steps = np.diff(t)
    if np.any(steps <= 0.0):
        raise SettingsError(f"The recording {path}, line {np.argmax(steps <= 0.0) + 3}: time does not increase; sort and drop duplicates.")
    if steps.max() > LONGEST_GAP_S:
        line = np.argmax(steps) + 3
        raise SettingsError(f"The recording {path}, line {line}: a gap of {steps.max():.1f} s is too long to bridge; cut it there.")


class RecordedMotion:
    """A recorded flight as functions of time (see :class:`~lowcostnav_ros.trajectory.trajectory.Motion`).

    Parameters
    ----------
    columns : dict of str to ndarray
        As :func:`read_recording` returns them.
    settings : TruthSettings
        For the wind, which a recording does not hold.
    seed : int
        Of the wind.
    """

    def __init__(self, columns: dict[str, np.ndarray], settings: TruthSettings, seed: int) -> None:
        self._t = columns["t"] - columns["t"][0]
        self.duration_s = float(self._t[-1])
        raw = _smooth_spline(self._t, np.column_stack([columns[n] for n in ("vn", "ve", "vd")]), VELOCITY_S)
        self.lat, self.lon, self.height = _first_position(columns)
        slow = _smooth_spline(self._t, self._residual(columns, raw), CORRECTION_S)
        self._velocity, self._correction = raw, slow.derivative()
        self._shift(slow(0.0))
        self._attitude = _attitude_spline(self._t, columns)
        self._wind = Wind(settings.wind, seed, self.height, settings.start.airspeed_mps)

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity over ground (n, 3), ``q_nb`` (n, 4) and wind (n, 3) at ``t_s`` seconds."""
        t = np.clip(t_s, 0.0, self.duration_s)
        vel = self._velocity(t) + self._correction(t)
        wind = self._wind.steady(t, np.full(len(t), self.height))
        return vel, self._attitude_at(t, vel, wind), wind

    def _residual(self, columns: dict[str, np.ndarray], raw: BSpline) -> np.ndarray:
        """Recorded position minus the integral of recorded velocity at the recorded times, (n, 3) m NED."""
        halves = np.interp(np.arange(2 * len(self._t) - 1) * 0.5, np.arange(len(self._t)), self._t)
        track = integrate_position(self.lat, self.lon, self.height, raw(halves), np.diff(self._t))
        meridian, normal = radii(self.lat)
        north = (np.radians(columns["lat_deg"]) - track[:, 0]) * (meridian + self.height)
        east = (np.radians(columns["lon_deg"]) - track[:, 1]) * (normal + self.height) * np.cos(track[:, 0])
        return np.column_stack((north, east, track[:, 2] - columns["height_m"]))

    def _shift(self, by_n: np.ndarray) -> None:
        meridian, normal = radii(self.lat)
        self.lon += by_n[1] / ((normal + self.height) * math.cos(self.lat))
        self.lat += by_n[0] / (meridian + self.height)
        self.height -= by_n[2]

    def _attitude_at(self, t: np.ndarray, vel: np.ndarray, wind: np.ndarray) -> np.ndarray:
        if self._attitude is not None:
            quats = self._attitude(t)
            return quats / np.linalg.norm(quats, axis=1, keepdims=True)
        return eulers_to_quat(self._coordinated(t, vel - wind))

    def _coordinated(self, t: np.ndarray, air: np.ndarray) -> np.ndarray:
        """Roll, pitch, heading (n, 3) of coordinated flight along the velocity through the air."""
        acceleration = self._velocity(t, 1) + self._correction(t, 1)
        level = np.maximum(np.hypot(air[:, 0], air[:, 1]), SLOWEST)
        turning = (air[:, 0] * acceleration[:, 1] - air[:, 1] * acceleration[:, 0]) / level
        return np.column_stack((np.arctan2(turning, STANDARD_GRAVITY), np.arctan2(-air[:, 2], level), np.arctan2(air[:, 1], air[:, 0])))


def _first_position(columns: dict[str, np.ndarray]) -> tuple[float, float, float]:
    return math.radians(columns["lat_deg"][0]), math.radians(columns["lon_deg"][0]), float(columns["height_m"][0])


def _smooth_spline(t: np.ndarray, values: np.ndarray, spacing_s: float) -> BSpline:
    """Least-squares quintic spline whose knots are sample times at least ``spacing_s`` and two samples apart."""
    inner: list[float] = []
    last = 0
    for k in range(2, len(t) - 2):
        if k - last >= 2 and t[k] - t[last] >= spacing_s:
            inner.append(t[k])
            last = k
    if len(t) - 6 < len(inner):  # a least-squares spline has no more coefficients than samples
        inner = inner[::2]
    return make_lsq_spline(t, values, np.r_[[t[0]] * 6, inner, [t[-1]] * 6], k=5)


def _attitude_spline(t: np.ndarray, columns: dict[str, np.ndarray]) -> CubicSpline | None:
    """Spline through the recorded attitude, signs made continuous; None when the recording holds none."""
    if all(name in columns for name in QUATERNION_COLUMNS):
        quats = np.column_stack([columns[n] for n in QUATERNION_COLUMNS])
    elif all(name in columns for name in EULER_COLUMNS):
        quats = eulers_to_quat(np.radians(np.column_stack([columns[n] for n in EULER_COLUMNS])))
    else:
        return None
    flips = np.sum(quats[1:] * quats[:-1], axis=1) < 0.0
    quats[1:] *= np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)[:, None]
    return CubicSpline(t, quats)


def build_recorded(settings: TruthSettings, seed: int) -> Trajectory:
    """Recorded flight as truth; see :func:`lowcostnav_ros.trajectory.build`.

    Raises
    ------
    SettingsError
        For a recording that cannot be used, or a duration beyond its end.
    """
    motion = RecordedMotion(read_recording(settings.recording), settings, seed)
    if settings.duration_s > motion.duration_s:
        raise SettingsError(f"The recording lasts {motion.duration_s:.1f} s; ask for that or less, not {settings.duration_s:g} s.")
    duration_s = settings.duration_s or math.floor(motion.duration_s * settings.rate_hz) / settings.rate_hz

    def pieces() -> Iterator[TruthBlock]:
        return pieces_of_motion(motion, settings.start_ns, settings.rate_hz, duration_s)

    return Trajectory(settings.rate_hz, settings.start_ns, pieces)
