"""Typed results to plain values, fit for JSON, and back: the attributes of a dataclass are the keys, in order.

The metadata of a field changes what is written: ``omitted`` where it is None, ``hidden`` always, ``flat`` with its own keys beside the
others, ``names`` as the first or the second of two by the attribute ``against_truth``.
"""

import dataclasses
import math
import types
from collections.abc import Mapping
from typing import Any, Union, get_args, get_origin, get_type_hints


def omitted() -> Any:
    """A field that is None until it is set, and not written then."""
    return dataclasses.field(default=None, metadata={"omitted": True})


def empty() -> Any:
    """A field that is an empty mapping until it is set."""
    return dataclasses.field(default_factory=dict)


def plain(value: Any) -> Any:
    """Turn a dataclass, or what is made of them, into plain values."""
    if not hasattr(value, "__dataclass_fields__"):
        if isinstance(value, Mapping):
            return {key: plain(item) for key, item in value.items()}
        if isinstance(value, float) and not math.isfinite(value):
            return None  # a sum that ran over: no number, and none that JSON could hold
        return [plain(item) for item in value] if isinstance(value, tuple | list) else value
    out: dict[str, Any] = {}
    for field in dataclasses.fields(value):
        item, how = getattr(value, field.name), field.metadata
        if "flat" in how:
            out |= plain(item) if item is not None else {}
        elif "hidden" not in how and not ("omitted" in how and item is None):
            out[how["names"][value.against_truth] if "names" in how else field.name] = plain(item)
    return out


def typed(kind: Any, value: Any) -> Any:
    """Turn plain values into what :func:`plain` made them of.

    Raises
    ------
    ValueError
        When a level is no mapping or lacks a key.
    """
    if hasattr(kind, "__dataclass_fields__"):
        if not isinstance(value, Mapping):
            raise ValueError(f"{kind.__name__} must be names and values.")
        hints, given = get_type_hints(kind), {}
        for field in dataclasses.fields(kind):
            if whole := field.metadata.get("flat"):
                given[field.name] = typed(whole, value) if dataclasses.fields(whole)[0].name in value else None
            for name in field.metadata.get("names", (field.name,)):
                if name in value and "hidden" not in field.metadata:
                    given[field.name] = typed(hints[field.name], value[name])
        if "against_truth" in hints:
            given["against_truth"] = "withheld_gps" not in value
        try:
            return kind(**given)
        except TypeError as error:
            raise ValueError(f"{kind.__name__}: {error}") from error
    origin, arguments = get_origin(kind), get_args(kind)
    if value is None or origin is None:
        return value
    if origin in (Union, types.UnionType):
        return typed(next(a for a in arguments if a is not type(None)), value)
    if origin is dict and not isinstance(value, Mapping):
        raise ValueError(f"{kind} must be names and values.")
    if origin is dict:
        return {key: typed(arguments[1], item) for key, item in value.items()}
    return tuple(typed(arguments[0], item) for item in value) if origin is tuple else value
