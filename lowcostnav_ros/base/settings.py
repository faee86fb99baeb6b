"""Settings: frozen dataclasses whose fields carry unit, range and meaning.

One declaration serves the YAML files, the ROS parameters, the documentation and the settings hash of a replay.  Groups are
nested dataclasses.  Unknown names are refused with the nearest known one, values out of range with the range.
"""

import dataclasses
import difflib
import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

S = TypeVar("S")
_SHOWN = 120


class SettingsError(ValueError):
    """A setting that cannot be used; the message is one sentence that says what to do."""


def setting(
    default: Any,
    description: str,
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple = (),
    live: bool = False,
    per_axis: bool = False,
    shipped: Any = None,
    within: float | None = None,
) -> Any:
    """Declare one setting of a frozen dataclass.

    Parameters
    ----------
    default : bool, int, float, str or list of these
        Default value; its type is the type of the setting.
    description : str
        One sentence, without the unit.
    unit : str
        Unit as a reader would write it, e.g. ``m/s``; empty for none.
    minimum, maximum : float, optional
        Inclusive range of a number, or of every element of a list.
    choices : tuple, optional
        Allowed values of a string.
    live : bool
        True when a running node may change it; False means it takes a restart.
    per_axis : bool
        True for a number that may also be given as three, x y z.
    shipped : bool, int, float, str or list of these, optional
        Value in the parameter file of the package where it is not the default.
    within : float, optional
        Factor within which the number of a sensor or of a day lies about the default, one sigma: recordings may tune it.
    """
    meta = {"description": description, "unit": unit, "minimum": minimum, "maximum": maximum, "choices": choices, "live": live}
    meta |= {"per_axis": per_axis, "shipped": shipped, "within": within}
    if isinstance(default, list | dict):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=meta)
    return dataclasses.field(default=default, metadata=meta)


def group(cls: type[S], **defaults: Any) -> S:
    """Declare a group of settings: a nested settings dataclass, ``defaults`` in place of its own."""
    return dataclasses.field(default_factory=lambda: cls(**defaults))


@dataclasses.dataclass(frozen=True, slots=True)
class Declared:
    """One declared setting, as :func:`declared` lists it."""

    name: str
    default: Any
    description: str
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple
    live: bool
    per_axis: bool = False
    shipped: Any = None
    within: float | None = None


def declared(cls: Any, prefix: str = "") -> Iterator[Declared]:
    """List every setting of a settings dataclass, or of an instance that gives the defaults, by its dotted name; groups flattened."""
    defaults = cls() if isinstance(cls, type) else cls
    for field in dataclasses.fields(defaults):
        value = getattr(defaults, field.name)
        if dataclasses.is_dataclass(value):
            yield from declared(value, f"{prefix}{field.name}.")
        elif "description" in field.metadata:
            yield Declared(f"{prefix}{field.name}", value, **field.metadata)


def parts_of(settings: Any) -> Iterator[Any]:
    """Settings with all their groups, however deep."""
    yield settings
    for field in dataclasses.fields(settings):
        if dataclasses.is_dataclass(part := getattr(settings, field.name)):
            yield from parts_of(part)


def from_mapping(cls: type[S], values: Mapping[str, Any], where: str = "settings") -> S:
    """Build a settings object from nested or dotted names, refusing unknown names.

    Parameters
    ----------
    cls : type
        Settings dataclass.
    values : mapping
        Names (nested mappings or dotted) to values; missing names keep their defaults.
    where : str
        What to call the source in an error, usually the file name.

    Raises
    ------
    SettingsError
        For an unknown name (the nearest known name is given), a wrong type, or a value out of range.
    """
    if not isinstance(values, Mapping):
        raise SettingsError(f"{where}: expected names and values, got {type(values).__name__}.")
    cls = chosen_class(cls, values)
    known = {d.name: d for d in declared(cls)}
    flat = dict(_flatten(values, known))
    upgrade = getattr(cls, "upgraded", None)
    flat = flat if upgrade is None else upgrade(flat)
    for name in flat:
        if name not in known:
            raise SettingsError(f"{where}: unknown setting '{shown(name, str)}'{nearest(name, known)}.")
    return _build(cls(), {n: checked(known[n], v, where) for n, v in flat.items()}, "")


def chosen_class(cls: type[S], values: Mapping[str, Any]) -> type[S]:
    """The settings class that ``values`` ask for: a class may have groups that one of its own settings lists (``chosen_by``)."""
    choose = getattr(cls, "chosen_by", None)
    return cls if choose is None else choose(values)


def to_mapping(settings: Any) -> dict[str, Any]:
    """Flatten a settings object to dotted names and plain values."""
    flat: dict[str, Any] = {}
    for entry in declared(type(settings)):
        value = settings
        for part in entry.name.split("."):
            value = getattr(value, part)
        flat[entry.name] = value
    return flat


def settings_hash(*settings: Any) -> str:
    """First 16 hex digits of the SHA-256 of all values: the identity of a configuration."""
    text = json.dumps([to_mapping(s) for s in settings], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def nearest(name: str, known: Any) -> str:
    """Return `` (did you mean 'x'?)`` or the list of what exists, to end a refusal's sentence with."""
    name = name[:_SHOWN]
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    if not close:  # a right leaf in the wrong group is the commonest slip after a typo
        close = [k for k in known if k.split(".")[-1] == name.split(".")[-1]][:1]
    return f" (did you mean '{close[0]}'?)" if close else f"; known: {', '.join(sorted(known))}"


def shown(value: Any, text: Callable[[Any], str] = repr) -> str:
    """Return a value as a refusal quotes it: on one line and no longer than that."""
    try:
        line = " ".join(text(value).split())
    except (ValueError, RecursionError):  # a number of thousands of digits, a list of lists of lists
        line = type(value).__name__
    return line if len(line) <= _SHOWN else line[: _SHOWN - 3] + "..."


def checked(entry: Declared, value: Any, where: str = "settings") -> Any:
    """Return ``value`` converted to the declared type; raise SettingsError when it does not fit."""
    label = f"{where}: '{entry.name}'"
    if entry.per_axis and isinstance(value, list | tuple):
        if len(value) != 3:
            raise SettingsError(f"{label} must be one number or three, x y z, got {len(value)}.")
        return [_scalar(entry, 0.0, v, label) for v in value]
    if isinstance(entry.default, list):
        if not isinstance(value, list | tuple):
            raise SettingsError(f"{label} must be a list, got {shown(value)}.")
        sample = entry.default[0] if entry.default else (value[0] if value else 0.0)
        if isinstance(sample, int) and not isinstance(sample, bool) and any(isinstance(v, float) for v in value):
            sample = 0.0
        return [_scalar(entry, sample, v, label) for v in value]
    return _scalar(entry, entry.default, value, label)


def _scalar(entry: Declared, sample: Any, value: Any, label: str) -> Any:
    if isinstance(sample, bool):
        if not isinstance(value, bool):
            raise SettingsError(f"{label} must be true or false, got {shown(value)}.")
        return value
    if isinstance(sample, str):
        if not isinstance(value, str):
            raise SettingsError(f"{label} must be text, got {shown(value)}.")
        if entry.choices and value not in entry.choices:
            raise SettingsError(f"{label} must be one of {', '.join(entry.choices)}, got {shown(value)}.")
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SettingsError(f"{label} must be a number{_unit(entry)}, got {shown(value)}.")
    try:
        finite = math.isfinite(value)
    except OverflowError:  # a whole number of hundreds of digits
        finite = False
    if not finite:
        raise SettingsError(f"{label} must be finite, got {shown(value)}.")
    if isinstance(sample, int) and value != int(value):
        raise SettingsError(f"{label} must be a whole number, got {shown(value)}.")
    low, high = entry.minimum, entry.maximum
    if (low is not None and value < low) or (high is not None and value > high):
        limits = " and ".join(f"{w} {x:g}" for w, x in (("at least", low), ("at most", high)) if x is not None)
        raise SettingsError(f"{label} must be {limits}{_unit(entry)}, got {value:g}.")
    return type(sample)(value)


def _unit(entry: Declared) -> str:
    return f" {entry.unit}" if entry.unit else ""


def _flatten(values: Mapping[str, Any], known: Mapping[str, Declared], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping) and name not in known:
            yield from _flatten(value, known, name + ".")
        else:
            yield name, value


def _build(defaults: Any, flat: dict[str, Any], prefix: str) -> Any:
    arguments = {}
    for field in dataclasses.fields(defaults):
        value = getattr(defaults, field.name)
        if dataclasses.is_dataclass(value):
            arguments[field.name] = _build(value, flat, f"{prefix}{field.name}.")
        elif prefix + field.name in flat:
            arguments[field.name] = flat[prefix + field.name]
    try:
        return dataclasses.replace(defaults, **arguments)
    except SettingsError:
        raise
    except (TypeError, ValueError) as error:
        raise SettingsError(f"{type(defaults).__name__}: {error}") from error
