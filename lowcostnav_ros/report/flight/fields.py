"""Every logged quantity of a flight, packed for a reader who draws what he chooses: solutions, errors, states, innovations, inputs."""

import base64
import dataclasses
import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.measurements import (
    AirTemperature,
    AirVelocity,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    Measurement,
    Pressure,
    SlantRange,
    VorBearing,
)
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.report.chart import TimeAxis
from lowcostnav_ros.report.decimate import thin
from lowcostnav_ros.report.document import section
from lowcostnav_ros.report.flight.result_folder import Columns, Result
from lowcostnav_ros.report.svg import element

MOST = 450
"""Points of a quantity, about."""
STEPS = 65_534
"""Between the smallest and the largest value; 0 stands for none."""
_UNITS = {"mps": "m/s", "radps": "rad/s", "mps2": "m/s^2", "degps": "deg/s", "ut": "uT", "pa": "Pa", "k": "K", "hz": "Hz"}
_UNITS |= {unit: unit for unit in ("m", "deg", "rad", "s")}
_SENSORS = (ImuBlock, MagneticField, GpsPosition, GpsVelocity, Pressure, AirTemperature, AirVelocity, SlantRange, VorBearing)
"""Inputs that are drawn; an attitude reference is a navigator."""
_IMU = {"specific_force_b": "specific_force_{}_mps2", "angular_rate_b": "angular_rate_{}_radps"}
_NORTH = ("north", "east", "down")
_AXES: dict[str, tuple[Sequence[str], str, float]] = {
    "field_b": ("xyz", "{}_ut", 1e6),
    "vel_n": (_NORTH, "{}_mps", 1.0),
    "vel_b": ("xyz", "{}_mps", 1.0),
}
_PLAIN = ("lat", "lon", "height", "pressure_pa", "temperature_k", "range_m", "bearing_rad")
_NOTE = (
    "Any logged quantity by its name, several with ; between them, or a formula of them with + - * / ( ), abs, sqrt, hypot, sin, cos, "
    "min, max. It is drawn under the zoom and the cursor of all other charts."
)

Group = tuple[np.ndarray, dict[str, np.ndarray]]
"""Stamps and the columns that share them."""


def fields_section(result: Result, axis: TimeAxis, bag: Path | None = None) -> str:
    """The section with its data; inputs are drawn too where the recording is at hand."""
    groups = [*_solved(result), *(_inputs(bag) if bag is not None else ())]
    listed, data = list[tuple[int, list[tuple[str, str, float, float]]]](), list[np.ndarray]()
    for t_s, columns in groups:
        rows = (axis.start_s <= t_s) & (t_s <= axis.end_s)
        kept = {name: values[rows] for name, values in columns.items() if np.isfinite(values[rows]).any()}
        if not kept:
            continue
        along = np.round((t_s[rows] - axis.start_s) / max(axis.end_s - axis.start_s, 1e-9) * STEPS)
        data.append(_differences(along))
        entry = []
        for name, values in kept.items():
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            scaled = 1.0 + np.round((values - low) / ((high - low) or 1.0) * STEPS)
            data.append(_differences(np.where(np.isfinite(values), scaled, 0.0)))
            entry.append((name, unit_of(name), float(f"{low:.9g}"), float(f"{high:.9g}")))
        listed.append((int(rows.sum()), entry))
    if not listed:
        return ""
    packed = base64.b64encode(zlib.compress(np.concatenate(data).tobytes(), 9)).decode()
    options = "".join(element("option", value=name) for _, entry in listed for name, *_ in entry)
    box = element("input", id="formula", list="fields-known", size="60", placeholder="a name or a formula", aria_label="quantity to draw")
    button = element("button", "draw", id="draw")
    text = f'<p class="note">{_NOTE}</p><p class="asked">{box} {button} <output id="not-drawn"></output></p><div id="drawn"></div>'
    known = element("datalist", options, id="fields-known")
    index = f'<script id="fields" type="application/json">{json.dumps(listed, separators=(",", ":"))}</script>'
    return section("Any quantity", f'{text}{known}{index}<script id="fields-data" type="application/octet-stream">{packed}</script>')


def unit_of(name: str) -> str:
    """The unit a name ends in, empty for none."""
    found = re.search(r"_([a-z]+2?)$", name)
    return _UNITS.get(found[1], "") if found else ""


def _differences(values: np.ndarray) -> np.ndarray:
    """Whole numbers below 2^16 as what each adds to the one before, which packs well."""
    return np.diff(values.astype(np.int64), prepend=0).astype(np.uint16)


def _solved(result: Result) -> Iterator[Group]:
    for name, one in result.navigators.items():
        place = re.sub(r"\W+", "_", name).strip("_")
        yield _table(one.solutions, place)
        yield _table(one.errors, f"{place}.error")
        yield _table(one.integrity, f"{place}.integrity")
        for state, rows in _split(one.states, ("state",)):
            yield _table(rows, f"{place}.state.{state[0]}", {"value": "", "sigma": "sigma"})
        for (aid, label), rows in _split(one.aids, ("aid", "label")):
            unit = label if unit_of(label) else re.sub(r"\W+", "_", label)
            yield _table(rows, f"{place}.aid.{aid}.{unit}", {"innovation": "innovation", "sigma": "sigma", "test_ratio": "test_ratio"})
    yield _table(result.truth, "truth")
    yield _table(result.truth_wind, "truth")
    yield _table(result.gps, "gps")


def _table(columns: Columns, place: str, names: Mapping[str, str] | None = None) -> Group:
    """Numbers of a table, thinned evenly."""
    t_s = columns.get("t_s", np.empty(0))
    step = max(1, len(t_s) // MOST)
    wanted = names or {name: name for name, values in columns.items() if name != "t_s" and values.dtype.kind == "f"}
    return t_s[::step], {f"{place}.{shown}".rstrip("."): columns[name][::step] for name, shown in wanted.items() if name in columns}


def _split(columns: Columns, keys: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Columns]]:
    """The rows of each value of the key columns."""
    if not len(columns.get("t_s", ())):
        return
    values = list(zip(*(columns[key].tolist() for key in keys), strict=True))
    whole = np.array(["\0".join(value) for value in values])
    for value in dict.fromkeys(values):
        rows = whole == "\0".join(value)
        yield value, {name: column[rows] for name, column in columns.items()}


def _inputs(bag: Path) -> Iterator[Group]:
    """What the recording holds as plain numbers, with the extremes kept."""
    found: dict[str, list[Measurement]] = {}
    with BagReader(bag) as reader:
        kinds = {topic: reader.decoder.rules.kind_of(topic) for topic in reader.types}
        wanted = [topic for topic, kind in kinds.items() if kind is not None and kind.measurement in _SENSORS]
        for one in reader.measurements(wanted):
            key = f"{one.source}/{one.station}" if isinstance(one, SlantRange | VorBearing) else one.source
            found.setdefault(key, []).append(one)
    for source, ones in found.items():
        place = "input." + re.sub(r"\W+", ".", source)
        for name, (t_s, values) in _numbers(ones).items():
            t_s, values = thin(t_s, values, MOST // 2)
            yield t_s, {f"{place}.{name}": values}


def _numbers(ones: list[Measurement]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Columns of measurements of one source, each with its stamps."""
    if isinstance(ones[0], ImuBlock):
        blocks = [one for one in ones if isinstance(one, ImuBlock)]
        t_s = 1e-9 * np.concatenate([one.stamps_ns for one in blocks])
        whole = {name: np.concatenate([getattr(one, name) for one in blocks]) for name in _IMU}
        return {shown.format("xyz"[k]): (t_s, whole[name][:, k]) for name, shown in _IMU.items() for k in range(3)}
    t_s, out = 1e-9 * np.array([one.stamp_ns for one in ones]), {}
    names = {field.name for field in dataclasses.fields(ones[0])}
    for name in names & set(_PLAIN):
        angle = name in ("lat", "lon", "bearing_rad")
        values = np.array([getattr(one, name) for one in ones], dtype=float)
        shown = {"lat": "lat_deg", "lon": "lon_deg", "bearing_rad": "bearing_deg", "height": "height_m"}.get(name, name)
        out[shown] = t_s, np.degrees(values) if angle else values
    for name in names & set(_AXES):
        axes, shown, factor = _AXES[name]
        if getattr(ones[0], name) is not None:
            values = factor * np.array([np.asarray(getattr(one, name), dtype=float)[: len(axes)] for one in ones])
            out |= {shown.format(axes[k]): (t_s, values[:, k]) for k in range(values.shape[1])}
    return dict(sorted(out.items()))
