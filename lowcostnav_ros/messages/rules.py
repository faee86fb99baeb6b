"""What the decoder accepts: frames, plausible ranges, variances where a message states none; and what a refusal looks like."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from lowcostnav_ros.physics.earth import LocalFrame

_BODY = frozenset({"base_link", "imu_link"})
_ANTENNA = frozenset({"gps", "gps_link", "gnss", "antenna", "base_link", "map"})
_WORLD = frozenset({"map", "odom"})

DEFAULT_FRAMES: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "imu/data_raw": _BODY,
        "imu/data": _BODY,
        "imu/data_fused": _BODY,
        "imu/mag": _BODY | {"mag_link"},
        "gps/attitude": frozenset({"base_link"}),
        "gps/fix": _ANTENNA,
        "gps/vel": frozenset({"gps", "gps_link", "gnss", "antenna", "map"}),  # base_link would mean body axes
        "gnss/raw": _ANTENNA,
        "air/static_pressure": _BODY | {"air_data"},
        "air/dynamic_pressure": _BODY | {"air_data"},
        "air/temperature": _BODY | {"air_data"},
        "air/velocity": frozenset({"base_link"}),
        "truth/imu": _BODY,
        "odometry": _WORLD,
        "fix": _ANTENNA,
        "wind": _WORLD,
    }
)
"""Accepted ``frame_id`` by source, or by the last part of a navigator's topic; a prefix such as ``uav1/`` is ignored."""

DEFAULT_VARIANCES: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "imu/data": (3.0e-4, 3.0e-4, 1.2e-3),  # 1 deg roll and pitch, 2 deg heading
        "imu/data_fused": (3.0e-4, 3.0e-4, 1.2e-3),
        "imu/mag": (2.5e-13, 2.5e-13, 2.5e-13),  # 5 mG
        "gps/attitude": (7.6e-5, 7.6e-5, 7.6e-5),  # 0.5 deg
        "gps/fix": (9.0, 9.0, 25.0),
        "gps/vel": (0.04, 0.04, 0.09),
        "air/static_pressure": (400.0,),
        "air/dynamic_pressure": (100.0,),
        "air/temperature": (4.0,),
        "air/velocity": (4.0, 1.0e6, 1.0e6),
        "dme/range": (1.0e5,),  # 0.17 NM
        "vor/bearing": (3.0e-4,),  # 1 deg
    }
)
"""Variances used where the covariance is all zeros, which means unknown: NED or FRD order, SI."""


@dataclass(frozen=True, slots=True)
class DecodeRules:
    """What to accept and what to assume.

    Attributes
    ----------
    frames : mapping of source to accepted frame ids; a source that is missing accepts any.
    default_variances : mapping of source to variances (NED/FRD order, SI) for a covariance of all zeros; missing means refuse.
    origins : dict of navigator name to the :class:`LocalFrame` its odometry is expressed in; a :class:`Decoder`
        fills it as ``<navigator>/origin`` arrives.
    max_angular_rate, max_specific_force : float
        rad/s and m/s^2; more than this is a unit error, not an aircraft.
    mag_range : (float, float)
        Tesla; the earth's field is 0.2e-4 to 0.7e-4, the margin leaves room for an uncalibrated hard iron.
    max_range_m : float
        Slant range that no station serves.
    """

    frames: Mapping[str, frozenset[str]] = field(default_factory=lambda: DEFAULT_FRAMES)
    default_variances: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: DEFAULT_VARIANCES)
    origins: dict[str, LocalFrame] = field(default_factory=dict)
    max_angular_rate: float = 35.0
    max_specific_force: float = 1000.0
    mag_range: tuple[float, float] = (0.1e-4, 1.4e-4)
    max_range_m: float = 600.0e3


@dataclass(frozen=True, slots=True)
class Rejected:
    """A message that is not used: ``reason`` is a fixed phrase to count by, ``detail`` holds the offending value."""

    source: str
    reason: str
    detail: str = ""
    stamp_ns: int = 0


class Refusal(Exception):
    """Raised between the checks and :func:`decode`, which turns it into a :class:`Rejected`; never leaves this package."""

    def __init__(self, reason: str, detail: object = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.detail = str(detail)
