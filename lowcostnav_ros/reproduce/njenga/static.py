"""Captures at rest, what follows from them, and geometry (NR1 to NR6, NR19, NR20)."""

import math
from functools import partial

import numpy as np

from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.base.units import DEGREE, FOOT, STANDARD_GRAVITY
from lowcostnav_ros.calibration.reference_rest import CHANNELS, ReferenceAtRest, reference_at_rest
from lowcostnav_ros.cores.carried import sensed
from lowcostnav_ros.cores.cascade import CascadeCore, CascadeSettings, FlatFrame, cascade_blocks
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.gnss.positioning import solve
from lowcostnav_ros.physics.earth import MEAN_RADIUS
from lowcostnav_ros.physics.rotation import eulers_to_quat, quat_to_dcm, quats_to_euler
from lowcostnav_ros.physics.stochastic import GaussMarkov, simulate
from lowcostnav_ros.reproduce.njenga import drawing
from lowcostnav_ros.reproduce.njenga.flights import MEAN, NS, PLACE, STEP_S, VARIANCE, WANDER_FT, WANDER_S, frame_of, rounded
from lowcostnav_ros.reproduce.registry import Context, Outcome, Reading, by_definition, fitted, judged, read, result
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator, GnssRawSimulatorSettings

HOURS, HOUR_S = 20, 3600
SIGMA_FT = 33.0


def hour(rng: np.random.Generator, wander_ft: float) -> np.ndarray:
    """Fixes of an hour at rest through the receiver's printout, (3600, 3), ft NED."""
    frame, white = frame_of("flat"), math.sqrt(SIGMA_FT**2 - wander_ft**2)
    off = white * rng.standard_normal((HOUR_S, 3))
    if wander_ft > 0.0:
        off += simulate(GaussMarkov(wander_ft, WANDER_S), 1.0, HOUR_S, rng, wander_ft * rng.standard_normal(3))[0]
    return np.array([frame.to_ned(*rounded(frame.from_ned(FOOT * row))) for row in off]) / FOOT


def foretold() -> np.ndarray:
    """What the simulator of satellites as it ships makes of an hour of least-squares fixes: mean variances, ft^2 NED (3,)."""
    stamps, rest = NS + 10 * NS * np.arange(HOUR_S // 10), np.zeros((HOUR_S // 10, 3))
    lat, lon, height = (np.full(len(rest), value) for value in (*PLACE, 0.0))
    truth = TruthBlock(stamps, lat, lon, height, rest, np.tile([1.0, 0.0, 0.0, 0.0], (len(rest), 1)), rest, rest, rest)
    epochs = GnssRawSimulator(GnssRawSimulatorSettings(rate_hz=0.1)).simulate(truth)
    return np.mean([np.diag(solve(epoch).cov_n) for epoch in epochs], axis=0) / FOOT**2


@result(
    "NR1",
    "Variance of fixes of one hour at rest",
    source="Table 2, Figure 24",
    thesis="1089 ft^2 on each axis",
    tolerance="10 % in an hour of white errors, 30 % on the mean of hours in which they wander over 200 s",
)
def fixes_at_rest(context: Context) -> Outcome:
    """Through the receiver's steps and (1), (2)."""
    rng = context.rng("njenga.rest")
    white = np.var(hour(rng, 0.0), axis=0, ddof=1)
    hours = [hour(rng, WANDER_FT) for _ in range(4 if context.quick else HOURS)]
    each = np.array([np.var(h, axis=0, ddof=1) for h in hours])
    mean = each.mean(axis=0)
    within = bool(np.all(np.abs(white / 1089.0 - 1.0) < 0.1) and np.all(np.abs(mean / 1089.0 - 1.0) < 0.3))
    text = f"white {shown(white)}; wandering {shown(mean)} on the mean, {each.min():.0f} to {each.max():.0f} in single hours ft^2"
    untuned = f"{shown(foretold())} ft^2 north/east/down from the simulator of satellites as it ships"
    return fitted(text, within, "the sigma of the simulated receiver, 33 ft", untuned, figure=partial(drawing.scatter, ned=hours[0]))


def shown(values: np.ndarray, digits: int = 0) -> str:
    """Numbers for people."""
    return "/".join(f"{v:.{digits}f}" for v in values)


def capture(context: Context, seconds: int = HOUR_S) -> ReferenceAtRest:
    """The reference at rest, Table 3 as its errors, through attitudes as they are sent."""

    def compute() -> ReferenceAtRest:
        n, rng = round(seconds / STEP_S), context.rng("njenga.table3")
        raw = MEAN + np.sqrt(VARIANCE) * rng.standard_normal((n, 9))
        euler = quats_to_euler(eulers_to_quat(np.radians(raw[:, 0:3])))
        return reference_at_rest(np.column_stack((euler, np.radians(raw[:, 3:6]), STANDARD_GRAVITY * raw[:, 6:9])))

    return context.once("njenga.capture", compute)


UNITS = np.array([1.0 / DEGREE] * 6 + [1.0 / STANDARD_GRAVITY] * 3)


@result(
    "NR2",
    "The reference at rest",
    source="Table 3",
    thesis="means and variances of nine channels; gravity-positive accelerations (recomputed from the means)",
    tolerance="means within 3 sigma/sqrt(n), variances within 5 %, the sign told",
)
def reference(context: Context) -> Outcome:
    """Means and variances found, and the sign of the accelerometers."""
    found = capture(context)
    mean, variance = found.mean * UNITS, found.variance * UNITS**2
    off = np.abs(mean - MEAN) / np.sqrt(VARIANCE / found.samples)
    ratio = variance / VARIANCE
    within = bool(off.max() < 3.0 and np.abs(ratio - 1.0).max() < 0.05 and found.sign == "gravity_positive")
    text = f"means within {off.max():.1f} sigma/sqrt(n), variances {ratio.min():.3f} to {ratio.max():.3f} of the table; {found.sign}"
    names = ", ".join(CHANNELS)
    return fitted(text, within, f"Table 3 itself as the simulated errors of {names}", "none: the table is the input; the sign is not")


@result(
    "NR3",
    "Bias of the vertical accelerometer",
    source="Figure 4",
    thesis="0.0062 g",
    tolerance="0.0002 g",
)
def z_bias(context: Context) -> Outcome:
    """Of the simulated capture, as the figure may mean it."""
    found = capture(context)
    raw, bias = found.mean[8] / STANDARD_GRAVITY - 1.0, found.accel_bias[2] / STANDARD_GRAVITY
    values = {"mean less 1 g": raw, "gravity at its tilt taken out": bias}
    readings = [Reading(n, f"{v:.5f} g", bool(abs(v - 0.0062) <= 0.0002)) for n, v in values.items()]
    return read(readings, "with the tilt of 1.9 deg taken out the bias is 10 % larger")


def still_core(mean: np.ndarray, angles_deg: np.ndarray) -> CascadeCore:
    """The inertial solution on a sample at rest, (3,) g and (3,) deg, gravity as printed, no bias known."""
    settings = CascadeSettings(constants="thesis", initial_velocity="zero", x0_ft=0.0)
    core = CascadeCore(settings, Layout(cascade_blocks(settings)), 1.0, (0.0, 0.0), as_printed=True)
    core.start(NS, np.array([*PLACE, 0.0, 0.0, 0.0, 0.0]))
    feed(core, mean, angles_deg, NS)
    return core


def feed(core: CascadeCore, mean: np.ndarray, angles_deg: np.ndarray, stamp_ns: int) -> None:
    """Give a core one sample, gravity positive, as the navigator does."""
    q_nb = eulers_to_quat(np.radians(angles_deg)[None])[0]
    core.move(stamp_ns)
    core.hold(sensed(Attitude(stamp_ns, "imu/data", q_nb, np.eye(3), np.zeros(3), STANDARD_GRAVITY * mean), -1.0))


@result(
    "NR4",
    "The mean of Table 3 in n, less gravity",
    source="equations (7) to (11); recomputed",
    thesis="[0.0195, -0.0339, 0.2192] ft/s^2 (recomputed)",
    tolerance="0.001 ft/s^2",
)
def residual(context: Context) -> Outcome:
    """As the inertial solution integrates it."""
    accel = still_core(MEAN[6:9], MEAN[0:3]).A[:, 2] / FOOT
    return judged(f"[{', '.join(f'{a:.4f}' for a in accel)}] ft/s^2", bool(np.all(np.abs(accel - [0.0195, -0.0339, 0.2192]) < 1e-3)))


def drift(mean: np.ndarray, angles_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,), s, and positions (n, 3), ft, of the inertial solution alone over 700 s."""
    core, rows = still_core(mean, angles_deg), []
    for k in range(1, round(700.0 / STEP_S) + 1):
        feed(core, mean, angles_deg, NS + round(k * STEP_S * NS))
        rows.append(core.A[:, 0] / FOOT)
    return STEP_S * np.arange(1, len(rows) + 1), np.array(rows)


def _drifted(mean: np.ndarray, angles_deg: np.ndarray, wanted: dict[float, tuple[float, float, float]]) -> Outcome:
    t_s, rows = drift(mean, angles_deg)
    at = {t: rows[round(t / STEP_S) - 1] for t in wanted}
    within = all(np.all(np.abs(at[t] / np.array(w) - 1.0) < 0.01) for t, w in wanted.items())
    text = "; ".join(f"{t:.0f} s: {shown(v)} ft" for t, v in at.items())
    figure = partial(drawing.lines, series={n: (t_s, rows[:, k]) for k, n in enumerate(drawing.NED)}, x="time [s]", y="position [ft]")
    return judged(text, within, figure=figure)


@result(
    "NR5",
    "The inertial solution alone at rest",
    source="Figures 31 and 34; recomputed from Table 3",
    thesis="recomputed: 79/-137/888 ft after 90 s, 4777/-8307/53694 ft after 700 s, N/E/D",
    tolerance="1 %",
)
def free(context: Context) -> Outcome:
    """The dip of the inertial altitude in the first 90 s has its size and sign if gravity is taken as printed."""
    return _drifted(MEAN[6:9], MEAN[0:3], {90.0: (79.0, -137.0, 888.0), 700.0: (4777.0, -8307.0, 53694.0)})


@result(
    "NR6",
    "Table 3 taken for biases of a level unit",
    source="Table 3; recomputed",
    thesis="recomputed: 481/4344/815 ft after 90 s, 29126/262767/49298 ft after 700 s",
    tolerance="1 %",
)
def raw(context: Context) -> Outcome:
    """The means are not biases: most of y is the 1.9 deg of roll."""
    return _drifted(MEAN[6:9], np.zeros(3), {90.0: (481.0, 4344.0, 815.0), 700.0: (29126.0, 262767.0, 49298.0)})


@result("NR19", "Direction cosines", source="equations (7) to (9)", thesis="orthogonal, transpose is inverse", tolerance="1e-12")
def cosines(context: Context) -> Outcome:
    """Over random attitudes, there and back."""
    rng = context.rng("njenga.dcm")
    euler = rng.uniform([-math.pi, -1.5, -math.pi], [math.pi, 1.5, math.pi], (500, 3))
    C = np.array([quat_to_dcm(q) for q in eulers_to_quat(euler)])
    off = float(np.abs(C @ C.transpose(0, 2, 1) - np.eye(3)).max())
    v = rng.standard_normal((500, 3, 1))
    back = float(np.abs(C.transpose(0, 2, 1) @ (C @ v) - v).max())
    return by_definition(f"{max(off, back):.1e}", max(off, back) < 1e-12, "any rotation matrix is")


@result(
    "NR20",
    "Degrees to feet",
    source="equation (1), whose radius is not printed",
    thesis="recomputed: 365221 ft in a degree of latitude, 0.609 ft in 1e-4 min",
    tolerance="0.2 %",
)
def feet(context: Context) -> Outcome:
    """By the sphere of the equator, by the mean one, and by the ellipsoid at the airport."""
    degree = {
        "equator": FlatFrame(*PLACE, 0.0, sphere=True).to_ned(PLACE[0] + math.radians(1.0), PLACE[1], 0.0)[0] / FOOT,
        "mean": MEAN_RADIUS * math.radians(1.0) / FOOT,
        "ellipsoid": FlatFrame(*PLACE, 0.0, sphere=False).to_ned(PLACE[0] + math.radians(1.0), PLACE[1], 0.0)[0] / FOOT,
    }
    step = degree["equator"] * 1e-4 / 60.0
    within = abs(degree["equator"] / 365221.0 - 1.0) < 0.002 and abs(step / 0.609 - 1.0) < 0.002
    text = ", ".join(f"{name} {value:.0f} ft" for name, value in degree.items())
    return by_definition(f"{text}; {step:.4f} ft", within, "a radius that was chosen")
