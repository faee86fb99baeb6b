"""How a sensor is mounted: rotations from its axes to those of the body, applied sample by sample."""

from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.physics.rotation import euler_to_dcm

MOUNTING = setting(
    [0.0, 0.0, 0.0],
    "Roll, pitch, yaw that turn its axes (forward, right, down as it reads them) into the body's; three more are turned by after them.",
    unit="deg",
    minimum=-360.0,
    maximum=360.0,
)
"""The setting ``mounting_deg``; in a column profile of ``convert`` the same rotations are a list of threes."""


def check_mounting(mounting_deg: Sequence[float], name: str) -> None:
    """Refuse a mounting that is not rotations of three angles each.

    Raises
    ------
    SettingsError
    """
    if not mounting_deg or len(mounting_deg) % 3:
        raise SettingsError(f"'{name}' needs three angles, roll, pitch, yaw, or several threes, got {len(mounting_deg)}.")


def mounting_dcm(mounting_deg: Sequence[float] | Sequence[Sequence[float]]) -> np.ndarray | None:
    """Rotation (3, 3) from sensor to body axes of roll, pitch, yaw triples in degrees, the first applied first; None for no turn."""
    C = np.eye(3)
    for turn in np.reshape(np.asarray(mounting_deg, dtype=float), (-1, 3)):
        C = euler_to_dcm(*np.radians(turn)) @ C
    return None if not np.any(mounting_deg) else np.where(np.abs(C) < 1e-15, 0.0, C)


def mounted(C: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Turn vectors (n, 3), column by column: a product of matrices may differ in its last bit with the number of rows."""
    x, y, z = values[:, 0], values[:, 1], values[:, 2]
    return np.stack([C[k, 0] * x + C[k, 1] * y + C[k, 2] * z for k in range(3)], axis=1)
