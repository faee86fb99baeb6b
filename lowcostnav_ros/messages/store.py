"""The one table of message types, and serialisation that writes the same bytes for the same values."""

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


def full_type(msgtype: str) -> str:
    """Return ``package/msg/Name`` for either way of writing a message type."""
    parts = msgtype.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else msgtype


def to_cdr(message: Any) -> bytes:
    """Return a message object as little-endian CDR bytes, deterministic (padding is zero)."""
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def from_cdr(raw: bytes | memoryview, msgtype: str) -> Any:
    """Return the message object of CDR bytes; raises whatever a malformed buffer makes the parser raise."""
    return STORE.deserialize_cdr(raw, full_type(msgtype))


def register_type(msgtype: str, definition: str) -> type:
    """Add a message type that ROS 2 itself does not have, by the text of its .msg file; return the class of its message objects."""
    if full_type(msgtype) not in STORE.types:
        STORE.register(get_types_from_msg(definition, full_type(msgtype)))
    return STORE.types[full_type(msgtype)]
