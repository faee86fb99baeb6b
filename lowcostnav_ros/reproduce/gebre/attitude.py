"""Attitude: vector matching, the Euler-angle filter with GPS attitude, gains of both forms (GR23 to GR30).

Vector matching: field 0.5 G, dip 61.5 deg, declination 15 deg east; gravity as the second vector in units of g.  Euler filter: gyros at
20 Hz with 0.05 deg/s per sample, GPS attitude at 2 Hz with 0.25 deg, tuning of table 4.2 with the drift driven by beta directly.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation import attitude_gains as gains
from lowcostnav_ros.estimation import attitude_vectors as vectors
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.gnss.attitude_antennas import attitude_from_phases, isosceles_array, phase_differences
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_conjugate, quat_rotate, rotvec_from_quat, wrap
from lowcostnav_ros.physics.stochastic import GaussMarkov, initial_state, simulate
from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.registry import Change, Context, Outcome, Reading, judged, read, result
from lowcostnav_ros.studies.attitude_filters import euler_filter

DIP, DECLINATION = 61.5 * DEGREE, 15.0 * DEGREE
FIELD_N = 0.5 * np.array([math.cos(DIP) * math.cos(DECLINATION), math.cos(DIP) * math.sin(DECLINATION), math.sin(DIP)])
GRAVITY_N = np.array([0.0, 0.0, 1.0])
ANGLES = ("roll", "pitch", "heading")
RATE_HZ, EVERY = 20, 10
TRUE_BIAS = 0.3 * DEGREE


def _draw_cases(rng: np.random.Generator, runs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True angles, field noise of 1 mG and accelerometer noise of 1 milli-g, each (runs, 3)."""
    eulers = np.column_stack([rng.uniform(-limit, limit, runs) for limit in (60.0, 20.0, 180.0)]) * DEGREE
    return eulers, 1e-3 * rng.standard_normal((runs, 3)), 1e-3 * rng.standard_normal((runs, 3))


def _matched(context: Context, form: int, runs: int) -> np.ndarray:
    """Errors (runs, 3), deg, with a step of 0.1 and 100 iterations."""
    eulers, field, force = _draw_cases(context.rng("vector matching"), runs)
    return vectors.match_many(eulers, FIELD_N, GRAVITY_N, field, force, 0.1, 100, form) / DEGREE


@result(
    "GR23",
    "Vector matching, 10 000 random attitudes, step 0.1, 100 iterations, 1 mG and 1 milli-g",
    source="Section 4.9, page 118, and figure 4.5",
    thesis="3 runs with a heading error above 10 deg; largest pitch error 1.8 deg, largest roll error 2.3 deg",
    tolerance="0 to 10 runs above 10 deg; largest roll and pitch of all runs below 5 deg; the literal Jacobian fails in 43 % (5 %)",
    changed=Change("2026-11-27", "reproduced", "the largest errors were judged without the lost runs, the thesis counts them"),
)
def vector_matching(context: Context) -> Outcome:
    """Both consistent forms of the iteration, and the literal one."""
    errors = {form: _matched(context, form, 10_000) for form in (vectors.RIGHT, vectors.LEFT)}
    literal = _matched(context, vectors.LITERAL, 2_000 if context.quick else 10_000)
    failed = 100.0 * float(np.mean(np.abs(literal[:, 2]) > 10.0))
    lost = {form: int(np.sum(np.abs(e[:, 2]) > 10.0)) for form, e in errors.items()}
    found = {form: e[np.abs(e[:, 2]) <= 10.0] for form, e in errors.items()}
    right = found[vectors.RIGHT]
    spread, largest, of_all = right.std(axis=0), np.abs(right).max(axis=0), np.abs(errors[vectors.RIGHT]).max(axis=0)
    ours = (
        f"{lost[vectors.RIGHT]} runs lost (in n: {lost[vectors.LEFT]}); sigma roll {spread[0]:.3f}, pitch {spread[1]:.3f}, heading "
        f"{spread[2]:.2f} deg; largest roll {largest[0]:.1f}, pitch {largest[1]:.1f} deg in the others, {of_all[0]:.1f} and "
        f"{of_all[1]:.1f} deg of all; the Jacobian as printed fails in {failed:.0f} %"
    )

    def draw(figure: Any) -> None:
        """Histograms of the angle errors."""
        for k, name in enumerate(ANGLES):
            made = axes(figure, (1, 3, 1 + k), x=f"{name} error [deg]", y="runs" if k == 0 else "")
            made.hist(right[:, k], bins=60)

    good = all(count <= 10 for count in lost.values()) and float(of_all[:2].max()) < 5.0 and abs(failed - 43.0) < 5.0
    return judged(ours, good, "the lost runs decide the largest errors, and their number is a matter of chance", draw)


@result(
    "GR24",
    "Vector matching, history of the quaternion from an arbitrary start",
    source="Figure 4.4",
    thesis="smooth convergence, settled within about 50 iterations at a step of 0.1",
    tolerance="below 1 deg within 60 iterations at 0.1 and within 6 at 1.0; the error never grows",
)
def convergence(context: Context) -> Outcome:
    """One attitude, steps of 0.1 and 1."""
    truth = euler_to_quat(35.0 * DEGREE, 12.0 * DEGREE, 110.0 * DEGREE)
    field_b, gravity_b = [quat_rotate(quat_conjugate(truth), v) for v in (FIELD_N, GRAVITY_N)]
    histories, left = {}, {}
    for step in (0.1, 1.0):
        history = vectors.match_history(np.array([1.0, 0.0, 0.0, 0.0]), FIELD_N, GRAVITY_N, field_b, gravity_b, step, 100, vectors.RIGHT)
        histories[step] = history * np.sign(history @ truth)[:, np.newaxis]
        left[step] = np.array([np.linalg.norm(rotvec_from_quat(_product(quat_conjugate(truth), q))) for q in history]) / DEGREE
    needed = {step: int(np.argmax(angle < 1.0)) if np.any(angle < 1.0) else len(angle) for step, angle in left.items()}
    monotone = bool(np.all(np.diff(left[0.1]) < 1e-9))
    ours = f"below 1 deg after {needed[0.1]} iterations at 0.1 ({left[0.1][50]:.1f} deg after 50) and {needed[1.0]} at 1.0"

    def draw(figure: Any) -> None:
        """The quaternion on its way to the truth, and the angle left."""
        made = axes(figure, (1, 2, 1), x="iteration", y="quaternion", title="step 0.1 (dotted: truth)")
        made.plot(histories[0.1], label=["q0", "q1", "q2", "q3"])
        for value in truth:
            made.axhline(value, color="0.5", linestyle=":", linewidth=0.8)
        legend(made)
        right = axes(figure, (1, 2, 2), x="iteration", y="angle left [deg]", title="error")
        for step, angle in left.items():
            right.semilogy(np.maximum(angle, 1e-9), label=f"step {step:g}")
        legend(right)

    return judged(ours, needed[0.1] <= 60 and needed[1.0] <= 6 and monotone, "The start is farther off than the figure's.", draw)


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    return np.concatenate(([p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])))


@dataclass(frozen=True)
class Start:
    """One run of the Euler filter: 20 Hz gyros with a bias of 0.3 deg/s on each axis, GPS attitude, then none."""

    drift_dps: float
    seconds: int
    coast_s: int
    pitch_deg: float = 0.0

    def run(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Angles, estimated bias, true bias and angles, each (n, 3), rad and rad/s, and GPS angles (m, 3)."""
        n = (self.seconds + self.coast_s) * RATE_HZ
        t = np.arange(1, n + 1) / RATE_HZ
        truth = np.zeros((n, 3))
        truth[:, 1] = self.pitch_deg * DEGREE * np.sin(2.0 * np.pi * t / 60.0)
        rates = np.zeros((n, 3))
        rates[:, 1] = np.diff(truth[:, 1], prepend=0.0) * RATE_HZ
        process = GaussMarkov(self.drift_dps * DEGREE, 1000.0)
        bias = TRUE_BIAS + simulate(process, 1.0 / RATE_HZ, n, rng, initial_state(process, rng, 3))[0]
        rates += bias + 0.05 * DEGREE * rng.standard_normal((n, 3))
        measured = truth[EVERY - 1 :: EVERY] + 0.25 * DEGREE * rng.standard_normal((n // EVERY, 3))
        on_angle, on_rate = gains.axis_gains(gains.GPS_FLOWN, 0.25)
        start = np.zeros(3)
        angles, learned = euler_filter(
            start, np.zeros(3), rates, measured, EVERY, on_angle, on_rate, 1.0 / RATE_HZ, self.seconds * RATE_HZ // EVERY
        )
        return angles, -learned, bias, truth, measured


def _runs(context: Context, start: Start, count: int) -> Iterator[tuple[np.ndarray, ...]]:
    """Runs one by one: together they would take gigabytes."""
    return (start.run(context.rng(f"euler {start} {k}")) for k in range(count))


def _last_above(values: np.ndarray, limit: float) -> int:
    """Number of samples until values are below a limit for good."""
    above = np.flatnonzero(values > limit)
    return int(above[-1]) + 1 if above.size else 0


@result(
    "GR25",
    "Euler filter, gyro biases after the start (0.3 deg/s)",
    source="Figure 4.10, tuning of table 4.2",
    thesis="settled in 3 to 4 minutes (recomputed: mean absolute error 0.043 deg/s at 2 min and 0.011 at 4 min)",
    tolerance="below a tenth of 0.3 deg/s from 3 to 4 minutes on, which one start in twenty may miss; recomputed values within 50 %",
    changed=Change("2026-11-27", "reproduced", "2 to 4 minutes were allowed where the thesis says 3 to 4"),
)
def bias_settling(context: Context) -> Outcome:
    """Bias errors of many starts with the drift of table 3.1, 0.05 deg/s."""
    count = 20 if context.quick else 200
    mean, single = np.zeros(400 * RATE_HZ), []
    for _, learned, bias, _, _ in _runs(context, Start(0.05, 400, 0), count):
        error = np.abs(bias - learned) / DEGREE
        mean += error.mean(axis=1) / count
        single += [_last_above(column, 0.03) / RATE_HZ / 60.0 for column in error[: 300 * RATE_HZ].T]
    two, four = mean[120 * RATE_HZ - 1], mean[240 * RATE_HZ - 1]
    settled = _last_above(mean, 0.03) / RATE_HZ / 60.0
    recomputed = abs(two / 0.043 - 1.0) < 0.5 and abs(four / 0.011 - 1.0) < 0.5
    low, middle, high = np.quantile(single, (0.05, 0.5, 0.95))
    sizes = f"mean absolute error {two:.3f} deg/s at 2 min, {four:.3f} at 4 min"
    readings = [
        Reading("mean of many starts", f"{sizes}; below 0.03 deg/s from {settled:.1f} min on", recomputed and 3.0 < settled < 4.0),
        Reading("one gyro of one start, as in the figure", f"{middle:.1f} min (90 %: {low:.1f} to {high:.1f})", recomputed and high > 3.0),
    ]

    def draw(figure: Any) -> None:
        """Estimated gyro biases of one start."""
        made = axes(figure, x="time [min]", y="estimated gyro bias [deg/s]", title="one start; dotted: true, 0.3 deg/s and drift")
        t_min = np.arange(1, len(mean) + 1) / RATE_HZ / 60.0
        _, learned, bias, _, _ = next(_runs(context, Start(0.05, 400, 0), 1))
        for k, name in enumerate(ANGLES):
            made.plot(t_min, learned[:, k] / DEGREE, f"C{k}", label=name, linewidth=0.8)
            made.plot(t_min, bias[:, k] / DEGREE, f"C{k}:", linewidth=0.8)
        legend(made)

    return read(readings, figure=draw)


@result(
    "GR26",
    "Five minutes of coasting on the gyros after convergence",
    source="Figure 4.11",
    thesis="below 4 deg on all axes in one flight (recomputed sigma at 300 s: 1.5 deg with a drift of 0.01 deg/s, 7.5 deg with 0.05)",
    tolerance="at least 90 % of the axes below 4 deg for a drift of 0.01 deg/s; recomputed sigmas within 25 %",
)
def coasting(context: Context) -> Outcome:
    """Gains frozen after 15 minutes; both readings of the gyro's drift."""
    count = 60 if context.quick else 600
    ends, tracks = {}, {}
    for drift in (0.01, 0.05):
        last = [wrap(angles[-1] - truth[-1]) for angles, _, _, truth, _ in _runs(context, Start(drift, 900, 300), count)]
        ends[drift] = np.concatenate(last) / DEGREE
        angles, _, _, truth, _ = next(_runs(context, Start(drift, 900, 300), 1))
        tracks[drift] = wrap(angles - truth)[900 * RATE_HZ :] / DEGREE
    share = 100.0 * float(np.mean(np.abs(ends[0.01]) < 4.0))
    low, high = (float(np.std(ends[drift])) for drift in (0.01, 0.05))
    ours = f"{share:.0f} % of axes below 4 deg, sigma {low:.1f} deg (drift 0.01 deg/s); sigma {high:.1f} deg (drift 0.05 deg/s)"

    def draw(figure: Any) -> None:
        """Errors of one run for each drift."""
        for k, drift in enumerate((0.01, 0.05)):
            made = axes(figure, (1, 2, 1 + k), x="time since GPS was lost [s]", y="error [deg]", title=f"drift {drift} deg/s, one run")
            made.plot(np.arange(len(tracks[drift])) / RATE_HZ, tracks[drift], label=list(ANGLES), linewidth=0.8)
            made.axhline(4.0, color="r", linewidth=0.6)
            made.axhline(-4.0, color="r", linewidth=0.6)
            legend(made)

    good = share >= 90.0 and abs(low / 1.5 - 1.0) < 0.25 and abs(high / 7.5 - 1.0) < 0.25
    return judged(ours, good, "Chance of the draw at this number of runs.", draw)


@result(
    "GR27",
    "GPS attitude noise smoothed by the gyros",
    source="Figures 4.9 and 4.12",
    thesis="a smooth pitch from 0.25 deg of GPS noise (recomputed: steady sigma about 0.05 deg)",
    tolerance="jitter below 0.15 deg; an antenna triangle of 36, 50, 50 cm solves its attitude with the noise its geometry predicts",
)
def smoothing(context: Context) -> Outcome:
    """Pitching flight after convergence; and the three-antenna solution from carrier phases."""
    runs = list(_runs(context, Start(0.01, 600, 0, 3.0), 4))
    settled = slice(300 * RATE_HZ, None)
    errors = np.concatenate([wrap(angles - truth)[settled] for angles, _, _, truth, _ in runs]) / DEGREE
    steady = float(errors.std())
    solved, stated = _antennas(context, 200 if context.quick else 1000)
    ours = (
        f"error of {steady:.3f} deg (sigma) from 0.25 deg; three antennas with 2 mm of phase noise: {solved:.2f} deg (RMS of three axes), "
        f"{stated:.2f} deg stated"
    )

    def draw(figure: Any) -> None:
        """Pitch as measured and filtered, and the antennas that measure it."""
        angles, _, _, truth, measured = runs[0]
        made = axes(figure, (1, 2, 1), x="time [s]", y="pitch [deg]", title="GPS attitude and filter")
        t = np.arange(1, len(truth) + 1) / RATE_HZ
        window = (t > 420.0) & (t <= 480.0)
        made.plot(t[EVERY - 1 :: EVERY][840:960], measured[840:960, 1] / DEGREE, ".", color="0.6", label="GPS")
        made.plot(t[window], angles[window, 1] / DEGREE, label="filter")
        made.plot(t[window], truth[window, 1] / DEGREE, "k:", linewidth=0.8, label="truth")
        legend(made)
        triangle = axes(figure, (1, 2, 2), x="right [m]", y="forward [m]", title="antennas: 36, 50, 50 cm")
        corners = np.vstack((np.zeros(3), isosceles_array(), np.zeros(3)))
        triangle.plot(corners[:, 1], corners[:, 0], "o-")
        triangle.set_aspect("equal")

    return judged(ours, steady < 0.15 and abs(solved / stated - 1.0) < 0.15, "Chance of the draw.", draw)


def _antennas(context: Context, runs: int) -> tuple[float, float]:
    """RMS error and mean stated sigma, deg, of attitude from carrier phases of eight satellites, 2 mm of noise."""
    rng, baselines = context.rng("antennas"), isosceles_array()
    squared, stated = 0.0, 0.0
    for _ in range(runs):
        azimuth, elevation = rng.uniform(-np.pi, np.pi, 8), np.arcsin(rng.uniform(0.17, 1.0, 8))
        sight = np.column_stack((np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), -np.sin(elevation)))
        angles = rng.uniform(-0.5, 0.5, 3)
        q, seed = euler_to_quat(*angles), euler_to_quat(*(angles + rng.normal(0.0, 0.1, 3)))  # the gyros' attitude starts the search
        phases = phase_differences(q, sight, baselines, rng.normal(0.0, 0.1, 2)) + 2e-3 * rng.standard_normal((8, 2))
        found, cov = attitude_from_phases(phases, sight, baselines, seed, 2e-3)
        squared += float(np.sum(rotvec_from_quat(_product(quat_conjugate(q), found)) ** 2))
        stated += float(np.trace(cov))
    return math.sqrt(squared / (3 * runs)) / DEGREE, math.sqrt(stated / (3 * runs)) / DEGREE


@result(
    "GR28",
    "Slow and fast poles of the bias estimate",
    source="Figure 4.13, table 4.3",
    thesis="slow: little noise, slow convergence; fast: quick and noisy (recomputed: 218 and 22 s; bias sigma 0.030 and 0.106 deg/s)",
    tolerance="20 %",
)
def poles(context: Context) -> Outcome:
    """Time constants and steady covariance of one axis, and one start with each."""
    cases = {"slow": gains.SLOW_POLES, "fast": gains.FAST_POLES}
    times = {name: float(gains.closed_loop_times(tuning, 0.25)[-1]) for name, tuning in cases.items()}
    sigmas = {n: math.sqrt(kalman.steady_state_gain(*gains.axis_model(t, 0.25))[1][1, 1]) / DEGREE for n, t in cases.items()}
    ours = "; ".join(f"{name}: {times[name]:.0f} s, bias sigma {sigmas[name]:.3f} deg/s" for name in cases)
    expected = {"slow": (218.0, 0.030), "fast": (22.0, 0.106)}
    good = all(abs(times[n] / e[0] - 1.0) < 0.2 and abs(sigmas[n] / e[1] - 1.0) < 0.2 for n, e in expected.items())

    def draw(figure: Any) -> None:
        """Roll gyro bias of one start for each choice of poles."""
        made = axes(figure, x="time [s]", y="roll gyro bias [deg/s]", title="poles of table 4.3, one start")
        rng, n = context.rng("poles"), 600 * RATE_HZ
        process = GaussMarkov(0.05 * DEGREE, 1000.0)
        bias = TRUE_BIAS + simulate(process, 1.0 / RATE_HZ, n, rng, np.zeros(3))[0]
        rates = bias + 0.05 * DEGREE * rng.standard_normal((n, 3))
        measured = 0.25 * DEGREE * rng.standard_normal((n // EVERY, 3))
        t = np.arange(1, n + 1) / RATE_HZ
        for name, tuning in reversed(cases.items()):
            learned = euler_filter(
                np.zeros(3), np.zeros(3), rates, measured, EVERY, *gains.axis_gains(tuning, 0.25), 1.0 / RATE_HZ, n // EVERY
            )[1]
            made.plot(t, -learned[:, 0] / DEGREE, label=name, linewidth=0.8)
        made.plot(t, bias[:, 0] / DEGREE, "k", label="true", linewidth=0.8)
        legend(made)

    return judged(ours, good, "", draw)
