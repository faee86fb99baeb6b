"""Charts of the calibration jobs, and the page that they, the numbers and what was found make."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.units import MILLI_G
from lowcostnav_ros.calibration.allan import AllanChart
from lowcostnav_ros.calibration.allan_fit import AllanFit
from lowcostnav_ros.calibration.allan_models import FLICKER_FLOOR
from lowcostnav_ros.calibration.identification import autocorrelation
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerFit
from lowcostnav_ros.calibration.magnetometer_swing import HeadingSwing
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.report.chart import HALF, Axis, Curve, Dots, Item, TimeAxis, time_chart
from lowcostnav_ros.report.plan_folder import page_of

MOST_POINTS = 4000
_ROOT = "\N{SQUARE ROOT}h"
_GYRO = {0: (60.0, f"deg/{_ROOT}"), 1: (3600.0, "deg/h"), 2: (3600.0 * 60.0, f"deg/h/{_ROOT}")}
_ACCELEROMETER = {0: (60.0, f"m/s/{_ROOT}"), 1: (1.0 / MILLI_G, "mg")}
_DATA_SHEET = {"deg/s": _GYRO, "rad/s": {k: (np.degrees(1.0) * f, unit) for k, (f, unit) in _GYRO.items()}, "m/s^2": _ACCELEROMETER}
"""By unit of the column: factors and units of N, B and K."""
COLOURS = ("#1f77b4", "#d95f02", "#2a9d5c", "#7a5195", "#8c6d31", "#56b4e9")
BEFORE, AFTER, INK = "#8a8f94", "#1f77b4", "var(--ink)"


def write_page(path: Path, title: str, heads: Sequence[str], rows: Sequence[tuple], said: Sequence[str], drawn: Sequence[str]) -> None:
    """Write the page of a calibration; the first cell of a row is its name, the others are numbers."""
    cells = [(name, *(f"{value:.4g}" for value in values)) for name, *values in rows]
    write_text(path, page_of((title, (Table.plain("", heads, cells),), tuple(said)), drawn))


def by_unit(units: Mapping[str, str], draw: Callable[[list[str], str], list[str]]) -> list[str]:
    """What ``draw(names, unit)`` makes of the columns of each unit."""
    each = {unit: [name for name in units if units[name] == unit] for unit in units.values()}
    return [one for unit, names in each.items() for one in draw(names, unit or "unit of the column")]


def allan_charts(results: Mapping[str, tuple[AllanChart, AllanFit]], unit: str) -> list[str]:
    """Allan deviations of several columns of one unit with their intervals and the fitted filter model; each one's asymptotes."""
    low, high = (f([np.log10(f(chart.tau_s)) for chart, _ in results.values()]) for f in (min, max))
    axis = Axis(float(low), float(high), name="s", is_log=True)
    items = list[Item]()
    for (name, (chart, fit)), colour in zip(results.items(), COLOURS, strict=False):
        items += [Curve(chart.tau_s, edge, colour, "", 0.5) for edge in (chart.low, chart.high)]
        items += [Dots(chart.tau_s, chart.deviation, colour, name, 4.0)]
        items += [Curve(chart.tau_s, np.sqrt(fit.variance(chart.tau_s)), colour, f"{name}, model", 1.2, "6 4")]
    title = f"Allan deviation [{unit}] against averaging time; thin: 68 % interval, dashed: white noise and Gauss-Markov drift"
    drawn = [time_chart(title, axis, items, height=330, is_log=True)]
    return drawn + [_slopes(name, chart, fit, axis, unit) for name, (chart, fit) in results.items()]


def data_sheet(name: str, fit: AllanFit, unit: str) -> str:
    """The coefficients of a column in a sentence, in the units of data sheets where they have some."""
    found = (("white noise N", fit.white_density), ("bias instability B", fit.bias_instability), ("random walk K", fit.random_walk))
    said = (_said(words, value, unit, k) for k, (words, value) in enumerate(found) if np.isfinite(value) and value > 0.0)
    return f"{name}: {', '.join(said)}."


def _slopes(name: str, chart: AllanChart, fit: AllanFit, axis: Axis, unit: str) -> str:
    """One column with the lines that its coefficients are read from."""
    tau = chart.tau_s
    lines: list[Item] = [Dots(tau, chart.deviation, COLOURS[0], "measured", 3.5)]
    levels = (
        ("N, white", fit.white_density, "#2a9d5c", 1.0 / np.sqrt(tau)),
        ("B, instability", fit.bias_instability, "#d95f02", np.full(len(tau), FLICKER_FLOOR)),
        ("K, random walk", fit.random_walk, "#c0392b", np.sqrt(tau / 3.0)),
    )
    for k, (words, value, colour, slope) in enumerate(levels):
        if np.isfinite(value) and value > 0.0:
            lines.append(Curve(tau, value * slope, colour, _said(words, value, unit, k), 1.1, "6 4"))
    low, high = (float(np.log10(f(chart.deviation))) for f in (np.min, np.max))
    return time_chart(f"{name} [{unit}]", axis, lines, height=200, limits=(low - 0.3, high + 0.3), is_log=True)


def _said(words: str, value: float, unit: str, kind: int) -> str:
    """A coefficient in the units of data sheets, where they have some."""
    factor, shown = _DATA_SHEET.get(unit, {}).get(kind, (1.0, ""))
    return f"{words} {value * factor:.3g} {shown}".rstrip()


def identification_charts(columns: Mapping[str, np.ndarray], rate_hz: float, unit: str) -> list[str]:
    """Averages of the parts of the record and autocorrelation of one-second averages."""
    parts, lags = list[Item](), list[Item]()
    shortest = min(len(values) for values in columns.values()) / rate_hz
    part_s = 60.0 if shortest > 600.0 else max(1.0, shortest / 10.0)
    for (name, values), colour in zip(columns.items(), COLOURS, strict=False):
        averages, seconds = _averages(values, part_s * rate_hz), _averages(values, rate_hz)
        parts.append(Curve((np.arange(len(averages)) + 0.5) * part_s, averages, colour, name))
        covariance = autocorrelation(seconds, len(seconds) // 2)
        lags.append(Curve(np.arange(1.0, len(covariance)), covariance[1:] / covariance[0], colour, name))
    title = f"Averages of {part_s:g} s [{unit}]"
    across = Axis(0.0, max(shortest / 2.0, 1.0), name="s")
    return [
        time_chart(title, TimeAxis(0.0, shortest), parts, height=200),
        time_chart("Normalised autocorrelation of 1-second averages against the lag", across, lags, height=200),
    ]


def strength_charts(measured: np.ndarray, fit: MagnetometerFit, unit: str) -> list[str]:
    """Strength of the field before and after against where in the sensor it points: on a sphere it is the same all round."""
    few = measured[:: max(1, len(measured) // MOST_POINTS)]
    after = fit.apply(few)
    round_deg, up_deg = np.degrees(np.arctan2(after[:, 1], after[:, 0])), np.degrees(np.arctan2(-after[:, 2], np.hypot(*after[:, :2].T)))
    drawn = []
    for title, angle, end in (("around z, from x to y", round_deg, 180.0), ("above the plane of x and y", up_deg, 90.0)):
        expected = Curve(np.array([-end, end]), np.full(2, fit.strength), INK, "earth's field", 1.2)
        clouds = ((few, BEFORE, "before"), (after, AFTER, "after"))
        points = [Dots(angle, np.linalg.norm(cloud, axis=1), colour, label, 2.6) for cloud, colour, label in clouds]
        axis = Axis(-end, end, name="deg")
        drawn.append(time_chart(f"Strength [{unit}] by direction {title}", axis, [*points, expected], height=230, width=HALF))
    return drawn


def swing_charts(heading: np.ndarray, measured: np.ndarray, curve: HeadingSwing) -> list[str]:
    """Deviations against magnetic heading, rad, with the fitted curve and what it leaves."""
    around = np.radians(np.linspace(0.0, 360.0, 361))
    known, deviation = np.degrees(np.mod(heading, 2.0 * np.pi)), np.degrees(wrap(measured - heading))
    items: list[Item] = [
        Curve(np.degrees(around), np.degrees(curve.error(around)), COLOURS[0], "curve"),
        Dots(known, deviation, COLOURS[1], "measured minus known", 6.0),
        Dots(known, deviation - np.degrees(curve.error(heading)), INK, "left by the curve", 5.0),
    ]
    return [time_chart("Deviation [deg] against magnetic heading", Axis(0.0, 360.0, name="deg"), items, height=260)]


def _averages(values: np.ndarray, count: float) -> np.ndarray:
    size = max(1, round(count))
    whole = len(values) // size
    return values[: whole * size].reshape(whole, size).mean(axis=1)
