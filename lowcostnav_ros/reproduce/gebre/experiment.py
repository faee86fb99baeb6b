"""The magnetometer experiment on a wooden boom, simulated, and the heading error model drawn from it (GR18 to GR22).

The recorded data are not printed.  What can be computed is the same experiment with a rigid boom: attitudes by hand (all headings,
tilt up to 25 degrees), white noise of 4 mG on each axis (the printed sigma of the residual), calibration by the two-step
estimator, and heading against the true attitude.  Nothing here stands for the flexing of the boom.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.calibration.heading_error import averaged_sigma, level_heading_error, peak_heading_error
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerFit
from lowcostnav_ros.calibration.magnetometer_two_step import two_step_fit
from lowcostnav_ros.physics.magnetic_heading import magnetic_heading
from lowcostnav_ros.physics.rotation import euler_to_dcm, wrap
from lowcostnav_ros.reproduce.figures import axes, histogram, legend
from lowcostnav_ros.reproduce.registry import DIFFERS, Context, Outcome, Reading, by_definition, fitted, result

HORIZONTAL_G = 0.235
DIP = math.radians(61.5)
NOISE_G = 0.004
RATE_HZ = 20
MINUTES = 10
REPEATS = 9
TURNED_DEG = (0.5, 0.9, 1.2)
"""Attitude of the triad against the INS that it is compared with, roll, pitch, heading: C_m of (3.28), chosen for the printed means."""
FLEXING = "The simulated boom is rigid; the thesis names flexing of its boom as a cause of large errors and gives no model of it."


@dataclass(frozen=True, eq=False)
class _Experiment:
    """Calibration, residual field (n, 3) in gauss, true heading and heading error (n,) in rad at 20 Hz."""

    fit: MagnetometerFit
    raw: np.ndarray
    residual: np.ndarray
    heading: np.ndarray
    error: np.ndarray


def _attitudes(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Roll, pitch, heading (n, 3) of a boom swung by hand: slow sines of random phase and a steady turn, rad."""
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    phase = rng.uniform(0.0, 2.0 * math.pi, 4)
    roll = math.radians(15.0) * np.sin(0.31 * t + phase[0]) + math.radians(10.0) * np.sin(0.083 * t + phase[1])
    pitch = math.radians(15.0) * np.sin(0.23 * t + phase[2]) + math.radians(10.0) * np.sin(0.057 * t + phase[3])
    return np.column_stack([roll, pitch, wrap(0.11 * t)])


def _simulated(rng: np.random.Generator, turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> _Experiment:
    """One experiment; the triad may be turned against the INS whose attitude is taken for the true one."""
    attitudes, triad = _attitudes(rng, 60.0 * MINUTES), euler_to_dcm(*np.radians(turned_deg)).T
    field_n = HORIZONTAL_G * np.array([1.0, 0.0, math.tan(DIP)])
    true_b = np.array([euler_to_dcm(*attitude).T @ field_n for attitude in attitudes])
    raw = true_b @ triad.T * [1.05, 0.97, 1.02] + [0.10, -0.05, 0.08] + NOISE_G * rng.standard_normal(true_b.shape)
    fit = two_step_fit(raw, float(np.linalg.norm(field_n)))
    calibrated = fit.apply(raw)
    headings = [magnetic_heading(a[0], a[1], b, 0.0) for a, b in zip(attitudes, calibrated, strict=True)]
    return _Experiment(fit, raw, calibrated - true_b, attitudes[:, 2], wrap(np.array(headings) - attitudes[:, 2]))


def _experiments(context: Context, turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> list[_Experiment]:
    """Repeat the experiment, because one calibration's mean residual is a matter of chance; the first is the one drawn."""
    return context.once(f"boom {turned_deg}", lambda: [_simulated(context.rng(f"boom {k}"), turned_deg) for k in range(REPEATS)])


def _residuals(repeats: list[_Experiment]) -> tuple[np.ndarray, float, str]:
    """Mean residual by axis, mG, medians over the experiments, the sigma of the worst axis, and both in words."""
    means = np.median([1e3 * e.residual.mean(axis=0) for e in repeats], axis=0)
    worst = int(np.argmax(np.abs(means)))
    sigma = float(np.median([1e3 * e.residual[:, worst].std() for e in repeats]))
    text = f"means {means[0]:.1f}, {means[1]:.1f}, {means[2]:.1f} mG, sigma of {'xyz'[worst]} {sigma:.1f} mG"
    return means, sigma, text


def _heading_errors(repeats: list[_Experiment]) -> str:
    error = np.degrees(repeats[0].error)
    return f"mean {error.mean():.2f} deg, standard deviation {error.std():.2f} deg, largest {np.abs(error).max():.1f} deg"


@result(
    "GR18",
    "Field residual after calibration, boom experiment",
    source="Figures 3.26 and 3.27",
    thesis="worst axis: mean -7 mG, sigma 4 mG; means of the axes 4 to 7 mG",
    tolerance="factor 2",
)
def boom_residual(context: Context) -> Outcome:
    """Residual of the simulated experiments against the attitude of the INS, the triad parallel to it and turned."""
    repeats = _experiments(context, TURNED_DEG)
    found = repeats[0]
    (means, sigma, text), parallel = _residuals(repeats), _residuals(_experiments(context))[2]
    good = 3.5 <= float(np.abs(means).max()) <= 14.0 and 2.0 <= sigma <= 8.0

    def draw(figure: Any) -> None:
        """The residual of the first minute."""
        space = figure.add_subplot(1, 2, 1, projection="3d")
        few = slice(None, None, 20)
        space.scatter(*found.raw[few].T, s=2, label="before")
        space.scatter(*found.fit.apply(found.raw[few]).T, s=2, label="after")
        space.set_title("measured field [G]", fontsize=9)
        legend(space)
        right = axes(figure, (1, 2, 2), x="time [s]", y="residual [mG]", title="first minute")
        for axis, name in enumerate("xyz"):
            right.plot(np.arange(1200) / RATE_HZ, 1e3 * found.residual[:1200, axis], linewidth=0.5, label=name)
        legend(right)

    setting = "the turn of the triad against the INS by (0.5, 0.9, 1.2) deg, C_m of (3.28), and the noise, the printed sigma"
    shown = f"{text} (medians of {REPEATS} experiments); calibration over {found.fit.coverage}"
    return fitted(shown, good, setting, f"parallel to the INS {parallel}", figure=draw)


@result(
    "GR19",
    "Magnetometer heading against the true one, one minute",
    source="Figure 3.28",
    thesis="a one-minute trace within a few degrees",
    tolerance="3 deg RMS",
)
def boom_trace(context: Context) -> Outcome:
    """First minute of the simulated experiment, 20 Hz."""
    found = _experiments(context)[0]
    rms = math.degrees(float(np.sqrt(np.mean(found.error[:1200] ** 2))))

    def draw(figure: Any) -> None:
        """Heading of a minute, and its error."""
        left = axes(figure, (1, 2, 1), x="time [s]", y="heading [deg]", title="one minute at 20 Hz")
        t, truth, error = np.arange(1200) / RATE_HZ, np.unwrap(found.heading[:1200]), found.error[:1200]
        left.plot(t, np.degrees(truth + error), linewidth=0.6, label="magnetometer")
        left.plot(t, np.degrees(truth), "k--", linewidth=0.8, label="truth")
        legend(left)
        right = axes(figure, (1, 2, 2), x="time [s]", y="heading error [deg]", title="magnetometer minus truth")
        right.plot(t, np.degrees(error), linewidth=0.6)

    untuned = "none, it follows from the noise and the horizontal field, 4 mG / 235 mG = 1.0 deg"
    return fitted(f"{rms:.2f} deg RMS", rms < 3.0, "the noise of 4 mG, the printed sigma of the residual", untuned, figure=draw)


@result(
    "GR20",
    "Heading error of the whole boom experiment",
    source="Figure 3.29",
    thesis="mean 1.2 deg, standard deviation 3.6 deg, largest 18 deg",
    tolerance="none stated",
)
def boom_heading(context: Context) -> Outcome:
    """Statistics of the simulated experiment, the triad parallel to the INS and turned; there is no tolerance."""
    parallel, turned = _experiments(context), _experiments(context, TURNED_DEG)
    error = np.degrees(turned[0].error)
    readings = (
        Reading("triad parallel to the INS", _heading_errors(parallel), False),
        Reading("triad turned by (0.5, 0.9, 1.2) deg against it", _heading_errors(turned), False),
    )

    def draw(figure: Any) -> None:
        """Histogram of the heading error."""
        made = axes(figure, x="heading error [deg]", y="samples", title="whole experiment")
        histogram(made, [np.degrees(parallel[0].error), error], ["rigid boom", "rigid boom, triad turned"])
        legend(made)

    ours = "; ".join(f"{reading.name}: {reading.ours}" for reading in readings)
    why = "the mean is that of a turned triad, the closest reading; the standard deviation and the largest are not. " + FLEXING
    return Outcome(ours, DIFFERS, why, draw, readings)


@result(
    "GR21",
    "Heading error from the field residual",
    source="Figure 3.30, equation 3.48",
    thesis="largest 2.5 deg for residuals of 7 mG and a horizontal field of 0.235 G",
    tolerance="10 %",
)
def residual_to_heading(_: Context) -> Outcome:
    """First order, level flight."""
    peak = math.degrees(peak_heading_error(7.0, 7.0, 235.0))

    def draw(figure: Any) -> None:
        """Heading error over heading for each residual."""
        made = axes(figure, x="heading [deg]", y="heading error [deg]", title="from a constant field residual")
        heading = np.radians(np.arange(361.0))
        for residual in (4.0, 7.0):
            error = np.degrees(level_heading_error(heading, residual, residual, 235.0))
            made.plot(np.degrees(heading), error, label=f"{residual:g} mG on both axes")
        legend(made)

    return by_definition(f"{peak:.2f} deg", abs(peak / 2.5 - 1.0) < 0.10, "equation 3.48 with the printed residual", draw)


@result(
    "GR22",
    "White heading noise averaged from 20 Hz to 1 Hz",
    source="Section 3.12",
    thesis="3.5 deg at 20 Hz become 0.8 deg at 1 Hz",
    tolerance="5 %",
)
def averaged_heading(context: Context) -> Outcome:
    """Formula, and the scatter of simulated averages."""
    formula = averaged_sigma(3.5, 20)
    simulated = float((3.5 * context.rng("average").standard_normal((20_000, 20))).mean(axis=1).std())
    good = abs(formula / 0.8 - 1.0) < 0.05 and abs(simulated / 0.8 - 1.0) < 0.05
    return by_definition(f"{formula:.3f} deg by formula, {simulated:.3f} deg simulated", good, "3.5 deg over the root of 20")
