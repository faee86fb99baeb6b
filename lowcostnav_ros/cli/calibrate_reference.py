"""What ``identify`` prints of receivers and attitude references at rest: variance of fixes; nine channels and the accelerometers' sign."""

import argparse
from typing import Any

import numpy as np

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.measurements import Attitude, GpsPosition
from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.units import FOOT, STANDARD_GRAVITY
from lowcostnav_ros.calibration.record import CalibrationError

FEWEST = 30
MOVED_M, MOVED_DEG = 100.0, 5.0
"""Fixes that spread, or a roll or pitch that ranges, over more are of what moves."""


def identified(arguments: argparse.Namespace) -> int | None:
    """Characterise fixes or attitudes of a bag's topic; None where the topic holds neither."""
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.messages.decode import Decoder
    from lowcostnav_ros.messages.foreign import parse_maps
    from lowcostnav_ros.messages.rules import DecodeRules

    rules, maps = DecodeRules(everywhere=tuple(arguments.frame)), parse_maps(arguments.map)
    with BagReader(arguments.source, Decoder(rules), maps) as reader:
        samples: list[Any] = list(reader.measurements([arguments.topic]))
    if not samples or not isinstance(samples[0], GpsPosition | Attitude):
        return None
    if len(samples) < FEWEST:
        raise CalibrationError(f"{arguments.topic} holds {len(samples)} messages; a variance takes {FEWEST} at least.")
    return fixes(samples) if isinstance(samples[0], GpsPosition) else reference(samples)


def fixes(samples: list[GpsPosition]) -> int:
    """Variance of fixes about their mean, and what the receiver states."""
    from lowcostnav_ros.physics.earth import difference_n
    from lowcostnav_ros.report.terminal import print_report

    first = samples[0]
    ned = np.array([difference_n(f.lat, f.lon, f.height, first.lat, first.lon, first.height) for f in samples])
    spread = float(np.ptp(ned[:, :2], axis=0).max())
    if spread > MOVED_M:
        raise CalibrationError(f"The fixes range over {spread:.0f} m: not at rest; take a stretch at rest.")
    variance, stated = np.var(ned, axis=0, ddof=1), np.mean([f.cov_n.diagonal() for f in samples], axis=0)
    values = zip(("north", "east", "down"), variance, stated, strict=True)
    rows = [(n, f"{v:.4g}", f"{v / FOOT**2:.4g}", f"{v**0.5:.3g}", f"{s**0.5:.3g}") for n, v, s in values]
    heads = "axis", "variance [m^2]", "variance [ft^2]", "sigma [m]", "stated sigma [m]"
    minutes = 1e-9 * (samples[-1].stamp_ns - first.stamp_ns) / 60.0
    print_report("", [Table.plain("", heads, rows)], [f"{len(samples)} fixes in {minutes:.1f} min; errors that last longer do not show"])
    return Exit.OK


def reference(samples: list[Attitude]) -> int:
    """Nine channels at rest, the sign of the accelerometers, and their biases once gravity is taken out."""
    from lowcostnav_ros.calibration.reference_rest import CHANNELS, reference_at_rest
    from lowcostnav_ros.cli.calibrate_rest import STILL_MG
    from lowcostnav_ros.physics.rotation import quats_to_euler
    from lowcostnav_ros.report.terminal import print_report

    euler = quats_to_euler(np.array([a.q_nb for a in samples]))
    moved = float(np.degrees(np.ptp(np.quantile(euler[:, :2], [0.02, 0.98], axis=0), axis=0)).max())
    if moved > MOVED_DEG:
        raise CalibrationError(f"Roll or pitch ranges over {moved:.1f} deg: not at rest; take a stretch at rest.")
    values = [(a.angular_rate_b, a.specific_force_b) for a in samples]
    found = reference_at_rest(np.column_stack((euler, [w for w, _ in values], [f for _, f in values])))
    unit = np.array([180.0 / np.pi] * 6 + [1.0 / STANDARD_GRAVITY] * 3)
    units = ("deg",) * 3 + ("deg/s",) * 3 + ("g",) * 3
    bias = (*[""] * 6, *(f"{1e3 * b / STANDARD_GRAVITY:.2f} mg" for b in found.accel_bias))
    columns = zip(CHANNELS, units, found.mean * unit, found.variance * unit**2, bias, strict=True)
    rows = [(n, u, f"{m:.6g}", f"{v:.4g}", f"{v**0.5:.4g}", b) for n, u, m, v, b in columns]
    heads = "channel", "unit", "mean", "variance", "sigma", "bias, gravity out"
    words = {"": "accelerations tell no sign", "specific_force": "accelerations are specific force, -1 g on the down axis at rest"}
    words["gravity_positive"] = "accelerations count gravity positive, +1 g on the down axis at rest"
    notes = [f"{found.samples} samples; {words[found.sign]}", "a bias contains what the errors of roll and pitch make of gravity"]
    print_report("", [Table.plain("", heads, rows)], notes)
    wrong = not found.sign or float(np.abs(found.accel_bias).max()) > STILL_MG * 1e-3 * STANDARD_GRAVITY
    return Exit.WORSE if wrong else Exit.OK
