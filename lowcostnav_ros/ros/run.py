"""Start and stop of a node process."""

import os
import signal
import sys
from collections.abc import Callable, Sequence

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.ros.memory import release_idle_code


def run(make_node: Callable, args: Sequence[str] | None = None) -> int:
    """Run one node until it is stopped.

    Parameters
    ----------
    make_node : callable
        Builds the node, without arguments.
    args : sequence of str, optional
        Command line, default ``sys.argv``.

    Returns
    -------
    int
        0 after SIGINT or SIGTERM, one or many; 2 when the settings cannot be used (the sentence is on stderr).
    """
    # rclpy chains to this handler after it has woken its own wait, so spinning ends by shutdown and no KeyboardInterrupt can
    # break the teardown, however many signals arrive (`ros2 launch` sends a second one).
    signal.signal(signal.SIGINT, lambda *_: None)
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.impl.implementation_singleton import rclpy_implementation
    from rclpy.utilities import ok, try_shutdown

    try:
        rclpy.init(args=None if args is None else list(args))
    except rclpy_implementation.RCLError:
        if os.environ.get("ROS_SECURITY_ENABLE", "").lower() != "true":
            raise
        words = "ROS_SECURITY_ENABLE is true, but this ROS has no security, or no keys for this node: unset it, or see docs/security.md."
        print(words, file=sys.stderr)
        return Exit.CANNOT_RUN
    node = None
    try:
        node = make_node()
        release_idle_code()
        node.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except rclpy_implementation.RCLError:
        # A signal that falls between the executor's check of the context and its wait set ends the wait with this error.
        if ok():
            raise
    except SettingsError as error:
        print(error, file=sys.stderr)
        return Exit.CANNOT_RUN
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if node is not None:
            node.destroy_node()
        try_shutdown()
    return getattr(node, "exit_status", Exit.OK)
