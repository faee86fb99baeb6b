"""Figures of the MEMS thesis, as a reader of it expects them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.njenga.flights import Flown, path

NED = ("north", "east", "down")


def scatter(figure: Any, ned: np.ndarray) -> None:
    """Fixes at rest (Figure 24)."""
    made = axes(figure, x="east [ft]", y="north [ft]", title="fixes of one hour at rest")
    made.plot(ned[:, 1], ned[:, 0], ".", markersize=2)
    made.set_aspect("equal", adjustable="datalim")


def lines(figure: Any, series: Mapping[str, tuple[np.ndarray, np.ndarray]], x: str, y: str, *, log: bool = False) -> None:
    """Several curves over one axis."""
    made = axes(figure, x=x, y=y, log=log)
    for name, (abscissa, values) in series.items():
        made.plot(abscissa, values, linewidth=0.9, label=name)
    legend(made)


def panels(figure: Any, x: np.ndarray, columns: Mapping[str, np.ndarray], y: str, labels: tuple[str, ...] = NED) -> None:
    """One panel an axis, a curve for each entry of (n, 3)."""
    figure.set_size_inches(9.0, 6.0)
    for k, label in enumerate(labels):
        made = axes(figure, (3, 1, k + 1), x="time [s]" if k == 2 else "", y=f"{label} {y}")
        for name, values in columns.items():
            made.plot(x, values[:, k], linewidth=0.9, label=name)
    legend(figure.axes[0])


def errors(figure: Any, flown: Mapping[str, Flown]) -> None:
    """Errors of the integrated solution with its sigmas and of the fixes, a column a flight."""
    figure.set_size_inches(max(6.5, 4.6 * len(flown)), 5.6)
    for k, (name, f) in enumerate(flown.items()):
        for j, label in enumerate(NED):
            y = f"{label} [ft]" if k == 0 else ""
            made = axes(figure, (3, len(flown), j * len(flown) + k + 1), x="time [s]" * (j == 2), y=y, title=name * (j == 0))
            made.fill_between(f.t_s, -f.sigma[:, j], f.sigma[:, j], color="tab:red", alpha=0.2, linewidth=0.0)
            made.plot(f.fix_s, f.fix_error[:, j], ".", color="0.5", markersize=1.5)
            made.plot(f.t_s, f.error[:, j], linewidth=0.8)


def _true(f: Flown) -> np.ndarray:
    flight = path()
    return np.column_stack([np.interp(f.t_s, flight.t_s, column) for column in flight.position.T])


def course(figure: Any, f: Flown) -> None:
    """Course over ground: inertial, GPS and integrated, all of it and the inertial one within 30 000 ft (Figures 31, 32)."""
    true = _true(f)
    at = [np.interp(f.fix_s, path().t_s, column) for column in path().position.T]
    made = axes(figure, x="east [1000 ft]", y="north [1000 ft]")
    for values, style, label in ((f.ins + true, "-", "inertial"), (f.error + true, "--", "integrated")):
        made.plot(values[:, 1] / 1e3, values[:, 0] / 1e3, style, linewidth=1.2, label=label)
    made.plot((f.fix_error[:, 1] + at[1]) / 1e3, (f.fix_error[:, 0] + at[0]) / 1e3, ":", color="k", linewidth=1.0, label="GPS")
    legend(made)


def altitude(figure: Any, f: Flown, mark: float | None = None) -> None:
    """Altitude of GPS and of the integrated solution (Figure 34)."""
    made = axes(figure, x="time [s]", y="altitude [ft]")
    fix = np.interp(f.fix_s, path().t_s, path().position[:, 2]) + f.fix_error[:, 2]
    made.plot(f.fix_s, -fix, color="0.5", linewidth=0.8, label="GPS")
    made.plot(f.t_s, -(f.error + _true(f))[:, 2], linewidth=1.1, label="integrated")
    made.axhline(869.0, color="k", linestyle=":", linewidth=0.8, label="runway")
    if mark is not None:
        made.axvline(mark, color="tab:red", linewidth=0.8, label=f"descent from {mark:.1f} s")
    legend(made)


def bars(figure: Any, table: Mapping[str, np.ndarray]) -> None:
    """RMS north, east and down of each configuration, on a logarithmic axis."""
    figure.set_size_inches(9.0, 0.34 * len(table) + 1.2)
    made = axes(figure, x="RMS [ft]", y="")
    made.set_xscale("log")
    rows = np.arange(len(table))
    for k, label in enumerate(NED):
        made.barh(rows + 0.27 * (k - 1), [values[k] for values in table.values()], 0.26, label=label)
    made.set_yticks(rows, list(table), fontsize=7)
    made.invert_yaxis()
    legend(made)
