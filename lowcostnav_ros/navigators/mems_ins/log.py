"""The table of a MEMS navigator: every signal of one solution by name, in feet, degrees and seconds as flight-test engineers plot."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.units import FOOT
from lowcostnav_ros.cores.cascade import CascadeCore
from lowcostnav_ros.navigators.mems_ins.navigator import MemsIns
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.rotation import quat_rotate, quat_to_euler

NED, BODY = ("n", "e", "d"), ("x", "y", "z")
MISSING = np.full(3, math.nan)


def row_of(navigator: MemsIns, solution: NavSolution, first_ns: int) -> dict[str, float | str]:
    """Columns of the solution that a navigator gives out now; NaN for what there is not.

    Integrated position, velocity, their sigmas; attitude; acceleration in body axes and in n; fix, its velocity and acceleration before
    and after the Butterworth filter; inertial solution; offsets and biases of both filters; mode, rates, lag, seconds that it may coast.
    """
    core, origin = navigator.core, navigator.origin
    row: dict[str, float | str] = {"t_s": 1e-9 * (solution.stamp_ns - first_ns)}
    place = difference_n(*solution.place, origin.lat, origin.lon, origin.height) if origin is not None else MISSING
    cov_pos, vel_n, q_nb = solution.cov_pos, solution.vel_n, solution.q_nb
    assert cov_pos is not None and vel_n is not None and q_nb is not None
    _add(row, "position_{}_ft", place / FOOT, NED)
    _add(row, "sigma_{}_ft", np.sqrt(cov_pos.diagonal()) / FOOT, NED)
    _add(row, "velocity_{}_fps", vel_n / FOOT, NED)
    _add(row, "{}_deg", np.degrees(quat_to_euler(q_nb)), ("roll", "pitch", "heading"))
    force_b = core.held.force_b
    _add(row, "force_{}_fps2", force_b / FOOT, BODY)
    _add(row, "force_{}_fps2", quat_rotate(core.held.q_nb, force_b) / FOOT, NED)
    _add_gps(row, core if isinstance(core, CascadeCore) else None)
    for label, (value, sigma) in (solution.states or {}).items():
        row[label], row[f"sigma_{label}"] = value, sigma
    rates, attitude = navigator.rates, navigator.settings.attitude_topic
    row |= {"gps_hz": rates.rate_hz("gps/fix"), "reference_hz": rates.rate_hz(attitude), "solutions_hz": rates.rate_hz(navigator.name)}
    return row | {"gps_lag_s": rates.lag_s, "coast_s": navigator.coast_s(), "mode": solution.mode}


def _add(row: dict[str, Any], name: str, values: np.ndarray | None, axes: tuple[str, ...]) -> None:
    row |= {name.format(axis): float(v) for axis, v in zip(axes, MISSING if values is None else values, strict=True)}


def _add_gps(row: dict[str, Any], core: CascadeCore | None) -> None:
    """Signals that only the cascade has."""
    if core is None:
        return
    gps = core.gps
    for name, values in (
        ("gps_{}_ft", None if gps is None else gps.position),
        ("gps_velocity_{}_fps", None if gps is None else gps.velocity),
        ("gps_accel_{}_fps2", None if gps is None else gps.accel),
        ("gps_accel_filtered_{}_fps2", None if gps is None else gps.filtered),
        ("ins_{}_ft", core.A[:, 0]),
        ("ins_velocity_{}_fps", core.A[:, 1]),
        ("ins_accel_{}_fps2", core.A[:, 2]),
        ("offset_{}_ft", core.position_offset()),
    ):
        _add(row, name, None if values is None else values / FOOT, NED)
    accel = core.accel_offset()
    _add(row, "accel_offset_{}_fps2", None if accel is None else accel / FOOT, BODY)
