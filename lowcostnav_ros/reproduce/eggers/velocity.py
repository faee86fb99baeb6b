"""The filter of position and velocity: gains, its convergence, and the three flights that it was tested on (Eggers 1995, chapters 5, 6)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from lowcostnav_ros.estimation import multirate
from lowcostnav_ros.reproduce.eggers.realisations import row
from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.registry import Context, Outcome, Reading, by_definition, judged, read, result
from lowcostnav_ros.studies.air_corrections import rms

DT = 0.02
DEG_PER_KT = DT / (3600.0 * 60.0)
FT_PER_KT = DT * 6080.0 / 3600.0
PROBABLE = 0.674
"""Normal quartile, by which a probable error is divided."""
GPS_FT, GPS_FT_S, AIR_FT_S = 5.0 / PROBABLE, 0.5 / PROBABLE, 0.2 / PROBABLE
TO_KT = 3600.0 / 6080.0
GPS_KT2, AIR_KT2 = (GPS_FT_S * TO_KT) ** 2, (AIR_FT_S * TO_KT) ** 2
GPS_POSITION_FT2 = GPS_FT**2
GPS_POSITION_DEG2 = (GPS_FT / (6080.0 * 60.0)) ** 2
STEP_FT_S = 0.5 * 7.0 * 32.0 * DT
STEP_KT2 = (STEP_FT_S * TO_KT) ** 2
POSITION_STEP_FT2 = (0.5 * 0.5 * 7.0 * 32.0 * DT**2) ** 2
POSITION_STEP_DEG2 = (math.sqrt(POSITION_STEP_FT2) / (6080.0 * 60.0)) ** 2
LISTED_DEG2 = 4.1353e-15
"""R of position in the listing: a misplaced exponent."""
PRINTED_HORIZONTAL = {
    "K1": ((0.82511, 3.7968e-11, 2.373e-10), (1771.5, 0.13591, 0.84944)),
    "K2": ((1.3409e-9,), (0.98300,)),
    "K3": ((1.5663e-9,), (0.98304,)),
    "K4": ((1.5702e-9,), (0.98304,)),
}
PRINTED_VERTICAL = {
    "K1": ((0.0062207, 7.8702e-5, 4.9189e-4), (2.7592e-7, 0.13591, 0.84944)),
    "K2": ((4.9604e-4,), (0.98300,)),
    "K3": ((5.715e-4,), (0.98304,)),
    "K4": ((5.728e-4,), (0.98304,)),
}
FOUR_DIGITS = (2.373e-10, 5.715e-4, 5.728e-4)
"""Printed with four digits, all others with five."""
PRINTED_EAST_30 = (4.3842e-11, 2.7401e-10, 1534.1, 1.5483e-9, 1.8086e-9, 1.8131e-9)
FEET = multirate.position_velocity(DT, 0.005, 5.0, (54.8, 0.548), 0.0881)


def axis(latitude: float | None, r_deg2: float = LISTED_DEG2) -> multirate.Model:
    """One axis in degrees and knots at a latitude, rad, as the East axis has it (0: North too); None: the vertical, in feet."""
    if latitude is None:
        noise = (POSITION_STEP_FT2, STEP_KT2), (GPS_POSITION_FT2, 0.19294), 0.03087
        model = multirate.position_velocity(DT, *noise[0], noise[1], noise[2])
        model.A[0, 1] = FT_PER_KT
        return model
    stretch = 1.0 / math.cos(latitude)
    noise_q, noise_r = 3.7704e-15 * stretch**2, r_deg2 * stretch**2
    model = multirate.position_velocity(DT, noise_q, 1.7591, (noise_r, 0.19294), 0.03087)
    model.A[0, 1] = DEG_PER_KT * stretch
    return model


def cycle(model: multirate.Model) -> multirate.Cycle:
    """The steady cycle, converged as far as the printed digits need."""
    return multirate.steady_cycle(model, tolerance=1e-10)


def entries(found: multirate.Cycle) -> list[float]:
    """Gains of one axis in a row: six of the first, then two of each other."""
    return [*found.gains[0].ravel().tolist(), *(float(v) for gain in found.gains[1:] for v in gain[:, 0])]


def same_digits(ours: float, printed: float) -> bool:
    """Whether a number equals a printed one to within one in its last digit."""
    digits = 4 if printed in FOUR_DIGITS else 5
    unit = 10.0 ** (math.floor(math.log10(abs(printed))) - digits + 1)
    return abs(round(ours / unit) - round(printed / unit)) <= 1


def _printed(table: Mapping[str, tuple[tuple[float, ...], ...]]) -> list[float]:
    return [*table["K1"][0], *table["K1"][1], *(v for name in ("K2", "K3", "K4") for v in (table[name][0][0], table[name][1][0]))]


@result(
    "ER1",
    "Steady-state gains, latitude 0",
    source="Table 1, section 11.1.1.2",
    thesis="K1 .82511, 3.7968e-11, 2.373e-10, 1771.5, .13591, .84944; K2 to K4; vertical .0062207 ... 5.728e-4",
    tolerance="one in the last printed digit, all 24 entries",
)
def steady_gains(_: Context) -> Outcome:
    """Of the listing's noise, and of the text's."""
    vertical = cycle(axis(None))
    good_vertical = [same_digits(a, b) for a, b in zip(entries(vertical), _printed(PRINTED_VERTICAL), strict=True)]
    readings = []
    noises = {"listing, 4.1353e-15 deg^2": LISTED_DEG2, "text, 4.14e-10 deg^2": 4.1353e-10}
    for name, r in noises.items():
        ours = entries(cycle(axis(0.0, r)))
        good = [same_digits(a, b) for a, b in zip(ours, _printed(PRINTED_HORIZONTAL), strict=True)]
        text = f"{sum(good)} of 12 horizontal and {sum(good_vertical)} of 12 vertical entries; position from GPS position {ours[0]:.5g}"
        readings.append(Reading(f"position noise of the {name}", text, all(good) and all(good_vertical)))

    def draw(figure: Any) -> None:
        """Variance of position through three steady cycles, as Figure 5."""
        correct = cycle(axis(0.0, 4.1353e-10))
        made = axes(figure, (1, 1, 1), x="phase", y="variance of position after the update [1e-12 deg^2]", title="Figure 5, text's noise")
        values = [1e12 * P[0, 0] for P in correct.posterior] * 3
        made.step(range(len(values)), values, where="post")

    why = "a misplaced exponent made the published horizontal gains; with the text's noise the North gain is the vertical one, .00622"
    return read(readings, why, draw)


@result(
    "ER2",
    "Steady-state gains, latitude 30 deg, East",
    source="section 11.1.1.3",
    thesis="4.3842e-11, 2.7401e-10, 1534.1, 1.5483e-9, 1.8086e-9, 1.8131e-9",
    tolerance="one in the last printed digit",
)
def gains_at_30(_: Context) -> Outcome:
    """The East axis of the listing at 30 degrees."""
    ours = entries(cycle(axis(math.radians(30.0))))
    chosen = (ours[1], ours[2], ours[3], ours[6], ours[8], ours[10])
    good = all(same_digits(a, b) for a, b in zip(chosen, PRINTED_EAST_30, strict=True))
    return judged(", ".join(f"{value:.5g}" for value in chosen), good)


@result(
    "ER3",
    "Gains against latitude",
    source="section 5.3.3, Figures 6, 7, 30, 31",
    thesis="East gains from velocities to position go with 1/cos(latitude), from position to velocity with cos; all others constant",
    tolerance="relative 1e-4 at 0 to 80 deg",
)
def gains_over_latitude(_: Context) -> Outcome:
    """Riccati solutions at each latitude against the scaled equator."""
    degrees = np.arange(0.0, 81.0, 10.0)
    found = np.array([entries(cycle(axis(math.radians(d)))) for d in degrees])
    cosine = np.cos(np.radians(degrees))
    power = np.array([0, -1, -1, 1, 0, 0, -1, 0, -1, 0, -1, 0])
    worst = float(np.abs(found / (found[0] * cosine[:, None] ** power) - 1.0).max())

    def draw(figure: Any) -> None:
        """Gains over latitude: to position left, to velocity right."""
        left = axes(figure, (1, 2, 1), x="latitude [deg]", y="East gain, velocity to position", title="Figures 6, 30")
        for k, name in ((1, "K1 GPS"), (2, "K1 air data"), (6, "K2"), (8, "K3"), (10, "K4")):
            left.plot(degrees, found[:, k], label=name)
        legend(left)
        right = axes(figure, (1, 2, 2), x="latitude [deg]", y="East gain, position to velocity", title="Figures 7, 31")
        right.plot(degrees, found[:, 3])

    return judged(f"largest relative difference {worst:.1e}", worst < 1e-4, figure=draw)


@result(
    "ER4",
    "Convergence from above and below to a cycle of four",
    source="section 5.3.2, Figure 5",
    thesis="converges from both sides; velocity within a few cycles, position slowly",
    tolerance="monotone from both sides; velocity within 1 per cent in 5 cycles, position not in 25",
)
def convergence(_: Context) -> Outcome:
    """Variance after phase 4 from a start above and below."""
    model = FEET
    steady = cycle(model).posterior[-1]
    runs = {
        name: np.array([P for _, _, P in multirate.run(model, start, 4000)][3::4])
        for name, start in (("above", np.diag([5.0, 20.0])), ("below", 1e-3 * np.eye(2)))
    }
    above, below = runs["above"][:, 0, 0], runs["below"][:, 0, 0]
    monotone = bool((np.diff(above) <= 1e-12).all() and (np.diff(below) >= -1e-12).all())
    velocity = max(abs(run[5, 1, 1] / steady[1, 1] - 1.0) for run in runs.values())
    position = min(abs(run[25, 0, 0] / steady[0, 0] - 1.0) for run in runs.values())
    met = max(abs(run[-1, 0, 0] / steady[0, 0] - 1.0) for run in runs.values())

    def draw(figure: Any) -> None:
        """Variance from above and below, and three steady cycles."""
        left = axes(figure, (1, 2, 1), x="cycle", y="position variance [ft^2]", title="from above and below")
        for name, run in runs.items():
            left.plot(run[:600, 0, 0], label=name)
        legend(left)
        right = axes(figure, (1, 2, 2), x="phase", y="variance after the update [ft^2]", title="steady cycle (Figure 5)")
        right.step(range(12), [P[0, 0] for P in cycle(model).posterior] * 3, where="post")

    text = (
        f"monotone: {monotone}; after 5 cycles velocity within {velocity:.1e}, after 25 position off by {position:.2f}, at last {met:.0e}"
    )
    return judged(text, monotone and velocity < 0.01 < position and met < 1e-4, figure=draw)


@result(
    "ER5",
    "Gains of the version in feet",
    source="section 11.1.2",
    thesis="1.89861e-2, 4.63737e-5, 2.88454e-4, 4.63737e-7, .136464, .848834; 2.94614e-4/.982936; 3.39709e-4/.982975; 3.40489e-4/.982975",
    tolerance="six digits",
)
def gains_in_feet(_: Context) -> Outcome:
    """All twelve."""
    printed = [1.89861e-2, 4.63737e-5, 2.88454e-4, 4.63737e-7, 0.136464, 0.848834]
    printed += [2.94614e-4, 0.982936, 3.39709e-4, 0.982975, 3.40489e-4, 0.982975]
    ours = entries(multirate.steady_cycle(FEET, tolerance=1e-13))
    worst = max(abs(a / b - 1.0) for a, b in zip(ours, printed, strict=True))
    return judged(f"largest relative difference {worst:.1e}", worst < 5e-6)


# the three flights -----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class NavRun:
    """Errors of a flight: position (n, 3) ft and velocity (n, 3) ft/s; the true velocity, what was measured of it by each, the estimate."""

    position: np.ndarray
    velocity: np.ndarray
    true: np.ndarray
    gps: np.ndarray
    air: np.ndarray
    estimate: np.ndarray


def commands(test: int) -> tuple[np.ndarray, np.ndarray]:
    """Velocity at the start (3,) and change in each step (n, 3), ft/s, of the three tests."""
    if test == 1:
        return np.array([400.0, 200.0, 0.0]), np.zeros((1200, 3))
    u = np.zeros((200, 3))
    if test == 2:
        u[50:150, 2] = 3.0
        return np.array([400.0, 200.0, 0.0]), u
    u[:, :2] = np.repeat([(-1.0, 4.0), (-2.0, 3.0), (-3.0, 2.0), (-4.0, 1.0)], 50, axis=0)
    return np.array([500.0, 0.0, 0.0]), u


@cache
def _feet_gains() -> tuple[np.ndarray, ...]:
    return cycle(FEET).gains


def navigate(test: int, seed: int, samples: int | None = None) -> NavRun:
    """Fly one test with the four gains, from the exact truth."""
    start, u = commands(test)
    u = u[:samples]
    rng, n = np.random.default_rng([seed, 0xE6]), len(u)
    noise = [s * rng.standard_normal((n, 3)) for s in (7.4, 0.74, 0.3)]
    true_v = start + np.vstack((np.zeros(3), np.cumsum(u, axis=0)[:-1]))
    true_p = np.vstack((np.zeros(3), np.cumsum(DT * true_v, axis=0)[:-1]))
    gains, p, v = _feet_gains(), true_p[0].copy(), true_v[0].copy()
    position, velocity = np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        K = gains[k % 4]
        y = [true_v[k] + noise[2][k] - v]
        if k % 4 == 0:
            y = [true_p[k] + noise[0][k] - p, true_v[k] + noise[1][k] - v, *y]
        moved, turned = K @ np.array(y)
        p, v = p + moved, v + turned
        position[k], velocity[k] = p, v
        p = p + DT * v
    return NavRun(position - true_p, velocity - true_v, true_v, noise[1], noise[2], velocity)


def _nav1(context: Context) -> list[NavRun]:
    return context.once("eggers nav 1", lambda: [navigate(1, seed) for seed in context.seeds("eggers nav 1", 20)])


@result(
    "ER6",
    "NAV-1, velocity error",
    source="sections 6.2, 9.2",
    thesis="RMS 0.2914, 0.2868, 0.2908 ft/s, overall 0.2897",
    tolerance="0.012 ft/s per axis",
)
def nav1_velocity(context: Context) -> Outcome:
    """Constant velocity, 24 s, mean over the seeds."""
    runs = _nav1(context)
    ours = np.mean([rms(run.velocity) for run in runs], axis=0)

    def draw(figure: Any) -> None:
        """Errors of one flight in position and velocity."""
        t = DT * np.arange(len(runs[0].velocity))
        for k, (values, unit, name) in enumerate(((runs[0].position, "ft", "Figure 32"), (runs[0].velocity, "ft/s", "Figure 33"))):
            made = axes(figure, (1, 2, k + 1), x="time [s]", y=f"error [{unit}]", title=name)
            made.plot(t, values, linewidth=0.6, label=list("NED"))
            legend(made)

    good = bool((np.abs(ours - [0.2914, 0.2868, 0.2908]) < 0.012).all())
    return judged(f"{row(ours, 4)} ft/s, overall {math.sqrt(float(np.mean(ours**2))):.4f}", good, figure=draw)


@result(
    "ER7",
    "NAV-1, mean velocity error",
    source="section 6.2",
    thesis="0.0121, -0.0105, -0.0038 ft/s",
    tolerance="smaller than 0.03 ft/s",
)
def nav1_mean_velocity(context: Context) -> Outcome:
    """Spread of the mean over the seeds."""
    means = np.array([run.velocity.mean(axis=0) for run in _nav1(context)])
    return judged(f"sigma of the mean {means.std():.4f} ft/s, largest {np.abs(means).max():.4f}", bool(np.abs(means).max() < 0.03))


@result(
    "ER8",
    "NAV-1, position error",
    source="sections 6.2, 9.2",
    thesis="RMS 0.5662, 0.5922, 0.6448 ft, overall 0.6020",
    tolerance="0.40 to 1.1 ft per axis",
)
def nav1_position(context: Context) -> Outcome:
    """Mean over the seeds."""
    ours = np.mean([rms(run.position) for run in _nav1(context)], axis=0)
    return judged(f"{row(ours, 4)} ft", bool(((ours > 0.40) & (ours < 1.1)).all()))


@result(
    "ER9",
    "NAV-1, mean position error",
    source="section 6.2",
    thesis="-0.0479, 0.2327, -0.3819 ft",
    tolerance="smaller than 1.2 ft: a slow random walk",
)
def nav1_mean_position(context: Context) -> Outcome:
    """Spread of the mean over the seeds."""
    means = np.array([run.position.mean(axis=0) for run in _nav1(context)])
    return judged(f"sigma of the mean {means.std():.2f} ft, largest {np.abs(means).max():.2f}", bool(np.abs(means).max() < 1.2))


def _increase(context: Context, name: str) -> dict[int, float]:
    """Increase of an RMS of NAV-2 and NAV-3 over NAV-1, same noise, per cent."""
    seeds = context.seeds("eggers nav 23", 20)
    runs = {test: [navigate(test, seed, 200) for seed in seeds] for test in (1, 2, 3)}
    of = {test: math.sqrt(float(np.mean([np.mean(getattr(run, name) ** 2) for run in found]))) for test, found in runs.items()}
    return {test: 100.0 * (of[test] / of[1] - 1.0) for test in (2, 3)}


@result(
    "ER10",
    "NAV-2 and NAV-3, increase of the velocity error",
    source="sections 6.3, 6.4",
    thesis="+0.6 per cent (velocity change), +0.8 per cent (hard turn); no visible lag",
    tolerance="0 to +1.5 per cent, same noise",
)
def hard_turns(context: Context) -> Outcome:
    """The same noise through all three tests."""
    found = _increase(context, "velocity")
    runs = {test: navigate(test, 3) for test in (2, 3)}

    def draw(figure: Any) -> None:
        """Velocity by GPS, estimate and truth in both turns."""
        for k, (test, column, title) in enumerate(((2, 2, "NAV-2, down (Figure 36)"), (3, 1, "NAV-3, east (Figures 37 to 40)"))):
            made = axes(figure, (1, 2, k + 1), x="time [s]", y="velocity [ft/s]", title=title)
            t = DT * np.arange(200)
            made.plot(t, (runs[test].true + runs[test].gps)[:, column], ".", markersize=2, label="GPS")
            made.plot(t, runs[test].estimate[:, column], linewidth=0.8, label="estimate")
            made.plot(t, runs[test].true[:, column], "k--", linewidth=0.6, label="truth")
            legend(made)

    text = f"NAV-2 {found[2]:+.2f} per cent, NAV-3 {found[3]:+.2f} per cent"
    return judged(text, all(0.0 <= value <= 1.5 for value in found.values()), figure=draw)


@result(
    "ER10b",
    "NAV-2 and NAV-3, increase of the position error",
    source="sections 6.3, 6.4",
    thesis="+0.8 per cent for both",
    tolerance="0.8 per cent within a factor of two, same noise",
)
def hard_turns_position(context: Context) -> Outcome:
    """What the dynamics add to the position is far below what one realisation of the noise differs from another by."""
    found = _increase(context, "position")
    text = f"NAV-2 {found[2]:+.3f} per cent, NAV-3 {found[3]:+.3f} per cent"
    why = "the same noise through each test moves the position error by next to nothing: the printed increase is of another noise"
    return judged(text, all(0.4 <= value <= 1.6 for value in found.values()), why)


@result(
    "ER13",
    "Conversion of probable errors and of 7 g into variances",
    source="section 5.2",
    thesis="R 4.14e-10 deg^2, 55.03 ft^2, 0.19, 3.09e-2 kt^2; Q 3.7704e-15 deg^2, 5.0176e-4 ft^2, 1.7591 kt^2",
    tolerance="0.5 per cent",
)
def conversions(_: Context) -> Outcome:
    """Divided by 0.674; half of the largest change within a step."""
    ours = (GPS_POSITION_DEG2, GPS_POSITION_FT2, AIR_KT2, POSITION_STEP_DEG2, POSITION_STEP_FT2, STEP_KT2)
    printed = (4.1353e-10, 55.03, 3.087e-2, 3.7704e-15, 5.0176e-4, 1.7591)
    worst = max(abs(a / b - 1.0) for a, b in zip(ours, printed, strict=True))
    text = ", ".join(f"{value:.4g}" for value in (*ours, GPS_KT2))
    return by_definition(text, worst < 5e-3 and abs(GPS_KT2 / 0.19294 - 1.0) < 5e-3, "arithmetic on printed errors")


@result(
    "ER41",
    "What the filter is good for",
    source="sections 6.2, 9.2",
    thesis="velocity just below the air data's noise, far below GPS's; position 7.4 ft to 0.60 ft",
    tolerance="0.25 to 0.30 ft/s of velocity; position by a factor of 7 at least",
)
def attenuation(context: Context) -> Outcome:
    """Velocity and position against the noise of what they are made of."""
    runs = _nav1(context)
    velocity = math.sqrt(float(np.mean([np.mean(run.velocity**2) for run in runs])))
    position = math.sqrt(float(np.mean([np.mean(run.position**2) for run in runs])))
    text = f"velocity {velocity:.3f} ft/s of 0.3 (air data) and 0.74 (GPS), position {position:.2f} ft of 7.4"
    return judged(text, 0.25 < velocity < 0.30 and position < 7.4 / 7.0)
