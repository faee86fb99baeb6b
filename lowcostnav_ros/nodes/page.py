"""Show the flight in a browser, live: attitude, tapes, map, modes, tests of the aids, inputs, and the buttons for the services."""

import queue
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from rclpy.client import Client
from std_srvs.srv import Trigger

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.graph.page.server import USUAL_PORT, PageServer, parse_listen, token_for, with_token
from lowcostnav_ros.ros.input_monitor import ERROR, OK, Status
from lowcostnav_ros.ros.watching_node import WatchingNode

FRAME_S = 0.1
ANSWER_S = 5.0  # within which a service must answer
AGAIN_S = 2.0  # until an address that could not be listened on is tried again
MOST_ASKED, MOST_CLIENTS = 8, 64


@dataclass(frozen=True)
class PageSettings:
    """Settings of the page."""

    listen: str = setting(
        f"127.0.0.1:{USUAL_PORT}",
        "Address and port of the page; the next free port where it is taken.  Beyond this machine a token is asked for.",
    )
    stations: list[str] = setting([], "Station tables to draw; a graph gives those of its navigators.")

    def __post_init__(self) -> None:
        parse_listen(self.listen)


@dataclass
class _Asked:
    """A service that a viewer wants called, and its answer."""

    node: str
    verb: str
    answered: threading.Event = field(default_factory=threading.Event)
    answer: tuple[bool, str] = (False, "no answer")


@executable("page", kind="monitor", Settings=PageSettings, compiled=False)
class Page(WatchingNode):
    """Serve what there is to see; viewers get a frame ten times a second."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("page", [PageSettings()], **kwargs)
        self._server: PageServer | None = None
        self._trouble, self._try_at = "", 0.0
        self._lock = threading.Lock()
        self._asked: queue.Queue[_Asked] = queue.Queue(MOST_ASKED)
        self._service_clients: dict[str, Client] = {}
        self._frame_at = 0.0
        settings: PageSettings = self.parameters.settings[0]
        self._listen = parse_listen(settings.listen)
        self._token = token_for(self._listen[0])
        self._open()

    def rows(self) -> Iterable[Status]:
        """One row: the address, without its token."""
        server = getattr(self, "_server", None)
        if server is None:
            yield Status(f"{self.get_name()}: page", ERROR, f"cannot be shown: {getattr(self, '_trouble', '')}", {"address": ""})
        else:
            values = {"address": server.address, "viewers": str(server.viewers), "viewers_dropped": str(server.dropped)}
            looking = f"{server.viewers} viewer{'' if server.viewers == 1 else 's'}"
            yield Status(f"{self.get_name()}: page", OK, f"{server.address}, {looking}", values)

    def poll(self) -> int:
        """Take what has come; show what is due; call what was asked for."""
        count = super().poll()
        now = time.monotonic()
        if now >= self._frame_at:
            self._frame_at = max(self._frame_at + FRAME_S, now)
            self.guarded(self._show_flight)
        self._call()
        return count

    def destroy_node(self) -> None:
        """Close the page, then the node."""
        server = getattr(self, "_server", None)
        if server is not None:
            server.close()
        super().destroy_node()

    def _open(self) -> None:
        """Listen; an address that cannot be listened on now may be there later, and must not end a flight."""
        try:
            self._server = PageServer(self._listen, self._token, self._welcome, self._act)
        except OSError as error:
            self._trouble = f"{self._listen[0]} port {self._listen[1]}: {(error.strerror or str(error)).lower()}"
            self._try_at = time.monotonic() + AGAIN_S
            return
        print(f"The flight is shown at {with_token(self._server.address, self._token)}", flush=True)

    def look_around(self) -> None:
        """Once a second: what is new, the tables, and another try to listen where that failed."""
        with self._lock:
            super().look_around()
        if self._server is None and time.monotonic() >= self._try_at:
            self._open()
        if self._server is not None and self._server.viewers:
            self._server.show("tables", self.picture.tables())

    def _show_flight(self) -> None:
        if self._server is not None and self._server.viewers:
            self._server.show("flight", self.picture.flight())

    def _welcome(self) -> tuple[str, Any]:
        with self._lock:
            return "chart", self.picture.chart()

    def _act(self, node: str, verb: str) -> tuple[bool, str]:
        """Have a service called, from the thread of a viewer."""
        asked = _Asked(node, verb)
        try:
            self._asked.put_nowait(asked)
        except queue.Full:
            return False, "too much is asked at once; try again"
        asked.answered.wait(ANSWER_S)
        return asked.answer

    def _call(self) -> None:
        """Call what viewers have asked for; the answers come through the executor."""
        while not self._asked.empty():
            asked = self._asked.get_nowait()
            service = self.picture.service_of(asked.node, asked.verb)
            client = self._client(service) if service else None
            if client is None or not client.service_is_ready():
                asked.answer = False, f"{asked.node} offers no {asked.verb}" if client is None else f"{asked.node} does not answer"
                asked.answered.set()
                continue
            client.call_async(Trigger.Request()).add_done_callback(partial(_answer, asked))

    def _client(self, service: str) -> Client | None:
        if service not in self._service_clients and len(self._service_clients) < MOST_CLIENTS:
            self._service_clients[service] = self.create_client(Trigger, service)
            deadline = time.monotonic() + 1.0  # once: its server has to be discovered
            while not self._service_clients[service].service_is_ready() and time.monotonic() < deadline:
                time.sleep(0.01)
        return self._service_clients.get(service)


def _answer(asked: _Asked, future: Any) -> None:
    response = future.result()
    asked.answer = response.success, response.message
    asked.answered.set()
