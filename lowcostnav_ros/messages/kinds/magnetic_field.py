"""``imu/mag``: the magnetic field."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import MagneticField
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import BODY_AXES, BODY_FRAMES, Quantity, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.samples import TableRow


def _decode(message: Any, received: checks.Received) -> MagneticField:
    received.frame(message.header.frame_id)
    field = checks.xyz(message.magnetic_field)
    checks.finite(field, "magnetic field")
    _refuse_wrong_unit(math.hypot(*field), received.rules.mag_range)
    cov = received.known(received.covariance(message.magnetic_field_covariance, "magnetic field"), conv.swap_body_cov)
    return MagneticField(*received.head, conv.swap_body(np.array(field)), cov)


def _many(rows: Rows) -> tuple[Any, ...]:
    field, (low, high) = rows.parts("magnetic_field"), rows.received.rules.mag_range
    norm, margin = np.sqrt((field * field).sum(axis=1)), 1e-9  # nearer to a limit the careful decoder decides
    rows.keep((low * (1.0 + margin) <= norm) & (norm <= high * (1.0 - margin)))
    return conv.swap_body(field), rows.covariances(rows["magnetic_field_covariance"], "magnetic field", conv.swap_body_cov)


def _refuse_wrong_unit(norm: float, allowed: tuple[float, float]) -> None:
    low, high = allowed
    if low <= norm <= high:
        return
    for unit, factor in (("gauss", 1e-4), ("microtesla", 1e-6), ("milligauss", 1e-7), ("nanotesla", 1e-9)):
        if low <= norm * factor <= high:
            raise Refusal(f"magnetic field implausible, {unit} instead of tesla?", f"{norm:g}")
    raise Refusal("magnetic field implausible", f"{norm:g} T")


def _encode(field: MagneticField) -> Any:
    cov = np.ravel(conv.swap_body_cov(field.cov_b))
    return parts.TYPES[topics.MAGNETIC_FIELD](parts.header(field.stamp_ns, "imu_link"), parts.flu(field.field_b), cov)


def _numbers(rows: TableRow) -> dict[str, np.ndarray]:
    return {"magnetic_field": conv.swap_body(rows.mounted("field")), "magnetic_field_covariance": conv.swap_body_covs(rows.covs())}


describe(
    __name__,
    TopicSpec("imu/mag", topics.MAGNETIC_FIELD, "Magnetic field.", "imu_link", "T"),
    measurement=MagneticField,
    decode=_decode,
    encode=_encode,
    frames=BODY_FRAMES | {"mag_link"},
    variances=(2.5e-13, 2.5e-13, 2.5e-13),  # 5 mG
    fields={"field": Quantity(3, "magnetic field", True, BODY_AXES), "sigma": Quantity(3, "magnetic field")},
    options=("mounting_deg",),
    numbers=_numbers,
    from_row=lambda row: row.of(MagneticField, row.mounted("field"), row.cov()),
    sample=lambda at: at.of(MagneticField, np.array([2.2e-5, 0.5e-5, 4.2e-5]), 1e-14 * np.eye(3)),
    sensed=True,
    many=_many,
)
