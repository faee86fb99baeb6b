"""``pseudolite/weather``: pressure, temperature and humidity at ground stations as a point cloud, one point a station.

The fields, little-endian, 28 bytes a point: ``pressure`` float64 Pa, ``temperature`` float64 K, ``humidity`` float64 (0 to 1), ``ident``
uint8[4], the station in ASCII, zeros after it.
"""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import StationWeather
from lowcostnav_ros.messages import clouds
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import WORLD_FRAMES, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.topics import POINT_CLOUD

POINT = np.dtype([("pressure", "<f8"), ("temperature", "<f8"), ("humidity", "<f8"), ("ident", "S4")])
MOST = 200


def _encode(weather: StationWeather) -> Any:
    points = np.zeros(len(weather), POINT)
    points["pressure"], points["temperature"], points["humidity"] = weather.pressure_pa, weather.temperature_k, weather.humidity
    points["ident"] = weather.ident.astype("S4")
    return clouds.cloud_of(weather.stamp_ns, "map", points)


def _decode(message: Any, received: Received) -> StationWeather:
    """Turn a PointCloud2 message object into weather; whether it can be that of its station is judged where the station is known."""
    received.frame(message.header.frame_id)
    points = clouds.points_of(message, POINT, MOST, "stations")
    columns = points["pressure"], points["temperature"], points["humidity"]
    finite = np.isfinite(np.column_stack(columns)).all(axis=1)
    if not finite.any():
        raise Refusal("weather not finite")
    ident = np.char.upper(np.char.decode(points["ident"], "ascii", "replace"))
    return StationWeather(*received.head, ident[finite], *(column[finite] for column in columns))


describe(
    __name__,
    TopicSpec("pseudolite/weather", POINT_CLOUD, "Weather at ground stations; see messages.kinds.station_weather.", "map", "Pa, K"),
    measurement=StationWeather,
    decode=_decode,
    encode=_encode,
    frames=WORLD_FRAMES,
    sample=lambda at: at.of(StationWeather, np.array(["100"]), np.array([87500.0]), np.array([283.15]), np.array([0.3])),
    sensed=True,
)
