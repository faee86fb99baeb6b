"""The ten-state error estimator: constants of its models and functional tests (Eggers 1995, chapter 7, section 8.3)."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lowcostnav_ros.reproduce.eggers.realisations import INFERRED_GPS
from lowcostnav_ros.reproduce.figures import axes
from lowcostnav_ros.reproduce.registry import Context, Outcome, by_definition, judged, result
from lowcostnav_ros.studies.air_corrections import (
    DECAY,
    GRAVITY_KT_S,
    REFERENCE_KT,
    TILT_RAD,
    Truth,
    estimate,
    final_tuning,
    with_gps,
)
from lowcostnav_ros.trajectory.load_factor import fly_in_envelope

BALLOON = (
    (22.4, 135),
    (22.4, 137),
    (21.6, 136),
    (19.4, 145),
    (17.7, 153),
    (15.0, 166),
    (11.3, 183),
    (8.9, 201),
    (7.6, 218),
    (6.2, 236),
    (7.0, 245),
    (8.0, 240),
)


def balloon_steps() -> np.ndarray:
    """Changes (11, 2) of the north and east wind, kt, from one level of the balloon to the next."""
    speed, direction = np.array(BALLOON).T
    winds = np.column_stack((speed * np.cos(np.radians(direction)), speed * np.sin(np.radians(direction))))
    return np.diff(winds, axis=0)


@result(
    "ER11",
    "Constants of the models",
    source="chapter 7, section 8.3.2",
    thesis="2.031e-8; 0.9934 (0.99336); 0.9165; 0.9789; 22.1; 7.7; 11.6 s",
    tolerance="the printed digits; 0.9789 is a misprint of 0.9798",
)
def constants(_: Context) -> Outcome:
    """Arithmetic on the printed parameters."""
    quarter_s = 0.97 / 300.0 * 3600.0
    per_s = 16.0**2 / 11.6
    gains = [math.sqrt(1.0 - step**2 / 25.0) for step in (2.0, 1.0)]
    ours = (TILT_RAD**2 / 150.0, DECAY, *gains, per_s, per_s * (3600.0 / 6080.0) ** 2, quarter_s)
    text = ", ".join(f"{value:.4g}" for value in ours)
    good = all(abs(a / b - 1.0) < 1.5e-2 for a, b in zip(ours, (2.031e-8, 0.9934, 0.9165, 0.9798, 22.1, 7.7, 11.6), strict=True))
    return by_definition(text, good and abs(ours[3] - 0.9798) < 5e-5, "arithmetic on printed parameters; the second Markov gain is 0.9798")


@result(
    "ER12",
    "Winds of a balloon ascent",
    source="section 7.2.2, Table 3",
    thesis="steps: mean 1.08, -2.07, std 1.50, 1.61, mean square 3.41, 6.89 kt^2",
    tolerance="0.01 of every entry",
)
def balloon(_: Context) -> Outcome:
    """Mean, standard deviation and mean square of the steps."""
    steps = balloon_steps()
    mean, std = steps.mean(axis=0), steps.std(axis=0, ddof=1)
    square = mean**2 + std**2
    ours = np.concatenate((mean, std, square))
    good = bool((np.abs(ours - [1.08, -2.07, 1.50, 1.61, 3.41, 6.89]) < 0.01 + 0.005).all())
    text = ", ".join(f"{value:.2f}" for value in ours)
    return by_definition(text, good, "arithmetic on the printed winds; a chosen volatility of 4 kt^2 lies between")


GROUPS = {"misalignment": (0, 1, 2), "pitch and bank": (3, 4), "airspeed": (5, 6), "wind": (7, 8, 9)}
INJECTED = np.array([3e-3, -2e-3, 2.5e-3, 6e-4, 5e-4, 1.05, 4.7, 10.0, -10.0, 2.0])


def isolated(group: Sequence[int], sigma: float, seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the active states (n, k), and what was injected (k,)."""
    rest, rows = np.array([0.0] * 5 + [1.0] + [0.0] * 4), list(group)
    truth_row = rest.copy()
    truth_row[rows] = INJECTED[rows]
    truth = Truth.of(fly_in_envelope(n, gravity=GRAVITY_KT_S, speed=REFERENCE_KT), np.tile(truth_row, (n, 1)))
    active = np.zeros(10)
    active[rows] = 1.0
    P0 = np.array([1e-4] * 5 + [1e-2] + [100.0] * 4) * active
    tuning = replace(final_tuning(max(sigma, 0.05) ** 2), Q=np.zeros(10), P0=P0, decay=np.ones(10), active=active)
    run = estimate(truth, with_gps(truth, sigma, np.random.default_rng(seed)), tuning)
    return (run.estimates - truth_row)[:, rows], (truth_row - rest)[rows]


@result(
    "ER14",
    "Isolated states",
    source="section 8.2",
    thesis="two or three active states converge rapidly and precisely",
    tolerance="noise-free: within 1 per cent of what was injected after 20 s, every group",
)
def functional(_: Context) -> Outcome:
    """Each group alone, noise-free; and with GPS noise of 0.25 kt after 300 s."""
    clean = {name: isolated(group, 0.0, 1, 300) for name, group in GROUPS.items()}
    worst = max(float(np.abs(error[20:] / injected).max()) for error, injected in clean.values())
    noisy = {name: isolated(group, INFERRED_GPS, 2, 300)[0][-1] for name, group in GROUPS.items()}

    def draw(figure: Any) -> None:
        """Errors of the estimates over those injected, in time."""
        for k, (name, (error, injected)) in enumerate(clean.items()):
            made = axes(figure, (1, 4, k + 1), x="time [s]", y="error over injected" if k == 0 else "", title=name)
            made.plot(error[:40] / injected)

    parts = "; ".join(f"{name} {np.array2string(np.abs(error), precision=5)}" for name, error in noisy.items())
    return judged(f"largest after 20 s {100.0 * worst:.2g} per cent; with noise, 300 s: {parts}", worst < 0.01, figure=draw)
