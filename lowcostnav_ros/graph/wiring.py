"""What the nodes of a graph subscribe to, and the parameters that their graph sets.

A flight starts when all its subscribers are there; the graph runner counts them from this table.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar

from lowcostnav_ros.base.settings import chosen_class, declared, nearest, to_mapping
from lowcostnav_ros.catalogue.config_files import read_parameters
from lowcostnav_ros.catalogue.navigator_topics import topics_of
from lowcostnav_ros.graph.description import Graph, GraphError, GraphNode, made_node, takes_scenario
from lowcostnav_ros.graph.executables import EXECUTABLES, NAVIGATOR, NODES, RECORDER, SIMULATOR, SOURCE, kind_of, sensor_of, settings_of
from lowcostnav_ros.messages.inputs import is_of_input
from lowcostnav_ros.messages.rules import parse_further
from lowcostnav_ros.messages.topics import TOPICS
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.sensors.registry import SIMULATORS

PACED = ("truth/imu", "truth/odometry", "imu/data_raw", "air/velocity", "air/dynamic_pressure")
"""Topics that never pause in a simulated flight: on these a node reports how far it has come to a lossless source."""

LONGEST_LAG_S = 10.0
PAGE = "page"

T = TypeVar("T")


def _once(work: Callable[[GraphNode], T]) -> Callable[[GraphNode], T]:
    """Work out once for a node, which never changes, what each of its graph's other nodes asks again: the result is to be read only."""

    @wraps(work)
    def remembered(node: GraphNode) -> T:
        known: dict[str, Any] = vars(node).setdefault(work.__name__, {})
        if not known:
            known["result"] = work(node)
        result: T = known["result"]
        return result

    return remembered


def recorded_topics() -> list[str]:
    """Topics a recording holds: all but /clock, which the player makes anew, and truth/imu, which truth/odometry covers."""
    fixed = [name for name, kind in TOPICS.items() if kind.recorded]
    return list(dict.fromkeys([*fixed, *(topic for name in NAVIGATORS for topic in topics_of(name))]))


def inputs_of(node: GraphNode) -> tuple[str, ...]:
    """Topics a node of a graph subscribes to."""
    kind = kind_of(node.executable)
    if kind == RECORDER:
        further = parse_further(node.parameters.get("further", []))
        return tuple(dict.fromkeys([*(node.parameters.get("topics") or recorded_topics()), *further]))
    return tuple(_sources_of(node)) if kind == NAVIGATOR else EXECUTABLES[node.executable].inputs


@_once
def _sources_of(node: GraphNode) -> dict[str, str]:
    """What a navigator takes, and the topic of the package that each is like, empty where that is not stated."""
    navigator = navigator_of(node)
    return {source: navigator.kinds.get(source, "") for source in navigator.inputs}


def expected_subscribers(graph: Graph) -> list[str]:
    """Return ``topic:count`` for every topic with a subscriber, recorders included, for ``start.expected_subscribers``.

    Without topics of navigators: nothing is published there before the sensors.
    """
    listeners = _listeners(graph)
    computed = [topic for name in NAVIGATORS for topic in topics_of(name)]
    known = {*TOPICS, *further_topics(graph)} - {*computed, "diagnostics"}
    published = [topic for topic in listeners if topic in known]
    return [f"{topic}:{listeners[topic]}" for topic in sorted(published)]


def _listeners(graph: Graph) -> Counter:
    """How many nodes of a graph subscribe to each topic."""
    counts = Counter(topic for node in graph.nodes for topic in inputs_of(node))
    for node in graph.nodes:
        if kind_of(node.executable) == RECORDER:
            counts.update(further_topics(graph).keys() - {*inputs_of(node)})
    return counts


def further_topics(graph: Graph) -> dict[str, str]:
    """Topics of further sensors that the navigators of a graph are configured for, each with the topic of the package it is like."""
    kinds: dict[str, str] = {}
    for node in graph.nodes:
        if kind_of(node.executable) == NAVIGATOR:
            kinds |= {source: kind for source, kind in _sources_of(node).items() if kind and source not in TOPICS}
    return kinds


def shared_parameters(graph: Graph, node: GraphNode) -> dict[str, Any]:
    """Return the parameter values of a node: those that its graph sets, then its own."""
    values: dict[str, Any] = {"qos.lossless": graph.lossless}
    if graph.lossless:
        values["qos.listeners"] = [f"{topic}:{count}" for topic, count in sorted(_listeners(graph).items())]
    if graph.scenario and takes_scenario(node.executable):
        values["scenario"] = graph.scenario
    further = further_topics(graph) if node.executable in ("recorder", "player") else {}
    if further:
        values["further"] = [f"{source}:{kind}" for source, kind in further.items()]
    if kind_of(node.executable) == SOURCE:
        values["real_time_factor"] = graph.real_time_factor
        values["start.expected_subscribers"] = expected_subscribers(graph)
        if graph.lossless:
            values["flow.listeners"] = sum(bool(_paced(graph) & set(inputs_of(other))) for other in graph.nodes)
    if node.executable in (PAGE, "display"):
        values["stations"] = station_tables(graph)
    if kind_of(node.executable) == NAVIGATOR and graph.real_time_factor > 1.0:
        # transport takes wall time, the horizon counts stamps: flying faster needs a longer lag (it delays, it changes no solution)
        values["horizon.lag_s"] = min(setting_of(node, "horizon.lag_s") * graph.real_time_factor, LONGEST_LAG_S)
    if kind_of(node.executable) in (NAVIGATOR, RECORDER):
        values |= graph.inputs
    return values | _of_all(graph, node) | dict(node.parameters)


def _paced(graph: Graph) -> set[str]:
    """The paced topics that the source and the simulators of a graph publish; what a player finds in its recording is not known here."""
    if any(node.executable == "player" for node in graph.nodes):
        return set(PACED)
    simulated = {topic for node in graph.nodes if kind_of(node.executable) == SIMULATOR for topic in _outputs_of(node.executable)}
    return {topic for topic in PACED if topic in simulated or topic.startswith("truth/")}


def _of_all(graph: Graph, node: GraphNode) -> dict[str, Any]:
    """Those of the parameters for all nodes that a node has."""
    if not graph.parameters:
        return {}
    known = {other.name: _parameters_of(other) for other in graph.nodes}
    for name in graph.parameters:
        if not any(name in names for names in known.values()):
            raise GraphError(f"{graph.name}: no node has the parameter '{name}'{nearest(name, set().union(*known.values()))}.")
    return {name: value for name, value in graph.parameters.items() if name in known[node.name]}


def _parameters_of(node: GraphNode) -> set[str]:
    settings = settings_of(node.executable)
    if settings is None:
        return set()
    return {entry.name for entry in declared(chosen_class(settings, _given(node)))}


def station_tables(graph: Graph) -> list[str]:
    """Return the station tables that the navigators of a graph fly with."""
    settings = [to_mapping(_navigator_settings(node)) for node in graph.nodes if kind_of(node.executable) == NAVIGATOR]
    return sorted({file for one in settings for name, file in one.items() if name.endswith("stations_file") and file})


def with_page(graph: Graph, listen: str = "") -> Graph:
    """Return a graph with a page that shows its flight, unless it has one; ``listen`` is where, empty for this machine only."""
    node = made_node(PAGE, graph)
    if any(other.executable == PAGE or other.name == PAGE for other in graph.nodes):
        return graph
    return replace(graph, nodes=(*graph.nodes, replace(node, parameters={"listen": listen} if listen else {})))


def with_nodes(graph: Graph, names: Sequence[str]) -> Graph:
    """Return a graph with further executables as they are shipped, those that it has already left out."""
    there = {node.executable for node in graph.nodes} | {node.name for node in graph.nodes}
    for name in names:
        EXECUTABLES[name]  # refuses one that does not exist
    return replace(graph, nodes=(*graph.nodes, *(made_node(name, graph) for name in dict.fromkeys(names) if name not in there)))


def completed(graph: Graph) -> Graph:
    """Return a graph with the nodes that make what its navigators take and nothing in it is known to publish (an air data computer).

    They stay quiet where a driver outside the graph, or a player, publishes it after all.
    """
    taken = {topic for node in graph.nodes if kind_of(node.executable) == NAVIGATOR for topic in inputs_of(node)}
    made = {topic for node in graph.nodes for topic in _outputs_of(node.executable)}
    missing = [name for name in NODES if set(EXECUTABLES[name].outputs) & (taken - made)]
    return replace(graph, nodes=(*graph.nodes, *(made_node(name, graph) for name in missing)))


def _outputs_of(executable: str) -> tuple[str, ...]:
    simulates = kind_of(executable) == SIMULATOR
    return SIMULATORS.label(sensor_of(executable)).topics if simulates else EXECUTABLES[executable].outputs


def setting_of(node: GraphNode, name: str) -> Any:
    """Return the value a setting of a navigator has in a graph, e.g. ``horizon.lag_s``."""
    return to_mapping(_navigator_settings(node))[name]


def flown_settings(graph: Graph) -> dict[str, dict[str, Any]]:
    """Return the complete settings of every navigator of a graph, dotted names to values, as its nodes fly with them.

    A named IMU profile is given by its numbers alone, so that a recording can be replayed where there is no such file.
    """
    flown = {}
    for node in graph.nodes:
        if kind_of(node.executable) == NAVIGATOR:
            shared = replace(node, parameters=shared_parameters(graph, node))
            values = to_mapping(_navigator_settings(shared))
            inputs = {name: value for name, value in _given(shared).items() if is_of_input(name)}
            flown[node.executable] = {name: value for name, value in values.items() if name != "imu.profile" or value == "auto"} | inputs
    return flown


@_once
def _navigator_settings(node: GraphNode) -> Any:
    from lowcostnav_ros.catalogue import building  # loads the compiler, which a graph without navigators does not need

    settings_class = NAVIGATORS[node.executable].Settings
    values = {name: value for name, value in _given(node).items() if not building.is_of_node(name)}
    return building.complete_settings(settings_class, values, node.name)


@_once
def _given(node: GraphNode) -> dict[str, Any]:
    """What its parameter file and its graph give a node."""
    return {**({} if node.config is None else read_parameters(node.config, node.name)), **node.parameters}


def navigator_of(node: GraphNode) -> Any:
    """Build the navigator a node of a graph runs, with the very settings and stations it runs with."""
    from lowcostnav_ros.catalogue.building import make_navigator

    return make_navigator(_navigator_settings(node), NAVIGATORS[node.executable])
