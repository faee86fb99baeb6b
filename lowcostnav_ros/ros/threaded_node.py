"""A node that works in a thread of its own, while the main thread answers services and reports."""

import threading
from abc import abstractmethod

from lowcostnav_ros.ros.node_base import NodeBase

END_S = 5.0
"""How long the thread may take to end."""


class ThreadedNode(NodeBase):
    """Base of sources and drivers; a subclass gives :meth:`_run`, which returns once :meth:`running` is False, and calls :meth:`_begin`."""

    def _begin(self, name: str) -> None:
        """Start the thread; the last that a constructor does."""
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @abstractmethod
    def _run(self) -> None:
        """Work until there is nothing left, or the node is to stop."""

    def running(self) -> bool:
        """False once the node is to stop."""
        return not self._stopping.is_set() and self.context.ok()

    def destroy_node(self) -> None:
        """End the thread, then the node."""
        if hasattr(self, "_thread"):
            self._stopping.set()
            self._thread.join(END_S)
        super().destroy_node()
