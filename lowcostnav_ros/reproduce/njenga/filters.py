"""The two filters and the filtered GPS accelerations by themselves (NR7 to NR9, NR14 to NR17)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, Measurement
from lowcostnav_ros.base.units import FOOT, STANDARD_GRAVITY
from lowcostnav_ros.cores.cascade import CascadeCore, Differences, LowPass
from lowcostnav_ros.navigators.mems_ins.navigator import MemsIns
from lowcostnav_ros.reproduce.njenga import drawing
from lowcostnav_ros.reproduce.njenga.flights import LEAST_MIN, NS, PLACE, SPEED, Case, Flown, changed, fly, frame_of, settings_of
from lowcostnav_ros.reproduce.registry import Context, Outcome, Reading, judged, read, result

R = 1089.0
GAINS = {
    1: (0.998912184, 0.998912184, 0.998912184, 0.998912184, 0.998912184, 0.998912185),
    2: (0.499727898, 0.499727898, 0.499728358, 0.499729966, 0.499729966, 0.499950837),
    10: (0.099989111, 0.099989111, 0.099994346, 0.100012666, 0.100012666, 0.102512021),
    100: (0.009999891, 0.009999891, 0.010060120, 0.010269752, 0.010269752, 0.029563298),
    700: (0.001428571, 0.001428569, 0.001832492, 0.002975274, 0.002975274, 0.029410448),
}
"""K of (28) with the printed R, Q and P_0: acceleration x, y, z, position x, y, z; worked out apart from this package."""
STEADY = (2.875e-6, 9.09e-8, 1.3543e-3, 2.8707e-3, 2.8707e-3, 2.94104e-2)
SEEDS = 3


@dataclass(slots=True, eq=False)
class Filtered:
    """Both filters over steps, feet: biases before and after (n, 6), gains (n, 6), offsets (n, 6)."""

    before: np.ndarray
    after: np.ndarray
    gains: np.ndarray
    z: np.ndarray


def stepped(offset: Callable[[int], np.ndarray], steps: int) -> Filtered:
    """The navigator's own filters, started at rest, on offsets (6,), ft, that are given."""
    navigator, still = MemsIns(settings_of(Case())), np.array([1.0, 0.0, 0.0, 0.0])
    for stamp in range(NS, 2 * NS, NS // 20):
        navigator.feed(GpsVelocity(stamp, "gps/vel", np.zeros(3), np.eye(3)))
        if stamp == NS + NS // 10:
            navigator.feed(GpsPosition(stamp, "gps/fix", *PLACE, 0.0, np.eye(3)))
        y = np.array([0.0, 0.0, STANDARD_GRAVITY])
        navigator.feed(Attitude(stamp, "imu/data_fused", still, 1e-4 * np.eye(3), np.zeros(3), y))
        if navigator.core.started:
            break
    core = navigator.core
    assert isinstance(core, CascadeCore) and core.started
    rows: list[tuple] = []
    now = [np.zeros(6)]
    for name, part in (("accel_offset", slice(0, 3)), ("position_offset", slice(3, 6))):
        setattr(core, name, lambda part=part: now[0][part] * FOOT)
    core.is_stale = lambda t_ns: False  # type: ignore[method-assign]
    core.estimate[:], core.P[:] = core.settings.x0_ft * FOOT, core.layout.initial_covariance()
    for k in range(1, steps + 1):
        now[0] = offset(k)
        before = core.estimate / FOOT
        navigator.step(Measurement(stamp + k * NS, "imu/data_fused"))
        rows.append((before, core.estimate / FOOT, core.P.diagonal() / FOOT**2 / R, now[0].copy()))
    return Filtered(*(np.array([row[k] for row in rows]) for k in range(4)))


@result(
    "NR7",
    "Gains of both filters",
    source="equations (27) to (29), Tables 4 to 6; recomputed",
    thesis="recomputed: K of six channels after 1, 2, 10, 100, 700 steps, and their limits",
    tolerance="1e-6 of a gain; the limits of position within 1e-6",
)
def gains(context: Context) -> Outcome:
    """By the covariance of the navigator's own filters."""
    K = stepped(lambda k: np.zeros(6), 3000).gains
    off = max(float(np.abs(K[k - 1] - row).max()) for k, row in GAINS.items())
    limits = K[-1, 3:]
    within = off < 1e-6 and bool(np.all(np.abs(limits - STEADY[3:]) < 1e-6))
    steps = np.arange(1, len(K) + 1)
    names = {"acceleration x, y": 0, "acceleration z": 2, "position x, y": 3, "position z": 5}
    figure = partial(drawing.lines, series={n: (steps, K[:, c]) for n, c in names.items()}, x="step", y="K", log=True)
    return judged(f"largest difference {off:.1e}; limits of position {limits[0]:.7f} and {limits[2]:.7f}", within, figure=figure)


@result(
    "NR8",
    "The acceleration filter on a constant",
    source="equations (30) to (35); recomputed",
    thesis="recomputed: x and y are the running mean, the first state weighing 1.556e-6 after 700 steps",
    tolerance="1e-8",
)
def constant(context: Context) -> Outcome:
    """Offset 0.7 ft/s^2, first state 1."""
    found = stepped(lambda k: np.full(6, 0.7), 700).after
    deviation = found[-1, :2] - 0.7
    within = bool(np.all(np.abs(deviation - 0.3 * 1.556e-6) < 1e-8))
    text = f"x and y off the mean by {deviation[0]:.4e} and {deviation[1]:.4e}, predicted {0.3 * 1.556e-6:.4e} ft/s^2"
    series = {n: (np.arange(1, 701), np.abs(found[:, c] - 0.7)) for n, c in (("x", 0), ("z", 2))}
    return judged(text, within, figure=partial(drawing.lines, series=series, x="step", y="off the constant [ft/s^2]", log=True))


@result(
    "NR9",
    "GPS accelerations through the Butterworth filter",
    source="Figure 25, whose corner is not printed",
    thesis="recomputed for 33 ft of white noise at 1 Hz: 81 ft/s^2 raw; 3.3 at 0.1 Hz, 0.64 at 0.05 Hz, 15.1 at 0.2 Hz",
    tolerance="10 %",
)
def low_pass(context: Context) -> Outcome:
    """Positions differentiated twice."""
    rng, n = context.rng("njenga.butterworth"), 4000 if context.quick else 40_000
    positions, corners = 33.0 * rng.standard_normal((n, 3)), {0.1: 3.3, 0.05: 0.64, 0.2: 15.1}
    shown: dict[str, np.ndarray] = {}
    found, raw = {}, 0.0
    for corner in corners:
        differences, rows = Differences(LowPass(corner, 1.0), positions[0]), []
        for place in positions[1:]:
            differences.take(place, 1.0)
            if differences.accel is not None and differences.filtered is not None:
                rows.append((differences.accel, differences.filtered))
        accel, filtered = (np.array([row[k] for row in rows]) for k in (0, 1))
        raw, found[corner] = float(accel.std()), float(filtered[100:].std())
        shown = shown or {"raw": accel[:800, 0]}
        shown[f"{corner:g} Hz"] = filtered[:800, 0]
    within = abs(raw / (math.sqrt(6.0) * 33.0) - 1.0) < 0.1 and all(abs(found[c] / w - 1.0) < 0.1 for c, w in corners.items())
    series = {name: (np.arange(len(v)), v) for name, v in shown.items()}
    text = f"raw {raw:.1f}; " + ", ".join(f"{c:g} Hz {v:.2f}" for c, v in found.items()) + " ft/s^2"
    return judged(text, within, figure=partial(drawing.lines, series=series, x="time [s]", y="acceleration [ft/s^2]"))


def settled(error: np.ndarray, share: float = 0.05) -> int:
    """Step from which a curve stays below a share of its first value."""
    above = np.flatnonzero(np.abs(error) > share * abs(error[0]))
    return int(above[-1]) + 1 if len(above) else 0


@result(
    "NR14",
    "Settling of the predicted state",
    source="chapter 4",
    thesis="the first 90 s are perturbed",
    tolerance="60 to 120 s",
)
def settling(context: Context) -> Outcome:
    """A step of the offset of height in the settled filter, to 5 % of it, at both rates that the thesis may have used."""
    found = stepped(lambda k: np.full(6, 0.0 if k <= 1000 else 100.0), 1400)
    steps = settled(100.0 - found.after[1000:, 5])
    readings = [Reading(f"filters at {hz} Hz", f"{steps / hz:.0f} s", 60.0 <= steps / hz <= 120.0) for hz in (1, 20)]
    series = {"offset": (np.arange(400), found.z[1000:, 5]), "bias": (np.arange(400), found.after[1000:, 5])}
    return read(readings, "the flights below need 20 Hz", partial(drawing.lines, series=series, x="step", y="height [ft]"))


def quantised(step_deg: float) -> tuple[np.ndarray, float]:
    """Accelerations north (n,), ft/s^2, of 700 s of straight flight whose latitude comes in steps; and the step in feet."""
    frame, step = frame_of("flat"), math.radians(step_deg)
    accel, differences = [], None
    for k in range(700):
        lat = round((PLACE[0] + k * SPEED * FOOT / frame.scale[0]) / step) * step
        place = frame.to_ned(lat, PLACE[1], 0.0) / FOOT
        if differences is None:
            differences = Differences(LowPass(0.0, 1.0), place)
            continue
        differences.take(place, 1.0)
        if differences.accel is not None:
            accel.append(differences.accel[0])
    return np.array(accel), step * frame.scale[0] / FOOT


@result(
    "NR15",
    "Spikes of the acceleration error",
    source="Figure 27; recomputed",
    thesis="large spikes from the steps of GPS: recomputed 0.61 ft/s^2 for 1e-4 min, 62.7 ft/s^2 for the coarse word of ARINC 429",
    tolerance="every acceleration a whole number of steps over dt^2, two at most, to a thousandth; some epochs without",
)
def spikes(context: Context) -> Outcome:
    """Straight flight at an even speed has no acceleration: what shows is the steps."""
    words, within, series = [], True, {}
    for name, degrees, wanted in (("1e-4 min", LEAST_MIN / 60.0, 0.61), ("ARINC word", 180.0 / 2**20, 62.7)):
        accel, step = quantised(degrees)
        steps = accel / step
        size, whole = np.abs(steps), float(np.abs(steps - np.round(steps)).max())
        spiky = float(np.mean(size > 0.5))
        within &= bool(whole < 1e-3 and 0.5 < size.max() < 2.5 and spiky < 0.95 and abs(step / wanted - 1.0) < 0.01)
        words.append(f"{name}: {step:.3f} ft/s^2 in {100 * spiky:.0f} % of the epochs, none in the others")
        series[name] = np.arange(len(accel))[:120], accel[:120]
    return judged("; ".join(words), bool(within), figure=partial(drawing.lines, series=series, x="time [s]", y="acceleration [ft/s^2]"))


def printed(context: Context, **changes: object) -> list[Flown]:
    """Flights with the printed filters, once in a run."""
    seeds = context.seeds("njenga", 1 if context.quick else SEEDS)
    cases = [changed(Case(seed=seed), **changes) for seed in seeds]
    return context.once(f"njenga.{sorted(changes.items())}", lambda: context.run(fly, cases))


@result(
    "NR16",
    "The estimated bias of acceleration",
    source="Figure 28",
    thesis="slowly varying, nearly constant",
    tolerance="scatter after 200 s below 1 % of that of the offset that is filtered, or of the one before the Butterworth filter",
)
def bias(context: Context) -> Outcome:
    """x, over the flights with the printed filters."""
    ratios: dict[str, list[float]] = {"offset from filtered GPS": [], "offset from raw GPS": []}
    flights, raw = printed(context), printed(context, cascade__cutoff_hz=0.0)
    for name, flown in zip(ratios, (flights, raw), strict=True):
        for f in flown:
            late = f.fix_s > 200.0
            ratios[name].append(float(f.b_accel[late, 0].std() / np.nanstd(f.z_accel[late, 0])))
    readings = [Reading(n, f"{100 * np.mean(v):.2f} %", bool(np.mean(v) < 0.01)) for n, v in ratios.items()]
    f = raw[0]
    series = {"offset": (f.fix_s, f.z_accel[:, 0]), "bias": (f.fix_s, f.b_accel[:, 0])}
    return read(readings, figure=partial(drawing.lines, series=series, x="time [s]", y="x [ft/s^2]"))


@result(
    "NR17",
    "The position filter follows the mean of the offset",
    source="Figures 29 and 30; recomputed",
    thesis="recomputed: steps of K times the innovation, K to 0.00287 and 0.0294; behind a ramp by 347.35 and 33.00 ft per ft a step",
    tolerance="0.1 % of the lags, 1e-6 of the steps",
)
def follows(context: Context) -> Outcome:
    """A ramp of a foot a step for 6000 steps."""
    found = stepped(lambda k: np.full(6, float(k)), 6000)
    lag = found.z[-1, [3, 5]] - found.after[-1, [3, 5]]
    moved, predicted = found.after - found.before, found.gains * (found.z - found.before)
    off = float(np.abs(moved - predicted)[:, 3:].max() / np.abs(moved[:, 3:]).max())
    within = bool(np.all(np.abs(lag / [347.35, 33.00] - 1.0) < 1e-3)) and off < 1e-6
    f = printed(context)[0]
    figure = partial(drawing.panels, x=f.fix_s, columns={"offset": f.z_position, "bias": f.b_position}, y="[ft]")
    return judged(f"lags {lag[0]:.2f} and {lag[1]:.2f} ft; steps off K times innovation by {off:.0e}", within, figure=figure)
