"""The graph files of the package, for users of ros2 launch, alone or included in a launch file of their own.

    ros2 launch lowcostnav_ros lowcostnav.launch.py graph:=livermore namespace:=plane1 page:=false

The same graphs come up without ros2 launch by `lowcostnav up <graph>`, which also counts listeners, restarts what dies and shows a table.
"""

try:
    from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
    from launch_ros.actions import Node

    from launch import LaunchDescription
except ImportError as error:
    raise ImportError("ros2 launch is not installed here (it does not come by pip); use 'lowcostnav up <graph>' instead.") from error

from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.wiring import completed, shared_parameters, with_page

ARGUMENTS = {
    "graph": ("livermore", "a graph of the package, or the path of a YAML file"),
    "namespace": ("", "namespace of all nodes, so that two aircraft fly side by side"),
    "params_file": ("", "a parameter file whose values come last"),
    "use_sim_time": ("false", "take time from /clock; stamps rule either way"),
    "log_level": ("info", "debug, info, warn, error"),
    "page": ("true", "the page that shows the flight in a browser"),
}


def _nodes(context):
    given = context.launch_configurations
    graph = completed(load_graph(given["graph"]))
    graph = graph if given["page"].lower() == "false" else with_page(graph)
    last = [{"use_sim_time": given["use_sim_time"].lower() == "true"}, *filter(None, [given["params_file"]])]
    nodes = [
        Node(
            package="lowcostnav_ros",
            executable=node.executable,
            name=node.name,
            namespace=given["namespace"],
            parameters=[*([str(node.config)] if node.config else []), shared_parameters(graph, node), *last],
            arguments=["--ros-args", "--log-level", given["log_level"]],
            respawn=node.respawn,
            output="screen",
        )
        for node in graph.nodes
    ]
    domain = [] if graph.domain is None else [SetEnvironmentVariable("ROS_DOMAIN_ID", str(graph.domain))]
    return [*domain, *nodes]


def generate_launch_description():
    """Return the description that ros2 launch asks for."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=what) for name, (value, what) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])
