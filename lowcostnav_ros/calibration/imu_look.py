"""What an IMU shows of itself, at rest or in motion: rate, jitter, holes, white noise, units, and along which axis gravity lies.

White noise comes from fourth differences of short means, which a turn by hand leaves alone, by their median, which short manoeuvres leave
alone: Var = 70 N^2 / tau for a density N and means over tau.  In motion it is an upper bound,
vibration included, which is noise to a filter all the same.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.units import DEGREE, MILLI_G
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import euler_to_dcm

MEAN_S = 0.05
"""Length of the means that are compared; a low-pass filter in the unit has settled within it."""
FEWEST = 60
GAP, MEDIAN_TO_SIGMA = 1.5, 1.0 / 0.6745
REST_FORCE, REST_RATE = 0.3, 1.0 * DEGREE
"""One-second means that stay within so much of each other, m/s^2 and rad/s, are of a unit at rest."""
UNITS = (("m/s^2", 1.0), ("g", STANDARD_GRAVITY), ("mg", MILLI_G), ("cm/s^2", 0.01))
SURE, TURNED = 0.8, 0.2
"""Least correlation by which gravity must be seen to turn as the gyros say; least rate, rad/s in the unit found, that tells anything."""


@dataclass(frozen=True)
class ImuLook:
    """What samples of an inertial unit show.

    Attributes
    ----------
    samples : int
    duration_s, rate_hz, jitter_s : float
        Jitter is the scatter of the intervals, one sigma, holes left out.
    holes, longest_hole_s
        Intervals longer than :data:`GAP` of the usual one, and the longest.
    is_at_rest : bool
    gyro_noise, accel_noise : ndarray, shape (3,)
        White noise, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz); of means of :data:`MEAN_S`.
    mean_rate, mean_force : ndarray, shape (3,)
        rad/s and m/s^2, FRD as received.
    force_unit, rate_unit : str
        As the numbers look; empty where nothing tells.
    turns_by : float or None
        Rate of turn of gravity over that of the gyros: 1 where axes and units agree, -1 where the sense is reversed.
    findings : tuple of str
        Sentences: what is wrong, and what to do.
    """

    samples: int
    duration_s: float
    rate_hz: float
    jitter_s: float
    holes: int
    longest_hole_s: float
    is_at_rest: bool
    gyro_noise: np.ndarray
    accel_noise: np.ndarray
    mean_rate: np.ndarray
    mean_force: np.ndarray
    force_unit: str
    rate_unit: str
    turns_by: float | None
    findings: tuple[str, ...]

    def words(self) -> str:
        """The look in one line, in units of the field."""
        gyro, accel = float(self.gyro_noise.max()) / DEGREE, float(self.accel_noise.max()) / MILLI_G
        timing = f"{self.rate_hz:.4g} Hz" + (f", jitter {1e3 * self.jitter_s:.2g} ms" if self.jitter_s * self.rate_hz > 1e-3 else "")
        holes = f", {self.holes} holes up to {self.longest_hole_s:.2g} s" if self.holes else ""
        where = "at rest" if self.is_at_rest else "in motion"
        return f"{where} {timing}{holes}; noise: gyro {gyro:.2g} deg/s/rtHz, accelerometer {accel:.2g} mg/rtHz"


def look_at(block: ImuBlock) -> ImuLook | None:
    """Look at inertial samples in order of time; None where there are too few.

    Parameters
    ----------
    block : ImuBlock
        FRD, in m/s^2 and rad/s, or whatever stands for them.
    """
    block = block[np.isfinite(block.specific_force_b).all(axis=1) & np.isfinite(block.angular_rate_b).all(axis=1)]
    stamps_s = 1e-9 * (block.stamps_ns - block.stamps_ns[:1])
    if len(stamps_s) < FEWEST:
        return None
    intervals = np.diff(stamps_s)
    usual = float(np.median(intervals))
    if not usual > 0.0:
        return None
    is_hole = intervals > GAP * usual
    force, rate = block.specific_force_b, block.angular_rate_b
    unit, factor = _force_unit(float(np.median(np.linalg.norm(force, axis=1))))
    force = force * factor
    turns_by = _turns_by(stamps_s, force, rate, usual)
    rate_unit = _rate_unit(rate, turns_by)
    if rate_unit == "deg/s":
        rate, turns_by = rate * DEGREE, None if turns_by is None else turns_by / DEGREE
    means = [_means(values, round(1.0 / usual)) for values in (force, rate)]
    is_at_rest = all(len(m) and float(np.ptp(m, axis=0).max()) < most for m, most in zip(means, (REST_FORCE, REST_RATE), strict=True))
    count = max(1, round(MEAN_S / usual))
    mean_force = force.mean(axis=0)
    findings = [*_unit_findings(unit, rate_unit, block), *_axis_findings(mean_force, turns_by)]
    return ImuLook(
        samples=len(stamps_s),
        duration_s=float(stamps_s[-1]),
        rate_hz=1.0 / usual,
        jitter_s=float(intervals[~is_hole].std()),
        holes=int(is_hole.sum()),
        longest_hole_s=float(intervals.max()) if is_hole.any() else 0.0,
        is_at_rest=is_at_rest,
        gyro_noise=white_density(rate, count, usual),
        accel_noise=white_density(force, count, usual),
        mean_rate=rate.mean(axis=0),
        mean_force=mean_force,
        force_unit=unit,
        rate_unit=rate_unit,
        turns_by=turns_by,
        findings=tuple(findings),
    )


def white_density(values: np.ndarray, count: int, interval_s: float) -> np.ndarray:
    """White noise (3,), unit/sqrt(Hz), of samples (n, 3) that stand ``interval_s`` apart, of means of ``count`` of them."""
    means = _means(values, count)
    differences = np.abs(means[4:] - 4.0 * means[3:-1] + 6.0 * means[2:-2] - 4.0 * means[1:-3] + means[:-4])
    sigma = MEDIAN_TO_SIGMA * np.median(differences, axis=0) / math.sqrt(70.0)
    coarse = np.sqrt(np.mean(differences**2, axis=0) / 70.0)  # a quantised signal that rarely changes has a median of zero
    density: np.ndarray = np.where(sigma > 0.0, sigma, coarse) * math.sqrt(count * interval_s)
    return density


def _means(values: np.ndarray, count: int) -> np.ndarray:
    whole = len(values) // max(count, 1)
    return values[: whole * count].reshape(whole, max(count, 1), 3).mean(axis=1)


def _force_unit(norm: float) -> tuple[str, float]:
    """Unit in which a specific force of this size is one g or nearly so, and its factor to m/s^2; none: an empty name."""
    for unit, factor in UNITS:
        if 0.5 * STANDARD_GRAVITY < norm * factor < 2.0 * STANDARD_GRAVITY:
            return unit, factor
    return "", 1.0


def _turns_by(stamps_s: np.ndarray, force: np.ndarray, rate: np.ndarray, usual: float) -> float | None:
    """How fast gravity turns in the body over how fast the gyros say (du/dt = -w x u), where both show it clearly."""
    count = max(1, round(0.1 / usual))
    u, w, t = _means(force, count), _means(rate, count), _means(np.repeat(stamps_s[:, None], 3, axis=1), count)
    if len(u) < 5:
        return None
    u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-9)
    turned = (u[2:] - u[:-2]) / np.maximum(t[2:] - t[:-2], 1e-9)
    by_gyros = -np.cross(w[1:-1], u[1:-1])
    power, across = float(np.sum(by_gyros**2)), float(np.sum(by_gyros * turned))
    strength = math.sqrt(power * float(np.sum(turned**2)))
    if strength == 0.0 or float(np.quantile(np.linalg.norm(turned, axis=1), 0.9)) < TURNED or abs(across) < SURE * strength:
        return None
    return across / power


def _rate_unit(rate: np.ndarray, turns_by: float | None) -> str:
    if turns_by is not None:
        return "deg/s" if abs(turns_by) < 0.1 else "rad/s"
    return "deg/s" if float(np.quantile(np.abs(rate), 0.99)) > 10.0 else ""


def _unit_findings(force_unit: str, rate_unit: str, block: ImuBlock) -> list[str]:
    found = []
    if not force_unit:
        norm = float(np.median(np.linalg.norm(block.specific_force_b, axis=1)))
        found.append(f"specific force {norm:.3g} is one g in no unit: wrong scale, or free fall")
    elif force_unit != "m/s^2":
        found.append(f"specific force is in {force_unit}: m/s^2 wanted")
    if rate_unit == "deg/s":
        found.append("angular rate is in deg/s: rad/s wanted")
    return found


def _axis_findings(mean_force: np.ndarray, turns_by: float | None) -> list[str]:
    """Remarks on the axes: along which gravity is, and whether it turns as the gyros measure."""
    found = []
    axis, size = int(np.argmax(np.abs(mean_force))), float(np.abs(mean_force).max())
    if turns_by is not None and turns_by < 0.0:
        found.append("gravity turns against the gyros: left-handed axes, or gyros of reversed sign")
    if size < 0.8 * float(np.linalg.norm(mean_force)):
        found.append("gravity lies along no axis: the unit is mounted obliquely, or the aircraft stands on a slope")
    elif axis == 2 and mean_force[2] > 0.0:
        advice = "imu.mounting_deg [180, 0, 0], if it is upside down or has forward-right-down axes where forward-left-up is wanted"
        found.append(f"gravity points up: {advice}")
    elif axis != 2:
        turn = next(t for t in ((90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0)) if (_turned(t) @ mean_force)[2] < -0.8 * size)
        found.append(f"gravity lies along {'xy'[axis]}: imu.mounting_deg {list(turn)} levels it; then the yaw that turns its nose forward")
    return found


def _turned(mounting_deg: tuple[int, int, int]) -> np.ndarray:
    return euler_to_dcm(*np.radians(np.array(mounting_deg, dtype=float)))
