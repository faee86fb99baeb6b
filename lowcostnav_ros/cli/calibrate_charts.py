"""Charts of the calibration jobs; matplotlib is imported when one is drawn."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.calibration.allan import AllanChart
from lowcostnav_ros.calibration.allan_fit import AllanFit
from lowcostnav_ros.calibration.identification import autocorrelation
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerFit
from lowcostnav_ros.calibration.magnetometer_swing import HeadingSwing
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.report.plan_folder import drawing

MOST_POINTS = 4000


def save(path: Path, draw: Callable[[Any], None], inches: tuple[float, float] = (9.0, 4.2)) -> str:
    """Draw on a new figure and write it, without any display; return it as a drawing of a page."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=inches, dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    draw(figure)
    figure.savefig(path)
    return drawing(figure, path.stem)


def allan_figure(results: Mapping[str, tuple["AllanChart", "AllanFit"]], unit: str) -> Callable[[Any], None]:
    """Allan charts of several columns of one unit, with intervals and the fitted filter model."""

    def draw(figure: Any) -> None:
        made = figure.add_subplot()
        for name, (chart, fit) in results.items():
            (line,) = made.loglog(chart.tau_s, chart.deviation, ".", markersize=3, label=name)
            made.fill_between(chart.tau_s, chart.low, chart.high, alpha=0.2, color=line.get_color(), linewidth=0)
            made.loglog(chart.tau_s, np.sqrt(fit.variance(chart.tau_s)), "--", linewidth=0.9, color=line.get_color())
        made.set_xlabel("averaging time [s]")
        made.set_ylabel(f"Allan deviation [{unit or 'unit of the column'}]")
        made.grid(True, which="both", linewidth=0.4, alpha=0.5)
        made.legend(fontsize=8, title="points; dashed: white + Gauss-Markov", title_fontsize=8)

    return draw


def identification_figure(columns: Mapping[str, np.ndarray], rate_hz: float, unit: str) -> Callable[[Any], None]:
    """One-minute averages and autocorrelation of one-second averages."""

    def draw(figure: Any) -> None:
        left, right = figure.subplots(1, 2)
        for name, values in columns.items():
            minutes, seconds = _averages(values, 60.0 * rate_hz), _averages(values, rate_hz)
            left.plot(np.arange(len(minutes)), minutes, linewidth=0.9, label=name)
            covariance = autocorrelation(seconds, len(seconds) // 2)
            right.plot(covariance[1:] / covariance[0], linewidth=0.9)
        left.set(xlabel="time [min]", ylabel=f"1-minute average [{unit or 'unit of the column'}]")
        right.set(xlabel="lag [s]", ylabel="normalised autocorrelation")
        left.legend(fontsize=8)

    return draw


def sphere_figure(measured: np.ndarray, fit: MagnetometerFit, unit: str) -> Callable[[Any], None]:
    """The cloud before and after, three projections each, with the circle of the expected strength."""
    few = measured[:: max(1, len(measured) // MOST_POINTS)]
    after = fit.apply(few)
    around = np.linspace(0.0, 2.0 * np.pi, 200)

    def draw(figure: Any) -> None:
        panels = figure.subplots(1, 3)
        for panel, (a, b) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
            panel.plot(few[:, a], few[:, b], ".", markersize=1.5, label="before")
            panel.plot(after[:, a], after[:, b], ".", markersize=1.5, label="after")
            panel.plot(fit.strength * np.cos(around), fit.strength * np.sin(around), "k", linewidth=0.6)
            panel.set(xlabel=f"{'xyz'[a]} [{unit}]", ylabel=f"{'xyz'[b]} [{unit}]")
            panel.set_aspect("equal")
        panels[0].legend(fontsize=8)

    return draw


def swing_figure(heading: np.ndarray, measured: np.ndarray, curve: HeadingSwing) -> Callable[[Any], None]:
    """Deviations against magnetic heading, rad, with the fitted curve and what it leaves."""
    around = np.radians(np.linspace(0.0, 360.0, 361))
    known, deviation = np.degrees(np.mod(heading, 2.0 * np.pi)), np.degrees(wrap(measured - heading))

    def draw(figure: Any) -> None:
        panel = figure.add_subplot()
        panel.plot(np.degrees(around), np.degrees(curve.error(around)), linewidth=1.2, label="curve")
        panel.plot(known, deviation, "o", markersize=4, label="measured minus known")
        panel.plot(known, deviation - np.degrees(curve.error(heading)), "k.", markersize=4, label="left by the curve")
        panel.axhline(0.0, color="k", linewidth=0.5)
        panel.set(xlabel="magnetic heading [deg]", ylabel="deviation [deg]", xlim=(0.0, 360.0), xticks=range(0, 361, 45))
        panel.grid(True, linewidth=0.4, alpha=0.5)
        panel.legend(fontsize=8)

    return draw


def _averages(values: np.ndarray, count: float) -> np.ndarray:
    size = max(1, round(count))
    whole = len(values) // size
    return values[: whole * size].reshape(whole, size).mean(axis=1)
