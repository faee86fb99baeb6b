"""`ros2 launch lowcostnav_ros lowcostnav.launch.py graph:=livermore`: the graph files of the package, for users of ros2 launch.

The same graphs come up without ros2 launch by `lowcostnav up <graph>`, which also counts listeners, restarts what dies and shows a table.
"""

try:
    from launch.actions import DeclareLaunchArgument, OpaqueFunction
    from launch_ros.actions import Node

    from launch import LaunchDescription
except ImportError as error:
    raise ImportError("ros2 launch is not installed here (it does not come by pip); use 'lowcostnav up <graph>' instead.") from error

from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.wiring import shared_parameters


def _nodes(context):
    graph = load_graph(context.launch_configurations["graph"])
    return [
        Node(
            package="lowcostnav_ros",
            executable=node.executable,
            name=node.name,
            parameters=[*([str(node.config)] if node.config else []), shared_parameters(graph, node)],
            respawn=node.respawn,
            output="screen",
        )
        for node in graph.nodes
    ]


def generate_launch_description():
    """Return the description that ros2 launch asks for."""
    return LaunchDescription([DeclareLaunchArgument("graph", default_value="livermore"), OpaqueFunction(function=_nodes)])
