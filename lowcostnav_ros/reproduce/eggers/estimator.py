"""The ten-state error estimator: constants, functional tests, robustness against winds, performance (Eggers 1995, chapters 7, 8)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.registry import Change, Context, DrawFunction, Outcome, Reading, by_definition, fitted, judged, read, result
from lowcostnav_ros.studies.air_corrections import (
    CENTRE_KT,
    DECAY,
    GRAVITY_KT_S,
    REFERENCE_KT,
    STATES,
    TILT_RAD,
    WIND,
    ZETA,
    Errors,
    Run,
    Truth,
    correlation,
    errors,
    estimate,
    final_tuning,
    markov,
    rms,
    share_inside,
    total,
    true_corrections,
    wind,
    with_gps,
)
from lowcostnav_ros.trajectory.load_factor import AirSeen, fly, fly_in_envelope

N = 2000
MRAD = 1e3
VARIATION = 0.1
Q_WIND = (100.0, 31.62, 10.0, 5.62, 4.0, 3.16, 1.78, 1.0, 0.562, 0.316, 0.178, 0.1)
Q_ZETA = tuple(np.logspace(-6, -9, 12).tolist())
SUBSET = Q_WIND[:5]
TEXT_GPS, INFERRED_GPS = 0.49 * 3600.0 / 6080.0, 0.25
"""kt: 0.49 ft/s of the text, and what the published residuals differ by."""
PATHS = {"slow sines": "in envelope", "slow sines x 0.6": "in envelope, gentle", "listing": "Error3"}
TABLE_5 = {
    "markov 2": {"wind": (2.3827, 1.8924, 1.5567, 1.4540), "residual": (1.0904, 1.0871, 1.0855, 1.0851), "zeta": (1.7023, 1.6911)},
    "sinusoidal": {"wind": (2.8862, 2.5647, 2.4484, 2.4618), "residual": (2.2401, 2.2379, 2.2341, 2.2299), "zeta": (1.8310, 1.8137)},
}


def path(name: str, n: int = N) -> AirSeen:
    """One of the flights: slow sines, the same gentler, the listing's example, straight and level."""
    if name == "listing":
        t = np.arange(1, n + 1)
        roll = np.sin(2.0 * np.pi * t / 60.0) / 15.0
        return fly(np.full(n, 1.5), roll, np.array([0.0, 320.0, 0.0]), bank=-0.25, variation=VARIATION, gravity=GRAVITY_KT_S)
    if name == "straight":
        return fly(np.ones(n), np.zeros(n), np.array([REFERENCE_KT, 0.0, 0.0]), variation=VARIATION, gravity=GRAVITY_KT_S)
    scale = 0.6 if name.endswith("0.6") else 1.0
    return fly_in_envelope(n, gravity=GRAVITY_KT_S, speed=REFERENCE_KT, scale=scale, variation=VARIATION)


@dataclass(frozen=True)
class Setup:
    """One realisation: flight, wind (or the step of a Markov wind), variance of the true misalignment, sigma of GPS."""

    seed: int
    path: str
    wind: str = "markov 2"
    zeta_q: float = 4.03e-8
    gps: float = TEXT_GPS
    step: float = 0.0

    def make(self) -> tuple[Truth, np.ndarray]:
        """Truth and GPS velocity."""
        rng = stream(self.seed, f"eggers.{self.wind}.{self.step}")
        blows = wind(self.wind, N, rng) if not self.step else markov(N, math.sqrt(1.0 - self.step**2 / 25.0), self.step, rng, CENTRE_KT)
        zeta = markov(N, DECAY, math.sqrt(self.zeta_q), rng)
        truth = Truth.of(path(self.path), true_corrections(N, blows, zeta), VARIATION)
        return truth, with_gps(truth, self.gps, rng)


@dataclass(frozen=True)
class Totals:
    """RMS totals: misalignment, mrad, wind and residual, kt."""

    zeta: float
    wind: float
    residual: float

    @classmethod
    def of(cls, found: Errors) -> "Totals":
        """Of the errors of a run."""
        return cls(MRAD * total(found.states[ZETA]), total(found.states[WIND]), total(found.measured))


def sweep(case: tuple[Setup, tuple[float, ...], str]) -> list[Totals]:
    """One realisation with several values of one noise of the filter: ``wind`` or ``zeta``."""
    setup, values, which = case
    truth, measured = setup.make()
    R = setup.gps**2
    tunings = [final_tuning(R, wind_q=q) if which == "wind" else final_tuning(R, zeta_q=q) for q in values]
    return [Totals.of(errors(truth, estimate(truth, measured, tuning))) for tuning in tunings]


def swept(context: Context, kind: str, flight: str, values: tuple[float, ...], which: str = "wind") -> np.ndarray:
    """RMS over the seeds, shape (values, 3): misalignment, wind, residual."""
    sets = 3 if context.quick else 20

    def compute() -> np.ndarray:
        cases = [(Setup(seed, flight, kind), values, which) for seed in context.seeds(f"eggers {which}", sets)]
        table = np.array([[(t.zeta, t.wind, t.residual) for t in one] for one in context.run(sweep, cases)])
        return np.sqrt(np.mean(table**2, axis=0))

    return np.asarray(context.once(f"eggers {kind} {flight} {len(values)} {which}", compute))


# constants -------------------------------------------------------------------------------------------------------------------------------

BALLOON: tuple[tuple[float, int], ...] = (
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
)
BALLOON += ((7.0, 245), (8.0, 240))


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


# functional isolation --------------------------------------------------------------------------------------------------------------------

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
        for k, (name, (error, injected)) in enumerate(clean.items()):
            made = axes(figure, (1, 4, k + 1), x="time [s]", y="error over injected" if k == 0 else "", title=name)
            made.plot(error[:40] / injected)

    parts = "; ".join(f"{name} {np.array2string(np.abs(error), precision=5)}" for name, error in noisy.items())
    return judged(f"largest after 20 s {100.0 * worst:.2g} per cent; with noise, 300 s: {parts}", worst < 0.01, figure=draw)


# robustness ------------------------------------------------------------------------------------------------------------------------------


def _by_path(context: Context, kind: str) -> dict[str, np.ndarray]:
    return {flight: swept(context, kind, flight, Q_WIND if flight == "slow sines" else SUBSET)[: len(SUBSET)] for flight in PATHS}


def _row(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


@result(
    "ER15",
    "Wind error, Markov 2, Q = 100, 31.62, 10, 5.62",
    source="Table 5",
    thesis="2.383, 1.892, 1.557, 1.454 kt",
    tolerance="falls monotonically by 30 to 50 per cent, every value within 15 per cent; the flight is not published: three paths",
)
def robustness_wind(context: Context) -> Outcome:
    """The published flight is unknown: one column a path."""
    printed, readings = np.array(TABLE_5["markov 2"]["wind"]), []
    for flight, table in _by_path(context, "markov 2").items():
        ours = table[:4, 1]
        good = (np.diff(ours) < 0).all() and 0.5 < ours[3] / ours[0] < 0.7 and (np.abs(ours / printed - 1.0) < 0.15).all()
        readings.append(Reading(f"flight: {flight}", f"{_row(ours)} kt", bool(good)))
    return read(readings)


@result(
    "ER16",
    "Wind error and residual, sinusoidal winds",
    source="Table 5",
    thesis="wind 2.886, 2.565, 2.448, 2.462; residual 2.240, 2.238, 2.234, 2.230 kt",
    tolerance="wind 10 per cent, residual 3 per cent; three paths",
)
def robustness_sinusoidal(context: Context) -> Outcome:
    """One column a path."""
    printed, readings = TABLE_5["sinusoidal"], []
    for flight, table in _by_path(context, "sinusoidal").items():
        good = (np.abs(table[:4, 1] / printed["wind"] - 1.0) < 0.10).all() and (
            np.abs(table[:4, 2] / printed["residual"] - 1.0) < 0.03
        ).all()
        readings.append(Reading(f"flight: {flight}", f"wind {_row(table[:4, 1])}; residual {_row(table[:4, 2])} kt", bool(good)))
    return read(readings)


@result(
    "ER17",
    "Residual, Markov 2",
    source="Table 5",
    thesis="1.0904, 1.0871, 1.0855, 1.0851 kt",
    tolerance="3 per cent, GPS noise of the text (0.49 ft/s)",
)
def robustness_residual(context: Context) -> Outcome:
    """The flight of slow sines."""
    ours = swept(context, "markov 2", "slow sines", Q_WIND)[:4, 2]
    return judged(f"{_row(ours)} kt", bool((np.abs(ours / TABLE_5["markov 2"]["residual"] - 1.0) < 0.03).all()))


@result(
    "ER18",
    "Misalignment error against the wind noise of the filter",
    source="Table 5",
    thesis="Markov 2 1.70, sinusoidal 1.82 mrad, flat in Q",
    tolerance="0.2 mrad at Q = 100 to 5.62",
)
def robustness_misalignment(context: Context) -> Outcome:
    """Nearly the prior sigma of 1.745 mrad: GPS velocity says little of it."""
    found = {kind: swept(context, kind, "slow sines", Q_WIND)[:4, 0] for kind in TABLE_5}
    good = all((np.abs(found[kind] - target) < 0.2).all() for kind, target in (("markov 2", 1.70), ("sinusoidal", 1.82)))
    return judged("; ".join(f"{kind} {_row(values)} mrad" for kind, values in found.items()), good)


def _curves(context: Context, kinds: Sequence[str], titles: str) -> DrawFunction:
    tables = {kind: swept(context, kind, "slow sines", Q_WIND) for kind in kinds}

    def draw(figure: Any) -> None:
        for k, (name, unit) in enumerate((("misalignment", "mrad"), ("wind", "kt"), ("residual", "kt"))):
            made = axes(
                figure, (1, 3, k + 1), x="wind noise of the filter Q [kt^2]", y=f"{name}, RMS [{unit}]", title=titles if k == 1 else ""
            )
            for kind, table in tables.items():
                made.semilogx(Q_WIND, table[:, k], marker=".", label=kind)
            for q in (1.0, 4.0):
                made.axvline(q, color="grey", linewidth=0.7, linestyle=":")
            legend(made)

    return draw


@result(
    "ER19",
    "Markov 1 against Markov 2",
    source="Figures 17, 18",
    thesis="Markov 2 has the lower wind error and residual at all Q; weak sensitivity, small Q slightly preferred",
    tolerance="the order at all 12 Q",
    changed=Change(
        "2026-11-27",
        "differs",
        "the Q of the least wind error, which was to be below 4 for both, is stated and no longer judged: the preference has no number",
    ),
)
def robustness_markov(context: Context) -> Outcome:
    """Order of the curves."""
    one, two = (swept(context, kind, "slow sines", Q_WIND) for kind in ("markov 1", "markov 2"))
    order = bool((two[:, 1:] < one[:, 1:]).all())
    least = [Q_WIND[int(np.argmin(table[:, 1]))] for table in (one, two)]
    draw = _curves(context, ("markov 1", "markov 2"), "Figure 18")
    return judged(f"order holds at all Q: {order}; least wind error at Q = {least[0]:g} and {least[1]:g}", order, figure=draw)


@result(
    "ER19b",
    "Misalignment of Markov 2 slightly worse than of Markov 1",
    source="section 8.3.3, Figure 18",
    thesis="very slightly worse over most Q, which the thesis calls curious",
    tolerance="worse at more than half of the 12 Q",
)
def robustness_curious(context: Context) -> Outcome:
    """What the thesis found curious."""
    one, two = (swept(context, kind, "slow sines", Q_WIND)[:, 0] for kind in ("markov 1", "markov 2"))
    worse = int((two > one).sum())
    why = "worse by less than a per cent at the larger half of the Q, better at the smaller half; the thesis flew three sets"
    return judged(f"worse at {worse} of 12; at Q = 4 {two[4]:.3f} against {one[4]:.3f} mrad", worse > 6, why)


@result(
    "ER20",
    "Wind error of other winds against Markov 1 at Q = 4",
    source="section 8.3.3",
    thesis="ramp +35 per cent, sinusoidal +6.7 per cent",
    tolerance="ramp +25 to +55, sinusoidal +3 to +14 per cent; three paths",
)
def robustness_others(context: Context) -> Outcome:
    """One column a path."""
    readings = []
    tables = {kind: _by_path(context, kind) for kind in ("markov 1", "sinusoidal", "ramp")}
    for flight in PATHS:
        base = tables["markov 1"][flight][4, 1]
        sine, ramp = (100.0 * (tables[kind][flight][4, 1] / base - 1.0) for kind in ("sinusoidal", "ramp"))
        readings.append(
            Reading(f"flight: {flight}", f"ramp {ramp:+.0f}, sinusoidal {sine:+.1f} per cent", 25 <= ramp <= 55 and 3 <= sine <= 14)
        )
    return read(readings)


@result(
    "ER20b",
    "Residual of sinusoidal and ramp winds",
    source="Figure 19",
    thesis="slightly above Markov 1, comparable; diverging for Q below 1 (ramp)",
    tolerance="above Markov 1 by less than 20 per cent at Q = 4; ramp at Q = 0.1 above 1.2 times that at Q = 4",
)
def robustness_residual_others(context: Context) -> Outcome:
    """Order of the curves."""
    found = {kind: swept(context, kind, "slow sines", Q_WIND)[:, 2] for kind in ("markov 1", "sinusoidal", "ramp")}
    at4 = {kind: float(values[4]) for kind, values in found.items()}
    diverges = float(found["ramp"][-1] / found["ramp"][4])
    good = all(1.0 < at4[kind] / at4["markov 1"] < 1.2 for kind in ("sinusoidal", "ramp")) and diverges > 1.2
    text = ", ".join(f"{kind} {value:.2f}" for kind, value in at4.items()) + f" kt at Q = 4; ramp at Q = 0.1 {diverges:.2f} times that"
    return judged(text, good, figure=_curves(context, ("markov 1", "sinusoidal", "ramp"), "Figure 19"))


@result(
    "ER21",
    "Misalignment error against its noise in the filter",
    source="Figure 20",
    thesis="flat minimum near 4.03e-8, climbs rapidly above 1e-7, residual flat",
    tolerance="least between 5e-9 and 2e-7; at 1e-6 above 1.5 times the least; residual within 1 per cent",
)
def sensitivity(context: Context) -> Outcome:
    """Twelve values, Markov 2 winds."""
    table = swept(context, "markov 2", "slow sines", Q_ZETA, "zeta")
    at, climb = Q_ZETA[int(np.argmin(table[:, 0]))], float(table[0, 0] / table[:, 0].min())
    flat = float(np.ptp(table[:, 2]) / table[:, 2].mean())

    def draw(figure: Any) -> None:
        for k, (name, column) in enumerate((("misalignment [mrad]", 0), ("residual [kt]", 2))):
            made = axes(figure, (1, 2, k + 1), x="misalignment noise of the filter [rad^2]", y=f"{name}, RMS", title="Figure 20")
            made.semilogx(Q_ZETA, table[:, column], marker=".")

    text = f"least {table[:, 0].min():.2f} mrad at {at:.1e}; at 1e-6 {table[0, 0]:.2f}"
    text += f"; residual {table[:, 2].mean():.4f} kt within {100 * flat:.2f} per cent"
    return judged(text, 5e-9 < at < 2e-7 and climb > 1.5 and flat < 0.01, figure=draw)


# performance run -------------------------------------------------------------------------------------------------------------------------

RECIPE = "flight of the listing, GPS sigma 0.25 kt and start variances, none of them published"
FIRST_ZETA, FINAL_ZETA = 2.031e-8, 4.03e-8


def perform(setup: Setup) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """RMS of a performance run: states (10,), measured (3,) and true residual (3,)."""
    truth, measured = setup.make()
    found = errors(truth, estimate(truth, measured, final_tuning(setup.gps**2)))
    return found.states, found.measured, found.true


def performance(context: Context, **changes: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean over the seeds."""
    base = Setup(0, "listing", zeta_q=FIRST_ZETA, gps=INFERRED_GPS)

    def compute() -> list[np.ndarray]:
        cases = [replace(base, seed=seed, **changes) for seed in context.seeds("eggers perf", 20)]
        return [np.mean(column, axis=0) for column in zip(*context.run(perform, cases), strict=True)]

    states, measured, true = context.once(f"eggers perf {sorted(changes.items())}", compute)
    return states, measured, true


def one_run(context: Context) -> tuple[Truth, Run]:
    """The run that is drawn."""

    def compute() -> tuple[Truth, Run]:
        truth, measured = Setup(1, "listing", zeta_q=FIRST_ZETA, gps=INFERRED_GPS).make()
        return truth, estimate(truth, measured, final_tuning(INFERRED_GPS**2))

    truth, run = context.once("eggers one run", compute)
    return truth, run


UNITS = ("mrad",) * 5 + ("-",) + ("kt",) * 4
SCALES = np.array([MRAD] * 5 + [1.0] * 5)


def _drawn(context: Context, states: Sequence[int], title: str) -> DrawFunction:
    """Truth and estimate above, error with its sigma below, of some states: the thesis's pairs of figures."""
    truth, run = one_run(context)

    def draw(figure: Any) -> None:
        for k, i in enumerate(states):
            upper = axes(figure, (2, len(states), k + 1), x="", y=f"{STATES[i]} [{UNITS[i]}]", title=title if k == 0 else "")
            upper.plot(SCALES[i] * truth.corrections[:, i], linewidth=0.6, label="truth")
            upper.plot(SCALES[i] * run.estimates[:, i], linewidth=0.6, label="estimate")
            lower = axes(figure, (2, len(states), len(states) + k + 1), x="time [s]", y="error, sigma")
            lower.plot(SCALES[i] * (run.estimates - truth.corrections)[:, i], linewidth=0.5)
            sigma = SCALES[i] * np.sqrt(run.P[:, i, i])
            for sign in (-1.0, 1.0):
                lower.plot(sign * sigma, "k--", linewidth=0.6)
            if k == 0:
                legend(upper)

    return draw


@result(
    "ER22",
    "Performance run, misalignment error",
    source="section 8.4.2",
    thesis="1.0931, 1.2758, 1.2360, total 1.2042 mrad",
    tolerance="0.3 mrad per axis, total 1.0 to 1.4; the noise of the true misalignment is one of two printed",
)
def performance_misalignment(context: Context) -> Outcome:
    """Always near the prior sigma: a column for each printed noise."""
    readings = []
    for zeta_q in (FIRST_ZETA, FINAL_ZETA):
        ours = MRAD * performance(context, zeta_q=zeta_q)[0][ZETA]
        good = (np.abs(ours - [1.0931, 1.2758, 1.2360]) < 0.3).all() and 1.0 < total(ours) < 1.4
        readings.append(Reading(f"true misalignment noise {zeta_q:.3g} rad^2", f"{_row(ours)}, total {total(ours):.3f} mrad", bool(good)))
    return read(readings, figure=_drawn(context, (0, 1, 2), "Figures 21, 41 to 46"))


@result(
    "ER23",
    "Performance run, pitch correction",
    source="section 8.4.3",
    thesis="0.80935 mrad",
    tolerance="0.3 to 1.1 mrad",
)
def performance_pitch(context: Context) -> Outcome:
    """Dominated by what it starts from."""
    ours = MRAD * float(performance(context)[0][3])
    other = MRAD * float(performance(context, path="slow sines")[0][3])
    return fitted(
        f"{ours:.2f} mrad", 0.3 < ours < 1.1, RECIPE, f"{other:.2f} mrad on slow sines", figure=_drawn(context, (3, 4), "Figures 22, 23")
    )


@result(
    "ER23b",
    "Performance run, bank correction",
    source="section 8.4.3",
    thesis="not observable: hardly changes from its start, sigma barely shrinks",
    tolerance="RMS within 20 per cent of the initial error of 0.5 mrad, sigma at the end above 0.97 of that at the start, on both paths",
)
def performance_bank(context: Context) -> Outcome:
    """Independent of the flight."""
    _, run = one_run(context)
    shrunk = math.sqrt(run.P[-1, 4, 4] / 1e-6)
    ours = {flight: MRAD * float(performance(context, path=flight)[0][4]) for flight in ("listing", "slow sines")}
    text = ", ".join(f"{value:.3f} mrad ({flight})" for flight, value in ours.items()) + f"; sigma {shrunk:.3f} of its start"
    return judged(text, all(abs(value / 0.5 - 1.0) < 0.2 for value in ours.values()) and shrunk > 0.97)


@result(
    "ER24",
    "Performance run, wind error",
    source="section 8.4.5",
    thesis="1.3813, 1.4857, 1.2246 kt (total printed 1.3862, of the three 1.3681)",
    tolerance="0.2 kt per axis",
)
def performance_wind(context: Context) -> Outcome:
    """Depends on the flight and the start variances."""
    ours, other = (performance(context, path=flight)[0][WIND] for flight in ("listing", "slow sines"))
    good = bool((np.abs(ours - [1.3813, 1.4857, 1.2246]) < 0.2).all())
    text = f"{_row(ours)}, total {total(ours):.3f} kt"
    return fitted(text, good, RECIPE, f"{_row(other)} kt on slow sines", figure=_drawn(context, (7, 8, 9), "Figures 27, 28, 55 to 58"))


@result(
    "ER25",
    "Performance run, airspeed scale and bias",
    source="section 8.4.4",
    thesis="6.9546e-3, 1.1404 kt",
    tolerance="5e-3 to 1.2e-2, 0.8 to 1.5 kt",
)
def performance_airspeed(context: Context) -> Outcome:
    """Depends on the flight and the start variances."""
    ours, other = (performance(context, path=flight)[0][5:7] for flight in ("listing", "slow sines"))
    good = 5e-3 < ours[0] < 1.2e-2 and 0.8 < ours[1] < 1.5
    text = f"{ours[0]:.2e}, {ours[1]:.2f} kt"
    return fitted(
        text, good, RECIPE, f"{other[0]:.2e}, {other[1]:.2f} kt on slow sines", figure=_drawn(context, (5, 6), "Figures 24 to 26")
    )


def _residual_figure(context: Context) -> DrawFunction:
    _, run = one_run(context)

    def draw(figure: Any) -> None:
        for k, name in enumerate("NED"):
            made = axes(figure, (1, 3, k + 1), x="time [s]", y="residual [kt]" if k == 0 else "", title=f"{name} (Figures 29, 59 to 61)")
            made.plot((run.measured - run.predicted)[1:500, k], linewidth=0.5)
            for sign in (-1.0, 1.0):
                made.plot(sign * np.sqrt(run.residual_variance[1:500, k]), "k--", linewidth=0.6)

    return draw


@result(
    "ER26",
    "Performance run, GPS less predicted velocity",
    source="section 8.4.6",
    thesis="1.0944, 1.0949, 1.0547, total 1.0815 kt",
    tolerance="0.03 kt of the total",
    changed=Change(
        "2026-11-27",
        "differs",
        "of the total instead of every axis: an axis of a single run scatters by 0.02 kt (sigma over our seeds), the total by 0.011",
    ),
)
def performance_residual(context: Context) -> Outcome:
    """Its excess over the true residual served to infer the GPS noise."""
    ours = performance(context)[1]
    other = performance(context, gps=0.43925)[1]
    good = abs(total(ours) - 1.0815) < 0.03
    setting = "GPS sigma of 0.25 kt, from the difference of this and the true residual"
    text = f"{_row(ours)}, total {total(ours):.4f} kt"
    return fitted(text, good, setting, f"{total(other):.3f} kt with the printed 0.74 ft/s", figure=_residual_figure(context))


@result(
    "ER27",
    "Performance run, true less predicted velocity",
    source="section 8.4.6",
    thesis="1.0652, 1.0684, 1.0250, total 1.0531 kt",
    tolerance="0.03 kt of the total, on every path",
)
def performance_true(context: Context) -> Outcome:
    """Hardly depends on the flight: it is the wind's step."""
    found = {flight: performance(context, path=flight)[2] for flight in ("listing", "slow sines", "slow sines x 0.6")}
    text = "; ".join(f"{flight} {_row(ours)}, total {total(ours):.4f} kt" for flight, ours in found.items())
    return judged(text, all(abs(total(ours) - 1.0531) < 0.03 for ours in found.values()))


def markov_one(setup: Setup) -> tuple[float, float]:
    """True and measured residual with Q = 4."""
    truth, measured = setup.make()
    found = errors(truth, estimate(truth, measured, final_tuning(setup.gps**2, wind_q=4.0)))
    return total(found.true), total(found.measured)


@result(
    "ER28",
    "True residual with Markov 1 winds, Q = 4",
    source="section 9.2",
    thesis="about 2.1 kt for a volatility of 4 kt^2/s",
    tolerance="0.1 kt",
)
def volatile(context: Context) -> Outcome:
    """Mean over the seeds."""
    cases = [Setup(seed, "listing", "markov 1", FIRST_ZETA, INFERRED_GPS) for seed in context.seeds("eggers perf", 20)]
    true, measured = np.mean(context.run(markov_one, cases), axis=0)
    return judged(f"{true:.3f} kt (GPS less predicted {measured:.3f})", abs(true - 2.1) < 0.1)


def straight(setup: Setup) -> np.ndarray:
    """Residual total, and the errors at the end of V_S, V_B and the east wind."""
    truth, measured = setup.make()
    run = estimate(truth, measured, final_tuning(setup.gps**2))
    error = (run.estimates - truth.corrections)[-1]
    return np.array([total(rms(run.measured - run.predicted)), abs(error[5]), abs(error[6]), abs(error[8])])


@result(
    "ER29",
    "Wings-level straight flight",
    source="sections 8.4.1, 9.1.2",
    thesis="states diverge from truth, the residual stays good",
    tolerance="residual within 3 per cent of 1.0815 kt; V_S off by more than 0.03 at the end",
)
def straight_flight(context: Context) -> Outcome:
    """Straight and level north at 300 kt from a cold start."""
    cases = [Setup(seed, "straight", "markov 2", FIRST_ZETA, INFERRED_GPS) for seed in context.seeds("eggers perf", 20)]
    residual, scale, bias, east = np.mean(context.run(straight, cases), axis=0)
    text = f"residual {residual:.4f} kt; at the end V_S off by {scale:.3f}, V_B by {bias:.1f} kt, east wind by {east:.1f} kt"
    return judged(text, abs(residual / 1.0815 - 1.0) < 0.03 and scale > 0.03)


def _correlation_figure(context: Context, state: int, title: str) -> DrawFunction:
    _, run = one_run(context)
    found = correlation(run, state)

    def draw(figure: Any) -> None:
        made = axes(figure, x="time [s]", y=f"correlation of {STATES[state]}", title=title)
        for k in (7, 8, 9):
            made.plot(found[:600, k], linewidth=0.7, label=STATES[k])
        legend(made)

    return draw


@result(
    "ER30",
    "Correlation of pitch with the vertical wind",
    source="section 8.4.3",
    thesis="moderate",
    tolerance="mean 0.2 to 0.6",
)
def pitch_correlation(context: Context) -> Outcome:
    """Mean of the size over the run."""
    mean = float(np.abs(correlation(one_run(context)[1], 3)[:, 9]).mean())
    return judged(f"mean {mean:.2f}", 0.2 < mean < 0.6, figure=_correlation_figure(context, 3, "Figure 16"))


@result(
    "ER31",
    "Correlation of the airspeed bias with the winds",
    source="section 8.4.4",
    thesis="strong, flips its sign as the aircraft turns; almost always one wind is highly correlated",
    tolerance="mean of the largest size above 0.7; sign of north and east correlation flips",
)
def bias_correlation(context: Context) -> Outcome:
    """On the flight of the listing, which turns all round."""
    found = correlation(one_run(context)[1], 6)[20:, 7:10]
    largest = float(np.abs(found).max(axis=1).mean())
    flips = [int((np.diff(np.sign(found[:, k])) != 0).sum()) for k in (0, 1)]
    text = f"mean of the largest {largest:.2f}; sign changes {flips[0]} (north), {flips[1]} (east)"
    return judged(text, largest > 0.7 and min(flips) >= 2, figure=_correlation_figure(context, 6, "V_B with the winds"))


@result(
    "ER32",
    "Correlation of the airspeed scale with the winds",
    source="section 8.4.4",
    thesis="no consistent correlation",
    tolerance="mean below 0.2 for every wind",
)
def scale_correlation(context: Context) -> Outcome:
    """Mean over the run."""
    found = correlation(one_run(context)[1], 5)[:, 7:10].mean(axis=0)
    return judged(f"means {_row(found)}", bool((np.abs(found) < 0.2).all()), figure=_correlation_figure(context, 5, "V_S with the winds"))


@result(
    "ER33",
    "Process noise of pitch 1e-14 against 1e-40",
    source="section 8.4.3",
    thesis="no effect on RMS or sigma",
    tolerance="four digits of all",
)
def pitch_noise(context: Context) -> Outcome:
    """The same run twice."""
    truth, run = one_run(context)
    other = estimate(truth, run.measured, final_tuning(INFERRED_GPS**2, pitch_q=1e-40))
    a, b = (np.concatenate((errors(truth, r).states, np.sqrt(np.diagonal(r.P[-1])))) for r in (run, other))
    worst = float(np.abs(a / b - 1.0).max())
    return judged(f"largest relative difference {worst:.1e}", worst < 1e-4)


@result(
    "ER34",
    "Residuals within one sigma",
    source="Figures 15, 29",
    thesis="residuals fill the band of one sigma",
    tolerance="0.68 within 0.03",
)
def residual_share(context: Context) -> Outcome:
    """Share over the run."""
    share = share_inside(one_run(context)[1])
    return judged(f"{share:.3f}", abs(share - 0.68) < 0.03, figure=_residual_figure(context))


STEPS = (0.5, 1.0, 2.0, 3.0)


def stepped(setup: Setup) -> tuple[float, float]:
    """True residual and wind error with a filter that knows the step of the wind."""
    truth, measured = setup.make()
    found = errors(truth, estimate(truth, measured, final_tuning(setup.gps**2, wind_q=setup.step**2)))
    return total(found.true), total(found.states[WIND])


def _stepped(context: Context) -> np.ndarray:
    def compute() -> np.ndarray:
        seeds = context.seeds("eggers perf", 20)
        rows = [context.run(stepped, [Setup(s, "listing", "", FIRST_ZETA, INFERRED_GPS, step) for s in seeds]) for step in STEPS]
        return np.array([np.mean(row, axis=0) for row in rows])

    return np.asarray(context.once("eggers stepped", compute))


@result(
    "ER36",
    "True residual against the wind's step",
    source="sections 8.4.6, 9.2",
    thesis="always only slightly above the level of the wind's noise",
    tolerance="ratio 1.0 to 1.15 for steps of 0.5 to 3 kt",
)
def residual_of_step(context: Context) -> Outcome:
    """A Markov wind of 5 kt with each step, the filter's Q its square."""
    found = _stepped(context)[:, 0]
    ratio = found / STEPS
    return judged(f"{_row(found)} kt for steps of 0.5, 1, 2, 3 kt, ratio {_row(ratio)}", bool(((ratio > 1.0) & (ratio < 1.15)).all()))


@result(
    "ER37",
    "Wind error against the wind's step",
    source="section 8.4.5",
    thesis="typically a fraction of a knot above the noise",
    tolerance="above the step by 0 to 1 kt for steps of 0.5 to 3 kt",
)
def wind_of_step(context: Context) -> Outcome:
    """The same runs."""
    found = _stepped(context)[:, 1]
    above = found - STEPS
    return judged(f"{_row(found)} kt, above by {_row(above)}", bool(((above > 0.0) & (above < 1.0)).all()))


@result(
    "ER39",
    "Convergence in the performance run",
    source="sections 8.4.2 to 8.4.4, Figures 21 to 26",
    thesis="V_S fast, V_B slower, pitch very slow, bank none; misalignment follows trends",
    tolerance="sigma halves sooner for V_S than for V_B; pitch above 0.9 at 300 s, below at 2000 s; bank above 0.99; misalignment flat",
)
def convergence(context: Context) -> Outcome:
    """Sigma at 30, 100, 300 and 2000 s over that at the start."""
    truth, run = one_run(context)
    sigma = np.sqrt(np.diagonal(run.P, axis1=1, axis2=2))
    start = np.sqrt(final_tuning().P0)
    share = sigma / start
    halved = [int(np.argmax(share[:, k] < 0.5)) for k in (5, 6)]
    at = {k: share[[29, 99, 299, 1999], k] for k in (5, 6, 3, 4, 0)}
    good = 0 <= halved[0] <= halved[1] and at[5][1] < at[6][1] and at[3][2] > 0.9 > at[3][3] and at[4][3] > 0.99 and np.ptp(at[0]) < 0.05
    text = "; ".join(f"{STATES[k]} {_row(values)}" for k, values in at.items())

    def draw(figure: Any) -> None:
        made = axes(figure, x="time [s]", y="sigma over that at the start", title="convergence")
        for k in (5, 6, 3, 4, 0):
            made.plot(share[:, k], linewidth=0.9, label=STATES[k])
        legend(made)

    return judged(text, bool(good), figure=draw)


@result(
    "ER40",
    "Estimate errors against their sigma",
    source="Figures 14, 22, 28",
    thesis="errors fill the band with slight overflow",
    tolerance="within one posterior sigma after 500 s: misalignment 0.5 to 0.9, winds 0.4 to 0.68 (estimates are logged before the update)",
)
def error_share(context: Context) -> Outcome:
    """Mean over the seeds of the share inside."""
    cases = [Setup(s, "listing", "markov 2", FIRST_ZETA, INFERRED_GPS) for s in context.seeds("eggers perf", 20)]
    shares = np.mean(context.run(inside, cases), axis=0)
    zeta, winds = shares[ZETA], shares[WIND]
    good = bool(((zeta > 0.5) & (zeta < 0.9)).all() and ((winds > 0.4) & (winds < 0.68)).all())
    return judged(
        f"misalignment {_row(zeta)}, V_S {shares[5]:.2f}, V_B {shares[6]:.2f}, winds {_row(winds)}",
        good,
        figure=_drawn(context, (0, 7), "Figure 14"),
    )


def inside(setup: Setup) -> np.ndarray:
    """Share (10,) of the errors, logged before the update, within the sigma after it, after 500 s."""
    truth, measured = setup.make()
    run = estimate(truth, measured, final_tuning(setup.gps**2))
    sigma = np.sqrt(np.diagonal(run.P, axis1=1, axis2=2))
    return np.asarray((np.abs(run.estimates - truth.corrections) < sigma)[500:].mean(axis=0))
