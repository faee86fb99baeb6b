"""Where the fields of a message stand in its CDR bytes: a numpy structure for every type whose only variable parts are strings.

Little-endian CDR: 4 bytes of encapsulation, then the fields one after the other, each number aligned to its size as counted from behind
the encapsulation, a string as its length with the closing zero (uint32) and its characters.  So the lengths of the strings fix all places.
"""

import struct
from collections.abc import Mapping
from functools import cache
from itertools import count
from typing import Any, cast

import numpy as np
from rosbags.interfaces import Nodetype

from lowcostnav_ros.messages.store import STORE

ENCAPSULATION, PADDING = 4, 3
SIZE = ".size"
"""Follows the name of a string in the field that holds its length."""
_HEAD = b"\x00\x01"
_NUMBERS = dict.fromkeys(("bool", "byte", "octet", "char"), "u1") | {"float32": "<f4", "float64": "<f8"}
_NUMBERS |= {f"{kind}{bits}": f"<{kind[0]}{bits // 8}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)}
_LENGTH, _LONGEST = struct.Struct("<I"), 200


class _Variable(Exception):
    """A type holds something of a variable size that is no string."""


@cache
def _flat(msgtype: str, prefix: str = "") -> tuple[tuple[str, str, int], ...]:
    """Fields of a type in order: dotted name, numpy type ('' for a string), number of elements (0 for a single one)."""
    fields: list[tuple[str, str, int]] = []
    for name, described in STORE.fielddefs[msgtype][1]:
        node, of = cast("tuple[Nodetype, Any]", described)
        length = 0
        if node == Nodetype.ARRAY:
            (node, of), length = of
        if node == Nodetype.NAME and not length:
            fields += _flat(of, f"{prefix}{name}.")
        elif node == Nodetype.BASE and (of[0] in _NUMBERS or (of[0] == "string" and not length)):
            fields.append((prefix + name, _NUMBERS.get(of[0], ""), length))
        else:
            raise _Variable
    return tuple(fields)


@cache
def _placed(msgtype: str, lengths: tuple[int, ...]) -> tuple[np.dtype, int]:
    """Structure of messages whose first strings have these lengths, as far as they reach, and where it ends."""
    names, formats, offsets, at, strings = [], [], [], 0, iter(lengths)
    for name, number, elements in _flat(msgtype):
        kind = np.dtype(number or "<u4")
        at = -(-at // kind.itemsize) * kind.itemsize
        names.append(name if number else name + SIZE)
        formats.append(np.dtype((kind, elements)) if elements else kind)
        offsets.append(ENCAPSULATION + at)
        at += formats[-1].itemsize
        if not number:
            length = next(strings, None)
            if length is None:
                break
            names.append(name)
            formats.append(np.dtype(f"V{max(length, 1)}"))
            offsets.append(ENCAPSULATION + at)
            at += length
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": ENCAPSULATION + at}), ENCAPSULATION + at


def layout_of(msgtype: str, raw: bytes | memoryview) -> np.dtype | None:
    """Return the structure of messages like one of its bytes; None where they have to be parsed one by one."""
    lengths: tuple[int, ...] = ()
    try:
        strings = sum(not number for _, number, _ in _flat(msgtype))
        for _ in count():
            dtype, end = _placed(msgtype, lengths)
            if len(raw) < end or bytes(raw[:2]) != _HEAD:
                return None
            if len(lengths) == strings:
                return dtype if len(raw) - end <= PADDING else None
            (length,) = _LENGTH.unpack_from(raw, end - _LENGTH.size)
            if not 0 < length < _LONGEST:
                return None
            lengths += (length,)
    except (_Variable, KeyError):
        pass
    return None


def messages_like(raw: bytes, msgtype: str, stamps_ns: np.ndarray, numbers: Mapping[str, np.ndarray]) -> list[bytes]:
    """Return the CDR bytes of messages that differ from one in their stamps and in some numbers alone, made in columns.

    Parameters
    ----------
    raw : bytes
        Of the one, as :func:`~lowcostnav_ros.messages.store.to_cdr` writes it.
    msgtype : str
    stamps_ns : ndarray of int64, shape (n,)
    numbers : mapping of dotted field to ndarray
        Shape (n,), (n, elements), or of a vector (n, 3), of a quaternion (n, 4).
    """
    dtype, size = layout_of(msgtype, raw), len(raw)
    assert dtype is not None, f"{msgtype} has no fixed layout"
    flat = np.frombuffer(bytearray(raw) * len(stamps_ns), np.uint8)
    table = np.ndarray((len(stamps_ns),), dtype, flat, strides=(size,))
    table["header.stamp.sec"], table["header.stamp.nanosec"] = np.divmod(stamps_ns, 1_000_000_000)
    for name, values in numbers.items():
        if name in (dtype.names or ()):
            table[name] = values
            continue
        for part, column in zip("xyzw", values.T, strict=False):
            table[f"{name}.{part}"] = column
    data = flat.tobytes()
    return [data[k : k + size] for k in range(0, len(data), size)]
