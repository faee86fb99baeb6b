"""YAML files of the nodes: where they are, reading them into settings, writing them with every meaning, unit and range."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from lowcostnav_ros.base.documents import read_yaml
from lowcostnav_ros.base.settings import Declared, SettingsError, declared, from_mapping, shown

S = TypeVar("S")
_PACKAGE = "lowcostnav_ros"
_WIDTH = 118
SHIPPED = "shipped"
"""What the settings of the package itself are called."""


def config_dir() -> Path:
    """Return the directory of the shipped configuration.

    Looked for in the share folders of AMENT_PREFIX_PATH, then of ``sys.prefix``, then in the source tree.

    Raises
    ------
    SettingsError
        When none of them has it.
    """
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    candidates = [prefix / "share" / _PACKAGE / "config" for prefix in [*prefixes, Path(sys.prefix)]]
    candidates.append(Path(__file__).resolve().parents[2] / "config")
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    raise SettingsError("The configuration files are not installed; install the package or set AMENT_PREFIX_PATH to where they are.")


def find_config(name: str | Path) -> Path:
    """Return the path of a configuration file: as given, else inside :func:`config_dir`, with or without ``.yaml``.

    Raises
    ------
    SettingsError
        When there is no such file, naming what the folder holds.
    """
    for path in (Path(name), config_dir() / name, config_dir() / f"{name}.yaml"):
        if path.is_file():
            return path
    folder, kind = (config_dir() / name).parent, Path(name).suffix or ".yaml"
    there = sorted(p.name if kind != ".yaml" else p.stem for p in folder.glob(f"*{kind}")) if folder.is_dir() else []
    shipped = f", neither here nor among the shipped files ({', '.join(there)})" if there else "; check the path of the file"
    raise SettingsError(f"{name} does not exist{shipped}.")


def vehicle_dir(name: str | Path) -> Path:
    """Return the folder of a vehicle's settings: as given, else of that name among those of the package.

    Raises
    ------
    SettingsError
        When there is none, naming those that there are.
    """
    vehicles = config_dir() / "vehicles"
    for path in (Path(name), vehicles / name):
        if path.is_dir():
            return path
    raise SettingsError(
        f"Vehicle '{name}' is neither a folder nor one of the package's ({', '.join(sorted(p.name for p in vehicles.iterdir()))})."
    )


def read_parameters(path: str | Path, node: str | None = None) -> dict[str, Any]:
    """Return the parameters a YAML file gives a node: those under ``/**`` overlaid by those under the node's own name.

    Parameters
    ----------
    path : str or Path
        ROS parameter file (``/**:`` or ``<node>:``, then ``ros__parameters:``).
    node : str, optional
        Node name, with or without namespace; where None the file must hold parameters for one node only.

    Raises
    ------
    SettingsError
        For a missing file, another structure, or a file of other nodes only.
    """
    content = read_yaml(path)
    if not isinstance(content, Mapping) or not all(isinstance(v, Mapping) and "ros__parameters" in v for v in content.values()):
        raise SettingsError(
            f"{path} is not a parameter file; it needs '/**:' or a node name, then 'ros__parameters:', then the parameters."
        )
    own = [key for key in content if key != "/**"]
    if node is not None:
        plain = node.strip("/")
        own = [key for key in own if key.strip("/") in (plain, plain.rpartition("/")[2], f"**/{plain}")]
        if not own and "/**" not in content:
            raise SettingsError(f"{path} has no parameters for '{node}'; it holds those for {shown(', '.join(content), str)}.")
    elif len(own) > 1:
        raise SettingsError(f"{path} holds parameters for several nodes ({', '.join(own)}); name the one that is meant.")
    merged: dict[str, Any] = {}
    for key in [k for k in content if k == "/**"] + own:
        merged |= _dotted(content[key]["ros__parameters"] or {}, path)
    return merged


def load_settings(cls: type[S], path: str | Path | None = None, node: str | None = None) -> S:
    """Read a node's settings from its YAML file; defaults where ``path`` is None.

    Raises
    ------
    SettingsError
        For a missing file, an unknown name (the nearest is given), or a value out of range; the message names the file.
    """
    if path is None:
        return cls()
    values = read_parameters(path, node)
    values.pop("use_sim_time", None)  # every ROS node has it; it is not one of ours
    return from_mapping(cls, values, str(path))


def yaml_of(cls: type, node: str = "/**") -> str:
    """Write a settings dataclass as commented YAML: every parameter with its meaning, unit, range and shipped value.

    Parameters
    ----------
    cls : type
        Settings dataclass.
    node : str
        Key of the file, ``/**`` for any node.
    """
    lines = _wrapped(" ".join((cls.__doc__ or "").split()), "") + [f"{node}:", "  ros__parameters:"]
    group: list[str] = []
    for entry in declared(cls):
        *path, leaf = entry.name.split(".")
        shared = 0
        while shared < min(len(path), len(group)) and path[shared] == group[shared]:
            shared += 1
        lines += [f"{'  ' * (depth + 2)}{path[depth]}:" for depth in range(shared, len(path))]
        group = path
        indent = "  " * (len(path) + 2)
        value = entry.default if entry.shipped is None else entry.shipped
        lines += _wrapped(_comment(entry), indent) + [f"{indent}{leaf}: {_plain(value)}"]
    return "\n".join(lines) + "\n"


def _comment(entry: Declared) -> str:
    low, high = entry.minimum, entry.maximum
    notes = [entry.unit] if entry.unit else []
    if low is not None or high is not None:
        notes.append(f"{'-inf' if low is None else f'{low:g}'} to {'inf' if high is None else f'{high:g}'}")
    if entry.choices:
        notes.append("one of " + ", ".join(map(str, entry.choices)))
    if entry.per_axis:
        notes.append("one number or three, x y z")
    if entry.live:
        notes.append("may change while running")
    return f"{entry.description.rstrip('.')} [{'; '.join(notes)}]" if notes else entry.description.rstrip(".")


def _plain(value: Any) -> str:
    if isinstance(value, float) and "e" in repr(value) and "." not in repr(value):
        return repr(value).replace("e", ".0e")  # YAML 1.1 reads 1e-05 as text
    if isinstance(value, list):
        return "[" + ", ".join(_plain(v) for v in value) + "]"
    return yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()


def _wrapped(text: str, indent: str) -> list[str]:
    lines, line = [], f"{indent}#"
    for word in text.split():
        if len(line) + len(word) >= _WIDTH:
            lines.append(line)
            line = f"{indent}#"
        line += f" {word}"
    return [*lines, line] if text else []


def _dotted(values: Any, path: str | Path, prefix: str = "") -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise SettingsError(f"{path}: 'ros__parameters' must hold names and values, got {shown(values)}.")
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        flat |= _dotted(value, path, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return flat
