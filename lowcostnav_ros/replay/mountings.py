"""Mountings and lever arms of a recording's own ``/tf_static``, for settings that say nothing of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.frames import TF_STATIC, TF_TYPE, FrameTree, Stand
from lowcostnav_ros.messages.store import from_cdr

SETTINGS: Mapping[str, Mapping[str, str]] = {
    "imu/data_raw": {"imu.mounting_deg": "mounting_deg", "imu.lever_arm_m": "lever_m"},
    "imu/mag": {"magnetometer.mounting_deg": "mounting_deg"},
    "gps/fix": {"gps.lever_arm_b_m": "lever_m"},
}
"""Settings of the sensors behind these sources, and what of a stand each is."""


@dataclass(slots=True)
class Mountings:
    """How the sensors of a recording stand, as far as it says so.

    Attributes
    ----------
    stands : dict of source to Stand
    frames : dict of source to the frame id of its first message
    remarks : dict of str to int
        Sentences for the notes of a replay.
    """

    stands: dict[str, Stand] = field(default_factory=dict)
    frames: dict[str, tuple[str, ...]] = field(default_factory=dict)
    remarks: dict[str, int] = field(default_factory=dict)

    def adapted(self, settings: Any) -> Any:
        """Settings with the stands in place of what is left at zero; what is set stays, a recording that differs gives a remark."""
        for source, stand in self.stands.items():
            for name, part in SETTINGS[source].items():
                key, _, attribute = name.partition(".")
                group, value = getattr(settings, key, None), list(getattr(stand, part))
                given = getattr(group, attribute, None)
                if group is None or given is None or list(given) == value:
                    continue
                if any(given):
                    self.remarks[f"'{name}' {list(given)} counts, not {value} of /tf_static"] = 1
                    continue
                settings = replace(settings, **{key: replace(group, **{attribute: value})})
                self.remarks[f"'{name}' is {value} by /tf_static (frame '{self.frames[source][0]}')"] = 1
        return settings


def mountings_of(reader: BagReader) -> Mountings:
    """Read the frames of a recording, and in which of them its sensors give their vectors; nothing where it has no ``/tf_static``."""
    found = Mountings()
    if reader.types.get(TF_STATIC) != TF_TYPE:
        return found
    tree = FrameTree()
    for _, _, cdr in reader.stream([TF_STATIC]):
        try:
            tree.add(from_cdr(cdr, TF_TYPE).transforms)
        except Exception:
            found.remarks["a message of /tf_static cannot be read"] = 1
    for source in SETTINGS:
        kind = reader.decoder.rules.kind_of(source)
        first = next(reader.stream([source]), None) if source in reader.types and kind is not None else None
        try:
            frame = None if first is None else from_cdr(first[2], reader.types[source]).header.frame_id
        except Exception:
            frame = None
        stand = None if frame is None else tree.stand(frame)
        if frame is not None and stand is not None:
            found.stands[source], found.frames[source] = stand, (frame,)
        elif frame is not None and kind is not None and frame not in kind.frames:
            found.remarks[f"/tf_static does not lead from frame '{frame}' of {source} to base_link: the settings' mounting is used"] = 1
    return found
