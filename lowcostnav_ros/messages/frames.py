"""Frames of a vehicle as ``/tf_static`` describes them, and how a sensor in one of them stands in ``base_link``."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lowcostnav_ros.physics.rotation import dcm_to_euler, quat_to_dcm

TF_STATIC, TF_TYPE, BASE = "tf_static", "tf2_msgs/msg/TFMessage", "base_link"
TO_FRD = np.diag([1.0, -1.0, -1.0])
"""Axes of ROS are forward, left, up; it is its own inverse."""


@dataclass(frozen=True, slots=True)
class Stand:
    """How a sensor stands: roll, pitch, yaw that turn its axes into the body's, deg, and where it is, m forward, right, down."""

    mounting_deg: tuple[float, float, float]
    lever_m: tuple[float, float, float]


@dataclass(slots=True)
class FrameTree:
    """Transforms between frames, walked either way.

    Attributes
    ----------
    beside : dict of frame to (other frame, rotation (3, 3) and shift (3,) that take coordinates of the frame to those of the other)
    """

    beside: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = field(default_factory=dict)

    def add(self, transforms: Iterable[Any]) -> None:
        """Take in ``TransformStamped`` messages; a later one about the same two frames counts, one that is no rotation does not."""
        for stamped in transforms:
            parent, child = (name.strip("/") for name in (stamped.header.frame_id, stamped.child_frame_id))
            r, t = stamped.transform.rotation, stamped.transform.translation
            q, shift = np.array([r.w, r.x, r.y, r.z]), np.array([t.x, t.y, t.z])
            norm = float(np.linalg.norm(q))
            if not (parent and child and parent != child and abs(norm - 1.0) < 0.01 and np.isfinite(shift).all()):
                continue
            turn = quat_to_dcm(q / norm)
            self.beside.setdefault(child, {})[parent] = turn, shift
            self.beside.setdefault(parent, {})[child] = turn.T, -turn.T @ shift

    def stand(self, frame: str) -> Stand | None:
        """How a sensor whose messages carry this frame id stands in ``base_link``; None where the frames do not hang together."""
        name, found = frame.strip("/"), dict[str, tuple[np.ndarray, np.ndarray]]()
        found[name], ahead = (np.eye(3), np.zeros(3)), deque([name])
        while ahead and BASE not in found:
            here = ahead.popleft()
            turn, shift = found[here]
            for other, (further, step) in self.beside.get(here, {}).items():
                if other not in found:
                    found[other] = further @ turn, further @ shift + step
                    ahead.append(other)
        if BASE not in found:
            return None
        turn, shift = found[BASE]
        angles, lever = np.degrees(dcm_to_euler(TO_FRD @ turn @ TO_FRD)), TO_FRD @ shift
        roll, pitch, yaw = (np.round(angles, 9) + 0.0).tolist()  # tidied: a quarter turn is one
        forward, right, down = (np.round(lever, 9) + 0.0).tolist()
        return Stand((roll, pitch, yaw), (forward, right, down))
