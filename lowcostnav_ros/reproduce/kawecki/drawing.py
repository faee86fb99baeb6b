"""Figures of the pseudolite thesis, as a reader of it expects them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lowcostnav_ros.reproduce.figures import SMALL, axes, legend
from lowcostnav_ros.reproduce.kawecki.flights import CENTRE_S, Flown

AXES = ("north", "east", "down")


def errors(figure: Any, flown: Mapping[str, Flown]) -> None:
    """Error in north, east and down, estimated less true, with the filter's sigmas; a column for each flight (Figures 4.1, 4.12 ...)."""
    figure.set_size_inches(max(6.5, 4.6 * len(flown)), 5.2)
    for k, (name, f) in enumerate(flown.items()):
        for j, label in enumerate(AXES):
            made = axes(
                figure, (3, len(flown), j * len(flown) + k + 1), x="time [s]" if j == 2 else "", y=f"{label} [m]", title=name * (j == 0)
            )
            made.fill_between(f.flight.t_s, -f.flight.sigma[:, j], f.flight.sigma[:, j], color="tab:red", alpha=0.25, linewidth=0.0)
            made.plot(f.flight.t_s, -f.flight.error[:, j], linewidth=0.7)
            made.axvspan(*CENTRE_S, color="k", alpha=0.05)


def availability(figure: Any, flown: Mapping[str, Flown]) -> None:
    """When each transmitter was received, with its slips (Figures 4.3, 4.4)."""
    figure.set_size_inches(9.0, 2.9 * len(flown))
    for k, (name, f) in enumerate(flown.items()):
        made = axes(figure, (len(flown), 1, k + 1), x="time [s]", y="transmitter", title=f"{name}: {int(f.slipped.sum())} slips")
        heard = ~np.isnan(f.code_m)
        for j in range(len(f.idents)):
            made.plot(f.t_s[heard[:, j]], np.full(int(heard[:, j].sum()), j), ",", color="0.6")
            made.plot(f.t_s[f.slipped[:, j]], np.full(int(f.slipped[:, j].sum()), j), "|", color="tab:red", markersize=5)
            made.plot(f.t_s[f.timed[:, j]], np.full(int(f.timed[:, j].sum()), j), "|", color="tab:blue", markersize=5)
        made.set_yticks(range(len(f.idents)), f.idents, fontsize=SMALL - 2)


def bank(figure: Any, t_s: np.ndarray, roll: np.ndarray, slipped: np.ndarray) -> None:
    """Bank, rad, with the epochs of slips, all (k,) (Figures 4.5, 4.9)."""
    made = axes(figure, x="time [s]", y="roll [deg]", title="bank, and epochs in which a carrier slipped")
    made.plot(t_s, np.degrees(roll))
    made.plot(t_s[slipped], np.degrees(roll[slipped]), "r.", markersize=2.5, label="slip")
    for level in (-18.0, 18.0):
        made.axhline(level, color="0.5", linestyle="--", linewidth=0.8)
    legend(made)


def ambiguity(figure: Any, f: Flown, column: int = 0) -> None:
    """Change of one ambiguity from its first value, slips marked (Figure 4.6)."""
    values = f.ambiguity[:, column]
    change = values - values[np.flatnonzero(np.isfinite(values))[0]]
    made = axes(figure, x="time [s]", y="change [cycles]", title=f"ambiguity of transmitter {f.idents[column]}")
    made.plot(f.t_s, change, linewidth=0.8)
    for mask, colour, label in ((f.slipped, "tab:red", "threshold slip"), (f.timed, "tab:blue", "time slip")):
        made.plot(f.t_s[mask[:, column]], change[mask[:, column]], "o", color=colour, markersize=3, label=label)
    legend(made)


def residuals(figure: Any, f: Flown, *, code: bool = False) -> None:
    """Residuals of all carriers, and of the codes (Figures 4.13 to 4.24)."""
    figure.set_size_inches(9.0, 5.0 if code else 3.4)
    made = axes(figure, (2 if code else 1, 1, 1), x="time [s]", y="carrier [m]", title="residuals before the update, all transmitters")
    made.plot(f.t_s, f.carrier_m, ",")
    if code:
        lower = axes(figure, (2, 1, 2), x="time [s]", y="code [m]")
        lower.plot(f.t_s, f.code_m, ",")


def bars(figure: Any, columns: Mapping[str, Mapping[str, float]], y: str) -> None:
    """Grouped bars: a group for each column name, a bar for each entry."""
    made = axes(figure, x="", y=y)
    groups = list(columns)
    names = list(next(iter(columns.values())))
    width = 0.8 / len(groups)
    for k, group in enumerate(groups):
        made.bar(np.arange(len(names)) + k * width, [columns[group][n] for n in names], width, label=group)
    made.set_xticks(np.arange(len(names)) + 0.4 - width / 2, names)
    legend(made)
