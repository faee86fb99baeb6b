"""Satellites alone, velocity and acceleration model, low and high dynamics, in the INS/GPS thesis (SR22 to SR27).

The thesis prints no tuning.  A position noise of (6, 6, 90) m^2/s gives its accuracies and was chosen for that; one
driving noise cannot give both its velocities (Figure 7.10) and its lag in high dynamics (Table 7.2), so either has its own, as named below.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from lowcostnav_ros.reproduce.registry import FITTED, Change, Context, Outcome, Reading, fitted, fitted_by, judged, read, result
from lowcostnav_ros.reproduce.solimeno.flights import SETTLED_S, Case, Flight, fly

LAGGING = {"pv": 8e-4, "pva": 1e-4}
"""Driving density of the velocity (m^2/s^3) or acceleration (m^2/s^5) that gives the accuracies of Table 7.2."""
FOLLOWING = 0.03
"""The same of the acceleration for the velocities of Figure 7.10, m^2/s^5."""
QV_TRIED = (0.01, 0.03, 0.1, 0.3)
"""Driving densities of the velocity tried for Figure 7.10, m^2/s^3."""
FITTED_BY = "a position noise of (6, 6, 90) m^2/s and a driving noise that the thesis does not print"
VELOCITY = slice(3, 6)
NED = ("north", "east", "down")
SEEDS = 10
OTHERS = 5
"""Seeds of flights that stand beside a result and are not judged."""


def runs(context: Context, case: Case, full: int = SEEDS) -> list[Flight]:
    """Flights of a case over seeds, flown once in a run."""
    count = 1 if context.quick else full

    def compute() -> list[Flight]:
        seeds = context.seeds("solimeno.flights", count)
        return context.run(fly, [replace(case, seed=seed % 2**31) for seed in seeds])

    return context.once(f"solimeno.{case}.{count}", compute)


def mean_rms(flights: Sequence[Flight], columns: slice = slice(0, 3)) -> np.ndarray:
    """RMS north, east, vertical over all flights, in the unit of the columns."""
    return np.sqrt(np.mean([f.rms(columns) ** 2 for f in flights], axis=0))


def each_3d(flights: Sequence[Flight], columns: slice = slice(0, 3)) -> np.ndarray:
    """3D RMS of each flight, (n,), in the unit of the columns."""
    return np.array([f.rms_3d(columns) for f in flights])


def mean_error(flights: Sequence[Flight]) -> np.ndarray:
    """Mean error north, east, up, estimated minus true, m."""
    return -np.mean([f.settled(slice(0, 3)).mean(axis=0) for f in flights], axis=0) * (1.0, 1.0, -1.0)


def norm(values: np.ndarray) -> float:
    """Root of the sum of squares."""
    return float(np.linalg.norm(values))


def root_mean_square(values: np.ndarray) -> float:
    """Of all values given."""
    return float(np.sqrt(np.mean(np.square(values))))


def largest(flights: Sequence[Flight], first: int) -> tuple[float, float]:
    """Largest horizontal and vertical error of three columns from ``first``, mean over flights."""
    settled = [f.settled(slice(first, first + 3)) for f in flights]
    horizontal = np.mean([np.hypot(e[:, 0], e[:, 1]).max() for e in settled])
    return float(horizontal), float(np.mean([np.abs(e[:, 2]).max() for e in settled]))


def table_row(flights: Sequence[Flight]) -> str:
    """Mean and RMS as Table 7.2 prints them, and the spread of the 3D error over seeds."""
    shown = ", ".join(f"{v:.2f}" for v in mean_error(flights))
    return f"mean {shown}; RMS {rms_row(flights)}"


def rms_row(flights: Sequence[Flight]) -> str:
    """RMS by direction, 2D and 3D, and the spread of the 3D error over seeds."""
    rms, each = mean_rms(flights), each_3d(flights)
    row = f"N {rms[0]:.2f}, E {rms[1]:.2f}, U {rms[2]:.2f}, 2D {norm(rms[:2]):.2f}, 3D {norm(rms):.2f} m"
    return f"{row} ({each.min():.2f} to {each.max():.2f} over {len(each)} seeds)"


def lagging(context: Context, model: str, dataset: str) -> list[Flight]:
    """Flights with the tuning of Table 7.2."""
    return runs(context, Case(model, dataset, tuning="thesis", driving_psd=LAGGING[model]))


@result(
    "SR22",
    "Largest position errors, PV filter, low dynamics",
    source="Figure 7.9",
    thesis="horizontal 4.67 m, vertical 10.53 m",
    tolerance="40 %",
)
def largest_position(context: Context) -> Outcome:
    """Mean over seeds of the largest error once settled."""
    flights = lagging(context, "pv", "LD")
    horizontal, vertical = largest(flights, 0)
    within = abs(horizontal / 4.67 - 1.0) < 0.4 and abs(vertical / 10.53 - 1.0) < 0.4
    text = f"horizontal {horizontal:.2f} m, vertical {vertical:.2f} m (mean of {len(flights)} seeds)"
    untuned = context.besides(lambda: "horizontal {:.2f} m, vertical {:.2f} m".format(*largest(runs(context, Case("pv", "LD"), OTHERS), 0)))
    return fitted(text, within, FITTED_BY, untuned, figure=partial(draw_errors, flight=flights[0], first=0))


@result(
    "SR23",
    "Largest velocity errors, low dynamics",
    source="Figure 7.10",
    thesis="PV: horizontal 0.238 m/s, vertical 0.332 m/s",
    tolerance="40 %, with the PV filter",
    changed=Change("2026-11-22", "reproduced", "40 % with either model were allowed (stricter)"),
)
def largest_velocity(context: Context) -> Outcome:
    """PV on the gentle flight, the driving density chosen for the smallest horizontal error; the PVA filter beside it."""
    tried = {q: largest(velocity_runs(context, "pv", "LD-gentle", q), 3) for q in QV_TRIED}
    best = min(QV_TRIED, key=lambda q: tried[q][0])
    horizontal, vertical = tried[best]
    pva = {name: largest(velocity_runs(context, "pva", name, FOLLOWING), 3) for name in ("LD-gentle", "LD")}
    text = f"PV LD-gentle {horizontal:.2f}, {vertical:.2f} m/s with q_v = {best:g} m^2/s^3; "
    text += "; ".join(f"PVA {name} {h:.2f}, {v:.2f} m/s" for name, (h, v) in pva.items()) + f" (mean of {context.flown} seeds)"
    why = "a velocity random walk lags on a flight that accelerates by 0.6 m/s^2 and passes more noise the faster it is made (horizontal "
    why += ", ".join(f"{h:.2f} m/s with q_v = {q:g}" for q, (h, _) in tried.items()) + "); the thesis's own flight is not printed, and "
    why += "with acceleration states we are within its numbers"
    draw = partial(draw_errors, flight=velocity_runs(context, "pv", "LD-gentle", best)[0], first=3)
    return judged(text, abs(horizontal / 0.238 - 1.0) < 0.4 and abs(vertical / 0.332 - 1.0) < 0.4, why, draw)


def velocity_runs(context: Context, model: str, dataset: str, psd: float) -> list[Flight]:
    """Flights with a driving density meant for velocity."""
    return runs(context, Case(model, dataset, tuning="thesis", driving_psd=psd))


@result(
    "SR24",
    "Position accuracy of the PV filter, low dynamics",
    source="Table 7.2",
    thesis="mean -0.00, -0.01, -0.08; RMS N 1.06, E 1.16, U 2.49, 2D 1.57, 3D 2.94 m",
    tolerance="3D 25 %, vertical above horizontal",
)
def pv_low(context: Context) -> Outcome:
    """q_v = 8e-4 m^2/s^3."""
    flights = lagging(context, "pv", "LD")
    rms = mean_rms(flights)
    within = abs(norm(rms) / 2.94 - 1.0) < 0.25 and bool(rms[2] > norm(rms[:2]))
    return fitted(
        table_row(flights), within, FITTED_BY, consistent(context, "pv", "LD"), figure=partial(draw_errors, flight=flights[0], first=0)
    )


@result(
    "SR25",
    "Position accuracy of the PV filter, high dynamics",
    source="Table 7.2",
    thesis="mean 0.05, 0.03, -0.14; RMS N 3.99, E 3.29, U 5.61, 2D 5.17, 3D 7.63 m",
    tolerance="3D 40 %, at least twice that of low dynamics, mean errors below 1 m",
    changed=Change("2026-11-27", "reproduced", "the mean errors are judged, too"),
)
def pv_high(context: Context) -> Outcome:
    """q_v = 8e-4 m^2/s^3: the velocity lags by metres per second, and what of it shows in the position depends on the satellites."""
    low, readings = norm(mean_rms(lagging(context, "pv", "LD"))), []
    at_three = lagging(context, "pv", "HD")
    for name, flights in (("constellation three hours old", at_three), ("another hour each flight, from 4 h on", by_hour(context))):
        up, alone = [mean_error([flight])[2] for flight in flights], sum(_lags_alike([flight], low) for flight in flights)
        text = f"{table_row(flights)}, mean up {min(up):.2f} to {max(up):.2f} m, {alone} of {len(flights)} flights within alone"
        readings.append(Reading(name, text, _lags_alike(flights, low)))
    why = "what a filter that lags is off by, and in the mean when a satellite sets, as at three hours, is up to its satellites; of an "
    why += f"hour it may be either, and the thesis prints none; {fitted_by(FITTED_BY, consistent(context, 'pv', 'HD'))}"
    return read(readings, why, partial(draw_errors, flight=at_three[0], first=0), FITTED)


def _lags_alike(flights: Sequence[Flight], low_m: float) -> bool:
    """Whether flights in high dynamics are as far off as the thesis's; ``low_m`` is the 3D error in low dynamics."""
    total = norm(mean_rms(flights))
    return abs(total / 7.63 - 1.0) < 0.4 and total > 2.0 * low_m and float(np.abs(mean_error(flights)).max()) < 1.0


def by_hour(context: Context) -> list[Flight]:
    """The flights of Table 7.2 in high dynamics, each an hour later than the one before."""
    case = Case("pv", "HD", tuning="thesis", driving_psd=LAGGING["pv"])
    seeds = context.seeds("solimeno.flights", 1 if context.quick else SEEDS)
    return context.run(fly, [replace(case, seed=s % 2**31, constellation_time_s=3600.0 * (4 + k)) for k, s in enumerate(seeds)])


@result(
    "SR26",
    "Position accuracy of the PVA filter, low dynamics",
    source="Table 7.2",
    thesis="mean -0.00, 0.01, -0.05; RMS N 1.05, E 1.14, U 2.43, 2D 1.55, 3D 2.88 m",
    tolerance="within 5 % of PV in low dynamics",
    changed=Change("2026-11-27", "differs", "the gentle flight beside the other, for the thesis's has 'no significant accelerations'"),
)
def pva_low(context: Context) -> Outcome:
    """q_a = 1e-4 m^2/s^5; both filters receive the same satellites, so the ratio hardly depends on the seed."""
    readings = []
    for dataset, what in (("LD", "turns at up to 4 m/s^2"), ("LD-gentle", "'no significant accelerations' (section 7.1): 0.6 m/s^2")):
        flights, pv = lagging(context, "pva", dataset), lagging(context, "pv", dataset)
        each = 100.0 * (each_3d(flights) / each_3d(pv) - 1.0)
        ratio = 100.0 * (norm(mean_rms(flights)) / norm(mean_rms(pv)) - 1.0)
        text = f"{table_row(flights)}; {ratio:+.2f} % against PV ({each.min():+.1f} to {each.max():+.1f} % over seeds)"
        readings.append(Reading(f"{dataset}, {what}", text, abs(ratio) <= 5.0))
    why = "where a flight accelerates the velocity of the PV filter lags and the PVA filter's does not; "
    why += fitted_by(FITTED_BY, consistent(context, "pva", "LD"))
    return read(readings, why, partial(draw_errors, flight=lagging(context, "pva", "LD")[0], first=0), FITTED)


@result(
    "SR27",
    "Position accuracy of the PVA filter, high dynamics",
    source="Table 7.2",
    thesis="mean 0.02, 0.02, -0.08; RMS N 1.55, E 1.31, U 2.71, 2D 2.03, 3D 3.39 m",
    tolerance="3D 40 %, at most 0.6 of PV",
)
def pva_high(context: Context) -> Outcome:
    """q_a = 1e-4 m^2/s^5."""
    flights = lagging(context, "pva", "HD")
    total, pv = norm(mean_rms(flights)), norm(mean_rms(lagging(context, "pv", "HD")))
    within = abs(total / 3.39 - 1.0) < 0.4 and total < 0.6 * pv
    return fitted(
        table_row(flights), within, FITTED_BY, consistent(context, "pva", "HD"), figure=partial(draw_errors, flight=flights[0], first=0)
    )


def consistent(context: Context, model: str, dataset: str) -> str:
    """Errors and NEES of the filter as it is tuned for use: process noise for the dynamics, none for the position."""

    def compute() -> str:
        flights = runs(context, Case(model, dataset), OTHERS)
        text = f"{norm(mean_rms(flights)):.2f} m, {norm(mean_rms(flights, VELOCITY)):.2f} m/s, "
        scores = np.mean([f.nees[f.t_s > SETTLED_S, :2].mean(axis=0) for f in flights], axis=0)
        return f"{text}NEES position {scores[0]:.1f}, velocity {scores[1]:.1f} of 3"

    return context.besides(compute)


def draw_errors(figure: Any, flight: Flight, first: int) -> None:
    """Errors of three columns over time, position, velocity or attitude, with their three sigmas."""
    unit, names = {0: ("m", NED), 3: ("m/s", NED), 6: ("deg", ("roll", "pitch", "heading"))}[first]
    size = np.degrees(1.0) if first == 6 else 1.0
    for k, (axes, name) in enumerate(zip(figure.subplots(3, 1, sharex=True), names, strict=True)):
        axes.plot(flight.t_s, size * flight.error[:, first + k], lw=0.6)
        for sign in (-3.0, 3.0):
            axes.plot(flight.t_s, sign * size * flight.sigma[:, first + k], color="grey", lw=0.6)
        after = flight.t_s > SETTLED_S
        top = size * max(3.0 * flight.sigma[after, first + k].max(), np.abs(flight.error[after, first + k]).max())
        axes.set(ylim=(-1.2 * top, 1.2 * top))
        axes.set(ylabel=f"{name} [{unit}]")
        axes.grid(alpha=0.3)
    axes.set(xlabel="time [s]")
    figure.suptitle("Errors, true minus estimated, and three sigmas")
