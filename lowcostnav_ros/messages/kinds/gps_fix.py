"""``gps/fix``: the position of a GPS receiver."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition
from lowcostnav_ros.messages import checks, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.kind import ANTENNA_FRAMES, WORLD_AXES, Quantity, TopicSpec, describe
from lowcostnav_ros.messages.parts import nav_sat_fix


def _decode(message: Any, received: checks.Received) -> GpsPosition:
    received.frame(message.header.frame_id)
    place = checks.geodetic(message)
    cov = received.covariance(message.position_covariance, "position")
    return GpsPosition(*received.head, *place, received.known(cov if message.position_covariance_type else None, conv.swap_world_cov))


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
)
