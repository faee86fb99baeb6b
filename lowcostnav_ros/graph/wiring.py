"""The executables of the package: what kind each is, and what it listens to.

A flight starts when everybody who should hear it is listening; the graph runner counts the listeners from this table.
"""

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from lowcostnav_ros.base.settings import declared, from_mapping, to_mapping
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.catalogue.imu_by_name import with_imu_profile
from lowcostnav_ros.messages.topics import NAVIGATOR_TOPICS, TOPICS

if TYPE_CHECKING:
    from lowcostnav_ros.graph.description import Graph, GraphNode

SIMULATOR_INPUTS: dict[str, tuple[str, ...]] = {
    "imu_simulator": ("truth/imu",),
    "magnetometer_simulator": ("truth/odometry",),
    "air_data_simulator": ("truth/odometry", "truth/wind"),
    "gps_simulator": ("truth/odometry",),
    "dme_simulator": ("truth/odometry",),
    "vor_simulator": ("truth/odometry",),
    "gps_attitude_simulator": ("truth/odometry",),
    "gnss_simulator": ("truth/odometry",),
}
"""The part of the truth each sensor simulator listens to."""

PACED = ("truth/imu", "truth/odometry", "imu/data_raw", "air/velocity")
"""Topics that never pause in a simulated flight: on these a node reports how far it has come to a lossless source."""

LONGEST_LAG_S = 10.0
AHRS_OUTPUTS = ("imu/data", "imu/data_fused")
NAVIGATOR_NAMES = ("ahrs", "dead_reckoning", "ins_gps", "gnss_only", "ins_gnss", "supervisor")
SOURCES = ("truth_source", "player")
SIMULATION = ("truth_source", *SIMULATOR_INPUTS)
EXECUTABLES = (*SOURCES, *SIMULATOR_INPUTS, *NAVIGATOR_NAMES, "recorder", "monitor")

STOP_ORDER = (SOURCES, tuple(SIMULATOR_INPUTS), NAVIGATOR_NAMES, ("recorder",), ("monitor",))
"""Who is stopped first: what feeds before what is fed, so that the recording holds everything that was said."""


def recorded_topics() -> list[str]:
    """Topics a recording holds: all but /clock, which the player makes anew, and truth/imu, which truth/odometry covers."""
    fixed = [name for name, kind in TOPICS.items() if kind.recorded]
    return fixed + [f"{room}/{part}" for room in ("dead_reckoning", "ins_gps", "gnss_only", "ins_gnss", "nav") for part in NAVIGATOR_TOPICS]


def inputs_of(node: "GraphNode") -> tuple[str, ...]:
    """Topics a node of a graph listens to."""
    if node.executable in SIMULATOR_INPUTS:
        return SIMULATOR_INPUTS[node.executable]
    if node.executable == "recorder":
        return tuple(node.parameters.get("topics") or recorded_topics())
    if node.executable in NAVIGATOR_NAMES:
        return tuple(navigator_of(node).inputs)
    return ()


def expected_subscribers(graph: "Graph") -> list[str]:
    """Return ``topic:count`` for every topic somebody listens to, recorders included, for ``start.expected_subscribers``.

    Topics of navigators are left out: nothing travels on them before the sensors do.
    """
    listeners = _listeners(graph)
    published = [topic for topic in listeners if topic in TOPICS and topic not in (*AHRS_OUTPUTS, "diagnostics")]
    return [f"{topic}:{listeners[topic]}" for topic in sorted(published)]


def _listeners(graph: "Graph") -> Counter:
    """How many nodes of a graph listen to each topic."""
    return Counter(topic for node in graph.nodes for topic in inputs_of(node))


def shared_parameters(graph: "Graph", node: "GraphNode") -> dict[str, Any]:
    """Return the parameter values of a node: what it owes to its graph, then its own."""
    values: dict[str, Any] = {"qos.lossless": graph.lossless}
    if graph.lossless:
        values["qos.listeners"] = [f"{topic}:{count}" for topic, count in sorted(_listeners(graph).items())]
    if graph.scenario and node.executable in SIMULATION:
        values["scenario"] = graph.scenario
    if node.executable in SOURCES:
        values["real_time_factor"] = graph.real_time_factor
        values["start.expected_subscribers"] = expected_subscribers(graph)
        if graph.lossless:
            values["flow.listeners"] = sum(bool(set(PACED) & set(inputs_of(other))) for other in graph.nodes)
    if node.executable in NAVIGATOR_NAMES and graph.real_time_factor > 1.0:
        # transport takes wall time, the horizon counts stamps: flying faster needs a longer lag (it delays, it changes no solution)
        values["horizon.lag_s"] = min(setting_of(node, "horizon.lag_s") * graph.real_time_factor, LONGEST_LAG_S)
    return values | dict(node.parameters)


def setting_of(node: "GraphNode", name: str) -> Any:
    """Return the value a setting of a navigator has in a graph, e.g. ``horizon.lag_s``."""
    return to_mapping(_navigator_settings(node))[name]


def flown_settings(graph: "Graph") -> dict[str, dict[str, Any]]:
    """Return the complete settings of every navigator of a graph, dotted names to values, as its nodes fly with them.

    A named IMU profile is given by its numbers alone, so that a recording can be replayed where there is no such file.
    """
    flown = {}
    for node in graph.nodes:
        if node.executable in NAVIGATOR_NAMES:
            given = {name: value for name, value in shared_parameters(graph, node).items() if not name.startswith("qos.")}
            values = to_mapping(with_imu_profile(_navigator_settings(replace(node, parameters=given))))
            flown[node.executable] = {name: value for name, value in values.items() if name != "imu.profile"}
    return flown


def _navigator_settings(node: "GraphNode") -> Any:
    # the estimators and their compiler are heavy: only who runs a graph with navigators pays for them
    from lowcostnav_ros.navigators.registry import NAVIGATORS

    settings_class = NAVIGATORS[node.executable][0]
    base = load_settings(settings_class, node.config, node.name)
    known = {entry.name for entry in declared(settings_class)}
    own = {key: value for key, value in node.parameters.items() if key in known}
    return from_mapping(settings_class, {**to_mapping(base), **own}, node.name)


def navigator_of(node: "GraphNode") -> Any:
    """Build the navigator a node of a graph runs, with the very settings and stations it runs with."""
    from lowcostnav_ros.catalogue.building import make_navigator
    from lowcostnav_ros.navigators.registry import NAVIGATORS

    return make_navigator(_navigator_settings(node), NAVIGATORS[node.executable][1])
