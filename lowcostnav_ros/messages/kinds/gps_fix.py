"""``gps/fix``: the position of a GPS receiver."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, GpsPosition
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.messages import checks, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import ANTENNA_FRAMES, WORLD_AXES, Quantity, TopicSpec, describe
from lowcostnav_ros.messages.parts import nav_sat_fix


def _decode(message: Any, received: checks.Received) -> GpsPosition:
    received.frame(message.header.frame_id)
    if math.isnan(message.altitude):  # a quiet NaN is what the message prescribes where there is none
        received.notes[f"{received.kind.name}: no altitude, horizontal position used"] += 1
        return GpsPosition(*received.head, *checks.horizontal(message), 0.0, _flat(_covariance(message, received, False)))
    place, upward = checks.geodetic(message), message.position_covariance[8]
    level = message.position_covariance_type and np.any(message.position_covariance) and not 0.0 != upward < UNKNOWN_VARIANCE
    if level and not math.isnan(upward):
        received.notes[f"{received.kind.name}: no vertical variance, horizontal position used"] += 1
        return GpsPosition(*received.head, *place, _flat(_covariance(message, received, False)))
    return GpsPosition(*received.head, *place, _covariance(message, received, True))


def _many(rows: Rows) -> tuple[Any, ...]:
    """Fixes with all three coordinates and their covariance; others are rarer."""
    degrees, height = np.stack([rows["latitude"], rows["longitude"]], axis=1), rows["altitude"]
    flat = rows["position_covariance"]
    rows.keep((rows["status.status"] >= 0) & (np.abs(degrees) <= (90.0, 180.0)).all(axis=1) & degrees.any(axis=1))
    rows.keep((height >= -1000.0) & (height <= 50_000.0))
    rows.keep((rows["position_covariance_type"] > 0) & (flat[:, 8] < UNKNOWN_VARIANCE) & ((flat[:, 8] > 0.0) | ~flat.any(axis=1)))
    place = degrees * DEGREE
    return place[:, 0], place[:, 1], height, rows.covariances(flat, "position", conv.swap_world_cov)


def _covariance(message: Any, received: checks.Received, vertical: bool) -> np.ndarray:
    """The covariance, NED, that of unknown type is not looked at; without the vertical one a unit variance stands in its place."""
    cov = None
    if message.position_covariance_type:
        stated = np.array(message.position_covariance)
        if not vertical and np.any(stated):
            stated[[2, 5, 6, 7, 8]] = 0.0, 0.0, 0.0, 0.0, 1.0
        cov = received.covariance(stated, "position")
    return received.known(cov, conv.swap_world_cov)


def _flat(cov_n: np.ndarray) -> np.ndarray:
    cov_n = cov_n.copy()
    cov_n[2, :2] = cov_n[:2, 2] = 0.0
    cov_n[2, 2] = _ANY_HEIGHT
    return cov_n


_ANY_HEIGHT = 1.0e8
"""Variance, m^2, of a height that is not measured: 10 km, so that a barometer's first height agrees with it wherever one flies."""


_ANGLE, _LENGTH = Quantity(1, "angle"), Quantity(1, "length")
describe(
    __name__,
    TopicSpec("gps/fix", topics.NAV_SAT_FIX, "Position, height above the ellipsoid, covariance ENU.", "gps", "deg, m, m^2"),
    measurement=GpsPosition,
    decode=_decode,
    encode=lambda fix: nav_sat_fix(fix.stamp_ns, fix.lat, fix.lon, fix.height, fix.cov_n, "gps"),
    frames=ANTENNA_FRAMES,
    variances=(9.0, 9.0, 25.0),
    fields={"lat": _ANGLE, "lon": _ANGLE, "height": _LENGTH, "sigma": Quantity(3, "length", True, WORLD_AXES)},
    from_row=lambda row: row.of(GpsPosition, float(row["lat"]), float(row["lon"]), float(row["height"]), row.cov()),
    sample=lambda at: at.of(GpsPosition, *at.place, 4.0 * np.eye(3)),
    sensed=True,
    many=_many,
)
