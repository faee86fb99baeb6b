"""A node that works on a port: opened, used until it is gone, opened again; what is wrong with it is said once."""

from abc import abstractmethod

from lowcostnav_ros.ros.port import Port, PortError
from lowcostnav_ros.ros.threaded_node import ThreadedNode

REOPEN_S = 0.5
"""A port that is gone is tried again this often."""


class PortNode(ThreadedNode):
    """Base of drivers and outputs; a subclass gives :meth:`_open` and :meth:`_use`, and calls :meth:`_begin`."""

    _opened = 0
    _state, _trouble = "starting", ""

    @abstractmethod
    def _open(self) -> Port:
        """Open the port; raises PortError."""

    @abstractmethod
    def _use(self, port: Port) -> None:
        """Work on it until the node is to stop; raises PortError when it is gone."""

    def _run(self) -> None:
        while self.running():
            port = None
            try:
                port = self._open()
                self._opened += 1
                self._use(port)
            except PortError as error:
                self._say(str(error))
                self._stopping.wait(REOPEN_S)
            except Exception as error:  # bad data in flight never ends the thread
                if self.running():
                    self._say(f"error in handling: {type(error).__name__}: {error}")
                    self._stopping.wait(REOPEN_S)
            finally:
                if port is not None:
                    port.close()

    def _say(self, trouble: str, state: str = "") -> None:
        """Take over the state; a new trouble is logged once."""
        if trouble and trouble != self._trouble:
            self.get_logger().warning(trouble)
        elif self._trouble and not trouble:
            self.get_logger().info(state)
        self._trouble, self._state = trouble, state or self._state
