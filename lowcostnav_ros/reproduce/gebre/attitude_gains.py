"""Gain histories of the Euler-angle and the quaternion filter while the aircraft rolls by 90 degrees each way (GR29, GR30)."""

from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from lowcostnav_ros.estimation import attitude_gains as gains
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.registry import Change, Context, Outcome, judged, result

PERIOD_S = 60.0
CORRECTIONS, ANGLES = ("dp", "dq", "dr"), ("roll", "pitch", "heading")
TUNING = gains.GPS_FLOWN


def _steady(rolls: np.ndarray, form: str) -> np.ndarray:
    """Steady bias gains (n, 3, 3), 1/s, at fixed rolls, rad: rows p, q, r, columns roll, pitch, heading (or the small rotation)."""
    models = (gains.euler_model(roll, 0.0, TUNING) if form == "euler" else gains.quaternion_model(np.zeros(3), TUNING) for roll in rolls)
    return np.array([kalman.steady_state_gain(*model)[0][3:] for model in models])


def _while_rolling(period_s: float) -> np.ndarray:
    """Bias gains (n, 3, 3) of the quaternion form over the last of three rolls, P carried through them at their rate."""
    Phi, Qd, H, R = gains.quaternion_model(np.zeros(3), TUNING)
    linear = KalmanFilter(dim_x=6, dim_z=3)
    _, linear.P = kalman.steady_state_gain(Phi, Qd, H, R)
    omega, each, found = 2.0 * np.pi / period_s, round(period_s / TUNING.period_s), []
    for k in range(3 * each):
        rate = 0.5 * np.pi * omega * np.cos(omega * k * TUNING.period_s)
        Phi, Qd, H, R = gains.quaternion_model(np.array([rate, 0.0, 0.0]), TUNING)
        linear.predict(F=Phi, Q=Qd)
        linear.update(np.zeros((3, 1)), R, H)
        found.append(linear.K[3:].copy())
    return np.array(found[-each:])


def _departure(table: np.ndarray, at_rest: float) -> float:
    """Largest term off the diagonal, or change of one on it, over the gain at rest."""
    diagonal = np.einsum("kii->ki", table)
    off = table - np.einsum("ki,ij->kij", diagonal, np.eye(3))
    return float(max(np.ptp(diagonal), np.abs(off).max())) / at_rest


def _draw(figure: Any, table: np.ndarray, rolls: np.ndarray, names: tuple[str, ...]) -> None:
    t = np.linspace(0.0, PERIOD_S, len(rolls))
    for k, correction in enumerate(CORRECTIONS):
        made = axes(figure, (1, 3, 1 + k), x="time [s]", y="gain [1/s]" if k == 0 else "", title=f"gains on {correction}")
        for j, name in enumerate(names):
            made.plot(t, table[:, k, j], label=name)
        made.set_ylim(-6e-4, 6e-4)
        legend(made)


@result(
    "GR29",
    "Bias gains of the Euler filter over a roll of 90 deg each way",
    source="Figure 4.16",
    thesis="curves; recomputed structure: f' times one gain, so q on heading as sin(roll), q on pitch as cos(roll), r on heading as "
    "cos(roll), r on pitch as -sin(roll), p on roll constant",
    tolerance="2 %",
)
def euler_gains(context: Context) -> Outcome:
    """Steady gain of the six-state filter at every roll, against the closed form that the navigator schedules by."""
    rolls = 0.5 * np.pi * np.sin(np.linspace(0.0, 2.0 * np.pi, 41 if context.quick else 181))
    table = _steady(rolls, "euler")
    on_rate = gains.axis_gains(TUNING, 0.25)[1]
    s, c, o, one = np.sin(rolls), np.cos(rolls), np.zeros_like(rolls), np.ones_like(rolls)
    printed = on_rate * np.array([[one, o, o], [o, c, s], [o, -s, c]]).transpose(2, 0, 1)
    scheduled = np.array([gains.scheduled_euler_gain(roll, 0.0, TUNING)[3:] for roll in rolls])
    worst = 100.0 * float(max(np.abs(table - printed).max(), np.abs(table - scheduled).max())) / on_rate
    ours = f"gain {on_rate:.2e} 1/s per update; largest departure from the structure {worst:.2g} % of it"
    return judged(ours, worst < 2.0, "", lambda figure: _draw(figure, table, rolls, ANGLES))


@result(
    "GR30",
    "Bias gains of the quaternion filter over the same roll",
    source="Figure 4.17",
    thesis="constant: p, q, r each on its own component alone",
    tolerance="1 %, while rolling",
    changed=Change("2026-11-27", "reproduced", "the gain at rest was computed once for every roll, which cannot differ; now P is carried"),
)
def quaternion_gains(context: Context) -> Outcome:
    """Gain of the filter whose P is carried through the roll at its rate, at two rates; beside it the gain at rest."""
    at_rest = float(_steady(np.zeros(1), "quaternion")[0, 0, 0])
    tables = {period_s: _while_rolling(period_s) for period_s in (600.0, PERIOD_S)}
    worst = {period_s: _departure(table, at_rest) for period_s, table in tables.items()}
    ours = f"departs from a constant diagonal by {worst[600.0]:.2f} (600 s a roll) and {worst[PERIOD_S]:.2f} (60 s) of the gain at rest"
    why = "the gain is constant at rest only, where it has the form printed: the thesis must have computed it there at every roll"
    table = tables[PERIOD_S]
    return judged(ours, max(worst.values()) < 0.01, why, lambda f: _draw(f, table, np.zeros(len(table)), ("x", "y", "z")))
