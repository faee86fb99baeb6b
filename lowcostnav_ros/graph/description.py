"""Graphs of nodes: the YAML files in ``config/graphs``, checked, and the command that brings one up.

A graph names its nodes; what every one of them shares stands at the top::

    scenario: livermore          # simulators take their settings from this scenario
    real_time_factor: 1.0        # 2.0 flies twice as fast as the clock on the wall
    vehicle: small_aircraft      # nodes fly the settings of config/vehicles/small_aircraft, or of a folder
    lossless: false              # true: publishing waits, nothing is lost (recordings for regression)
    domain: 7                    # ROS domain; default: that of the environment, or any free one where the graph simulates its sensors
    inputs:                      # of navigators and recorders: where a source comes from, frame ids accepted beside the usual ones
      imu/data_raw: {topic: /mavros/imu/data_raw, frames: [imu]}
    parameters: {imu.mounting_deg: [0, 0, 90]}   # of every node that has such a parameter
    nodes:
      - executable: ins_gps      # one of the executables of the package
        name: ins_gps            # node name, default the executable
        config: ins_gps.yaml     # in config/ or a path, default config/<executable>.yaml if there is one
        parameters: {input.silent_after_s: 2.0}
        respawn: true            # start again when it dies
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.documents import read_yaml
from lowcostnav_ros.base.settings import nearest, shown
from lowcostnav_ros.catalogue.config_files import config_dir, read_parameters, vehicle_dir
from lowcostnav_ros.graph.domain import HIGHEST
from lowcostnav_ros.graph.executables import EXECUTABLES, MONITOR, SIMULATOR, SOURCE, kind_of
from lowcostnav_ros.messages.inputs import is_of_input, parse_inputs

TOP_KEYS = ("scenario", "domain", "lossless", "real_time_factor", "inputs", "parameters", "nodes", "vehicle")
NODE_KEYS = ("executable", "name", "config", "parameters", "respawn")


class GraphError(ValueError):
    """A graph that cannot be run; the message is one sentence that says what to do."""


@dataclass(frozen=True)
class GraphNode:
    """One node: its executable, name, parameter file (or None), parameter values, and whether it is started again when it dies."""

    executable: str
    name: str
    config: Path | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    respawn: bool = True


@dataclass(frozen=True)
class Graph:
    """A checked graph; ``domain`` None means that of the environment, or any free one where the graph simulates or plays its sensors.

    ``inputs`` and ``parameters`` hold dotted names and values for all nodes: ``input.<source>.topic`` and ``.frames``, and any other.
    """

    name: str
    nodes: tuple[GraphNode, ...]
    scenario: str = ""
    domain: int | None = None
    lossless: bool = False
    real_time_factor: float = 1.0
    inputs: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def has_source(self) -> bool:
        """Whether a flight is simulated or played in the graph, so that it listens to nobody's sensors."""
        return any(kind_of(node.executable) in (SOURCE, SIMULATOR) for node in self.nodes)

    def node(self, name: str) -> GraphNode:
        """Return a node by name; raises GraphError when there is none."""
        for node in self.nodes:
            if node.name == name:
                return node
        raise GraphError(f"{self.name}: no node '{name}'{nearest(name, [n.name for n in self.nodes])}.")

    def with_parameters(self, name: str, **values: Any) -> "Graph":
        """Return a copy in which one node has further parameter values (a double underscore stands for the dot)."""
        node, dotted = self.node(name), {key.replace("__", "."): value for key, value in values.items()}
        changed = replace(node, parameters={**node.parameters, **dotted})
        return replace(self, nodes=tuple(changed if n.name == name else n for n in self.nodes))

    def without(self, *names: str) -> "Graph":
        """Return a copy without some nodes."""
        for name in names:
            self.node(name)
        return replace(self, nodes=tuple(n for n in self.nodes if n.name not in names))


def graph_names() -> list[str]:
    """Names of the graphs that come with the package."""
    return sorted(p.stem for p in (config_dir() / "graphs").glob("*.yaml"))


def load_graph(name_or_path: str | Path) -> Graph:
    """Read a graph.

    Parameters
    ----------
    name_or_path : str or Path
        The name of a graph of the package (``livermore``) or the path of a YAML file.

    Raises
    ------
    GraphError, SettingsError
        When it is missing, cannot be read or cannot be run, with what to do.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = config_dir() / "graphs" / f"{name_or_path}.yaml"
    if not path.is_file():
        raise GraphError(f"No graph '{name_or_path}'{nearest(str(name_or_path), graph_names())}; or give the path of a YAML file.")
    return parse_graph(read_yaml(path), path.stem, path.parent)


def parse_graph(content: Any, name: str, folder: Path | None = None) -> Graph:
    """Check the content of a graph file; ``folder`` is where relative config paths are looked up after the package's own."""
    _mapping(content, name, TOP_KEYS)
    if not isinstance(content.get("nodes"), list) or not content["nodes"]:
        raise GraphError(f"{name}: give at least one node under 'nodes'.")
    factor = content.get("real_time_factor", 1.0)
    if isinstance(factor, bool) or not isinstance(factor, int | float) or not 0.01 <= factor <= 1000.0:
        raise GraphError(f"{name}: 'real_time_factor' must be a number from 0.01 to 1000, got {shown(factor)}.")
    domain = content.get("domain")
    if domain is not None and (isinstance(domain, bool) or not isinstance(domain, int) or not 0 <= domain <= HIGHEST):
        raise GraphError(f"{name}: 'domain' must be a whole number from 0 to {HIGHEST}, got {shown(domain)}.")
    if not isinstance(content.get("lossless", False), bool):
        raise GraphError(f"{name}: 'lossless' must be true or false, got {shown(content['lossless'])}.")
    scenario = str(content.get("scenario") or "")
    vehicle = vehicle_dir(str(content["vehicle"])) if content.get("vehicle") else None
    nodes = tuple(_of_vehicle(_node(entry, name, scenario, folder), vehicle) for entry in content["nodes"])
    names = [node.name for node in nodes]
    for one in names:
        if names.count(one) > 1:
            raise GraphError(f"{name}: two nodes are called '{one}'; give one of them another 'name'.")
    shared = dict(_dotted(content.get("parameters") or {}, f"{name}: 'parameters'"))
    inputs = {f"input.{key}": value for key, value in _dotted(content.get("inputs") or {}, f"{name}: 'inputs'")}
    for key in inputs:
        if not is_of_input(key):
            raise GraphError(f"{name}: 'inputs' gives sources a topic or frames, as in 'imu/data_raw: {{topic: /imu}}', not '{key[6:]}'.")
    parse_inputs(inputs, name)
    return Graph(name, nodes, scenario, domain, content.get("lossless", False), float(factor), inputs, shared)


def _dotted(values: Any, where: str, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(values, Mapping):
        raise GraphError(f"{where}: expected names and values, got {type(values).__name__}.")
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, where, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _of_vehicle(node: GraphNode, vehicle: Path | None) -> GraphNode:
    """The node with the settings of a vehicle, where that has a file for it; what the graph itself sets stays."""
    file = None if vehicle is None else vehicle / f"{node.executable}.yaml"
    if file is None or not file.is_file():
        return node
    return replace(node, parameters={**read_parameters(file, node.executable), **node.parameters})


def _node(entry: Any, where: str, scenario: str, folder: Path | None) -> GraphNode:
    if isinstance(entry, str):
        entry = {"executable": entry}
    _mapping(entry, f"{where}: a node", NODE_KEYS)
    executable = entry.get("executable")
    if not isinstance(executable, str) or executable not in EXECUTABLES:
        raise GraphError(f"{where}: unknown executable '{executable}'{nearest(str(executable), EXECUTABLES)}.")
    parameters = entry.get("parameters") or {}
    if not isinstance(parameters, Mapping):
        raise GraphError(f"{where}: 'parameters' of {executable} must be names and values, got {shown(parameters)}.")
    config = _config(entry.get("config"), executable, where, scenario, folder)
    # a flight that starts again from its beginning would jump back in time, so its source stays dead
    respawn = entry.get("respawn", kind_of(executable) != SOURCE)
    if not isinstance(respawn, bool):
        raise GraphError(f"{where}: 'respawn' of {executable} must be true or false, got {shown(respawn)}.")
    return GraphNode(executable, _name(entry.get("name", executable), where), config, dict(parameters), respawn)


def made_node(executable: str, graph: Graph) -> GraphNode:
    """Return a node of an executable with its shipped configuration, as a graph that only names it has it."""
    return _node(executable, graph.name, graph.scenario, None)


def _name(name: Any, where: str) -> str:
    """A name that ROS takes and that is a file's name, too: the log and the parameters of the node bear it."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]{0,99}", name) or name == MONITOR:
        raise GraphError(f"{where}: the node name {name!r} must be letters, digits and _, at most 100, and not '{MONITOR}'.")
    return name


def _config(given: Any, executable: str, where: str, scenario: str, folder: Path | None) -> Path | None:
    if given is None:
        default = config_dir() / f"{executable}.yaml"
        # the scenario sets its simulators; the file of defaults would set them back
        return default if default.is_file() and not (scenario and takes_scenario(executable)) else None
    if not isinstance(given, str) or "\0" in given or not given:
        raise GraphError(f"{where}: 'config' of {executable} must name a file, got {shown(given)}.")
    for candidate in (config_dir() / given, *([folder / given] if folder else []), Path(given)):
        if candidate.is_file():
            return candidate
    raise GraphError(f"{where}: the config file '{given}' of {executable} is neither in {config_dir()} nor a path that exists.")


def takes_scenario(executable: str) -> bool:
    """Whether an executable takes its defaults from the scenario of its graph."""
    return executable == "truth_source" or kind_of(executable) == SIMULATOR


def _mapping(content: Any, where: str, keys: tuple[str, ...]) -> None:
    if not isinstance(content, Mapping):
        raise GraphError(f"{where}: expected names and values, got {type(content).__name__}.")
    for key in content:
        if key not in keys:
            raise GraphError(f"{where}: unknown entry '{key}'{nearest(str(key), keys)}.")
