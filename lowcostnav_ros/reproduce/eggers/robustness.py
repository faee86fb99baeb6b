"""The error estimator against winds and misalignments that it does not expect (Eggers 1995, section 8.3, Table 5)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.reproduce.eggers.realisations import MRAD, Setup, row
from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.registry import Change, Context, DrawFunction, Outcome, Reading, judged, read, result
from lowcostnav_ros.studies.air_corrections import (
    WIND,
    ZETA,
    Errors,
    errors,
    estimate,
    final_tuning,
    total,
)

Q_WIND = (100.0, 31.62, 10.0, 5.62, 4.0, 3.16, 1.78, 1.0, 0.562, 0.316, 0.178, 0.1)
Q_ZETA = tuple(np.logspace(-6, -9, 12).tolist())
SUBSET = Q_WIND[:5]
PATHS = {"slow sines": "in envelope", "slow sines x 0.6": "in envelope, gentle", "listing": "Error3"}
TABLE_5 = {
    "markov 2": {"wind": (2.3827, 1.8924, 1.5567, 1.4540), "residual": (1.0904, 1.0871, 1.0855, 1.0851), "zeta": (1.7023, 1.6911)},
    "sinusoidal": {"wind": (2.8862, 2.5647, 2.4484, 2.4618), "residual": (2.2401, 2.2379, 2.2341, 2.2299), "zeta": (1.8310, 1.8137)},
}


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


def _by_path(context: Context, kind: str) -> dict[str, np.ndarray]:
    return {flight: swept(context, kind, flight, Q_WIND if flight == "slow sines" else SUBSET)[: len(SUBSET)] for flight in PATHS}


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
        readings.append(Reading(f"flight: {flight}", f"{row(ours)} kt", bool(good)))
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
        readings.append(Reading(f"flight: {flight}", f"wind {row(table[:4, 1])}; residual {row(table[:4, 2])} kt", bool(good)))
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
    return judged(f"{row(ours)} kt", bool((np.abs(ours / TABLE_5["markov 2"]["residual"] - 1.0) < 0.03).all()))


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
    return judged("; ".join(f"{kind} {row(values)} mrad" for kind, values in found.items()), good)


def _curves(context: Context, kinds: Sequence[str], titles: str) -> DrawFunction:
    tables = {kind: swept(context, kind, "slow sines", Q_WIND) for kind in kinds}

    def draw(figure: Any) -> None:
        """RMS of each quantity over the wind noise of the filter, a curve a kind of wind."""
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
        """RMS over the misalignment noise of the filter, as Figure 20."""
        for k, (name, column) in enumerate((("misalignment [mrad]", 0), ("residual [kt]", 2))):
            made = axes(figure, (1, 2, k + 1), x="misalignment noise of the filter [rad^2]", y=f"{name}, RMS", title="Figure 20")
            made.semilogx(Q_ZETA, table[:, column], marker=".")

    text = f"least {table[:, 0].min():.2f} mrad at {at:.1e}; at 1e-6 {table[0, 0]:.2f}"
    text += f"; residual {table[:, 2].mean():.4f} kt within {100 * flat:.2f} per cent"
    return judged(text, 5e-9 < at < 2e-7 and climb > 1.5 and flat < 0.01, figure=draw)
