"""Where the fields of a message stand in its CDR bytes: a numpy structure for every type whose only variable parts are strings.

Little-endian CDR: 4 bytes of encapsulation, then the fields one after the other, each number aligned to its size as counted from behind
the encapsulation, a string as its length with the closing zero (uint32) and its characters.  So the lengths of the strings fix all places.
"""

import struct
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
