"""Tables as PointCloud2 messages: named columns, one point a row, wherever in the point the sender put them."""

from typing import Any

import numpy as np

from lowcostnav_ros.messages.parts import TYPES, header
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.topics import POINT_CLOUD

_FIELD_TYPES = {"f": 8, "u": 2, "S": 2}
"""sensor_msgs/PointField of float64, uint8 and, several of them, text in ASCII."""


def cloud_of(stamp_ns: int, frame: str, points: np.ndarray) -> Any:
    """Build the PointCloud2 message of a table (n,) of float64, uint8 and short texts."""
    form, Field, offset, fields = points.dtype, TYPES["sensor_msgs/msg/PointField"], 0, []
    for name in form.names or ():
        part = form[name]
        fields.append(Field(name, offset, _FIELD_TYPES[part.kind], part.itemsize if part.kind == "S" else 1))
        offset += part.itemsize
    data = np.frombuffer(points.tobytes(), np.uint8)
    return TYPES[POINT_CLOUD](header(stamp_ns, frame), 1, len(points), fields, False, form.itemsize, len(data), data, True)


def points_of(message: Any, form: np.dtype, most: int, rows: str) -> np.ndarray:
    """Data of a cloud as a table of the columns of ``form``; at most ``most`` of what ``rows`` calls the points.

    Raises
    ------
    Refusal
        For too many or no points, a missing field, one of another type, or a length that does not fit.
    """
    count = message.width * message.height
    if count == 0 or count > most:
        raise Refusal(f"number of {rows} implausible", f"{count}")
    if message.is_bigendian:
        raise Refusal("big-endian clouds are not read")
    given, offsets = {field.name: field for field in message.fields}, []
    for name in form.names or ():
        field, part = given.get(name), form[name]
        if field is None:
            raise Refusal("a field is missing", f"'{name}'")
        length = part.itemsize if part.kind == "S" else 1
        if field.datatype != _FIELD_TYPES[part.kind] or field.count != length or field.offset + part.itemsize > message.point_step:
            raise Refusal("a field has the wrong type or place", f"'{name}'")
        offsets.append(field.offset)
    if len(message.data) != count * message.point_step:
        raise Refusal("length of the data does not fit", f"{len(message.data)} bytes")
    forms: list[Any] = [form[name] for name in form.names or ()]
    layout = np.dtype({"names": list(form.names or ()), "formats": forms, "offsets": offsets, "itemsize": message.point_step})
    return np.frombuffer(bytes(message.data), layout)
