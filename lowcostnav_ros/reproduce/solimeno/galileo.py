"""A second constellation beside GPS in the INS/GPS thesis (SR48 to SR50)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from lowcostnav_ros.gnss.dop import dops, to_ned
from lowcostnav_ros.gnss.error_budget import UERE_TABLE_M, combined_error
from lowcostnav_ros.gnss.observables import line_of_sight
from lowcostnav_ros.physics.earth import geodetic_to_ecef
from lowcostnav_ros.reproduce.figures import axes, legend
from lowcostnav_ros.reproduce.registry import Context, Outcome, Reading, by_definition, fitted, read, result
from lowcostnav_ros.reproduce.solimeno.coupling import FITTED_BY, attitude_deg, consistent_row, thesis_tight
from lowcostnav_ros.reproduce.solimeno.flights import Case, Flight, epochs_of, truth_of
from lowcostnav_ros.reproduce.solimeno.gps_only import VELOCITY, draw_errors, each_3d, mean_rms, norm, root_mean_square, runs

FEW = 3
"""Seeds of the flights that only explain."""
NOISE_FACTORS = (0.1, 10.0, 100.0)
"""Multiples of the thesis-like position noise tried in the comparison of constellations."""
TYPICAL_M = 5.5
THESIS, BOTH = Case(tuning="thesis"), Case(tuning="thesis", constellation="gps_galileo")
WIDE_GPS_M, WIDE_GALILEO_M = (UERE_TABLE_M[system, "24 MHz", "typical"] for system in ("GPS", "Galileo"))
BUDGET, WIDE = replace(THESIS, gps_sigma_m=8.04), replace(BOTH, gps_sigma_m=WIDE_GPS_M, galileo_sigma_m=WIDE_GALILEO_M)
READ_RANGES = (
    ("GPS alone 5.5 m, both 8 MHz (Table 7.8, typical)", THESIS, BOTH),
    ("GPS alone 5.14 m, both 24 MHz (Table 7.8, typical)", replace(THESIS, gps_sigma_m=WIDE_GPS_M), WIDE),
    ("GPS alone 8.04 m (Table 2.1), both 8 MHz", BUDGET, BOTH),
    ("GPS alone 8.04 m (Table 2.1), both 24 MHz", BUDGET, WIDE),
)
"""What ranges are worth with GPS alone and with both, as far as the thesis says so."""
PRINTED_M = (5.27, 4.71, 11.29, 8.86, 14.85, 13.88)
DOP_GPS, DOP_BOTH = 2.70, 1.12
"""PDOP (95 %) of one and of both constellations (Table 7.7)."""


def _table_7_9(flights: Sequence[Flight]) -> np.ndarray:
    return np.array([norm(mean_rms(flights)), norm(mean_rms(flights, VELOCITY)), norm(attitude_deg(flights))])


@result(
    "SR48",
    "INS/GPS in Table 7.9",
    source="Table 7.9",
    thesis="2.98 m, 0.165 m/s, 1.80 deg (3D RMS)",
    tolerance="position 25 %, velocity not above the thesis; attitude is judged in SR29",
)
def gps_row(context: Context) -> Outcome:
    """Tight coupling, low-cost IMU, thesis's tuning."""
    ours = _table_7_9(thesis_tight(context))
    within = abs(ours[0] / 2.98 - 1.0) < 0.25 and bool(ours[1] <= 0.165)
    text, draw = f"{ours[0]:.2f} m, {ours[1]:.3f} m/s, {ours[2]:.2f} deg", partial(draw_errors, flight=thesis_tight(context)[0], first=3)
    return fitted(text, within, FITTED_BY, consistent_row(context, "crista"), figure=draw)


@result(
    "SR49",
    "INS/GPS with Galileo in Table 7.9",
    source="Table 7.9",
    thesis="1.36 m, 0.116 m/s, 1.39 deg: 54, 30 and 23 % less; recomputed position ratio 0.44",
    tolerance="ratios: position 0.356 to 0.556, velocity at most 0.85, attitude at most 1.3",
)
def galileo_row(context: Context) -> Outcome:
    """About sixteen satellites of both systems; the row for GPS alone is Table 7.3's, whose range errors are not stated."""
    both, found = thesis_tight(context, constellation="gps_galileo"), []
    for name, of_gps, of_both in READ_RANGES:
        alone, more = runs(context, of_gps), runs(context, of_both)
        ours = _table_7_9(more)
        ratio, each = ours / _table_7_9(alone), each_3d(more) / each_3d(alone)
        text = f"{norm(mean_rms(alone)):.2f} m alone; {ours[0]:.2f} m, {ours[1]:.3f} m/s, {ours[2]:.2f} deg with both; ratios "
        text += f"{ratio[0]:.3f} ({each.min():.2f} to {each.max():.2f} over {len(each)} seeds), {ratio[1]:.2f}, {ratio[2]:.2f}"
        within = bool(0.356 <= ratio[0] <= 0.556 and ratio[1] <= 0.85 and ratio[2] <= 1.3)
        found.append(Reading(name, text, within))
    epoch = single_epoch_sigma(Case(constellation="gps_galileo")) / single_epoch_sigma(Case())
    why = f"single epochs of these satellites, fixed without any filter, have a ratio of {epoch:.2f} at {TYPICAL_M:g} m, and averaging "
    why += f"cannot gain more; with other noises: {context.besides(lambda: other_ratios(context))}"
    return read(found, why, partial(draw_both, thesis_tight(context)[0], both[0]))


def single_epoch_sigma(case: Case) -> float:
    """RMS over a flight of the 3D sigma of a position fixed from one epoch alone, m."""
    truth, found = truth_of(case.dataset, case.duration_s), []
    for epoch in epochs_of(case, truth)[50::100]:
        row = int(np.searchsorted(truth.stamps_ns, epoch.stamp_ns))
        lat, lon = float(truth.lat[row]), float(truth.lon[row])
        _, los = line_of_sight(geodetic_to_ecef(lat, lon, float(truth.height[row])), epoch.sat_pos_e)
        found.append(dops(to_ned(lat, lon, los), np.diag(epoch.sigma_m**2)).pdop)
    return root_mean_square(np.array(found))


def other_ratios(context: Context) -> str:
    """Position ratios under other tunings."""
    noisier = ", ".join(f"{factor:g} {noisier_ratio(context, factor):.2f}" for factor in NOISE_FACTORS)
    return f"position noise times {noisier}, consistent tuning {consistent_ratio(context):.2f}"


def noisier_ratio(context: Context, factor: float) -> float:
    """Position error with both constellations over that with GPS alone, the thesis's position noise multiplied."""
    case = replace(THESIS, position_noise=factor)
    alone, both = (norm(mean_rms(runs(context, replace(case, constellation=name), FEW))) for name in ("gps", "gps_galileo"))
    return both / alone


def consistent_ratio(context: Context) -> float:
    """The same with consistent tuning."""
    alone, both = runs(context, Case()), runs(context, Case(constellation="gps_galileo"), FEW)
    return norm(mean_rms(both)) / norm(mean_rms(alone[:FEW]))


@result(
    "SR50",
    "Expected error with one and two constellations",
    source="equation (7-9), Tables 7.7 and 7.8",
    thesis="recomputed: both 5.27 m (8 MHz) and 4.71 m (24 MHz) typical, 11.29 and 8.86 m worst, from combined sigmas of 4.706, 4.201, "
    "10.08 and 7.914 m; GPS alone 14.85 and 13.88 m typical",
    tolerance="1e-3 m of the combined sigmas, the printed digits of the rest",
)
def expected(_: Context) -> Outcome:
    """The combination formula times PDOP."""
    kinds = [(band, kind) for kind in ("typical", "worst") for band in ("8 MHz", "24 MHz")]
    sigmas = [combined_error(UERE_TABLE_M["GPS", *k], UERE_TABLE_M["Galileo", *k], 1.0) for k in kinds]
    both = [sigma * DOP_BOTH for sigma in sigmas]
    alone = [UERE_TABLE_M["GPS", band, "typical"] * DOP_GPS for band in ("8 MHz", "24 MHz")]
    same = np.allclose(sigmas, (4.706, 4.201, 10.08, 7.914), rtol=0.0, atol=1e-3)
    within = same and np.allclose([*both, *alone], PRINTED_M, rtol=0.0, atol=0.005)
    text = ", ".join(f"{band} {kind} {m:.2f} m (sigma {s:.3f} m)" for (band, kind), m, s in zip(kinds, both, sigmas, strict=True))
    shown = f"{text}; GPS alone {alone[0]:.2f} and {alone[1]:.2f} m"
    names = [f"both, {band}, {kind}" for band, kind in kinds] + [f"GPS, {band}, {kind}" for band, kind in kinds[:2]]
    bars = dict(zip(names, [*both, *alone], strict=True))
    return by_definition(shown, bool(within), "the formula on printed numbers", partial(draw_expected, bars))


def draw_expected(bars: dict[str, float], figure: Any) -> None:
    """Expected error by constellation, bandwidth and case (Tables 7.7 and 7.8), a cross on each printed one."""
    made = axes(figure, x="expected error, 95 % PDOP [m]", y="")
    made.barh(list(bars)[::-1], list(bars.values())[::-1])
    made.plot(PRINTED_M[::-1], range(len(bars)), "kx", label="as recomputed from the thesis")
    legend(made)


def draw_both(alone: Flight, both: Flight, figure: Any) -> None:
    """Figure 7.36: position error with GPS alone and with Galileo."""
    made = axes(figure, x="time [s]", y="position error [m]", title="Tight coupling, low-cost IMU, thesis's tuning")
    for name, flight in (("GPS", alone), ("GPS and Galileo", both)):
        made.plot(flight.t_s[::10], np.linalg.norm(flight.error[::10, :3], axis=1), lw=0.8, label=name)  # a point a second
    legend(made)
