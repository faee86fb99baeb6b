"""Show the flight in a browser, live: attitude, tapes, map, modes, tests of the aids, inputs, and the buttons for the services."""

import queue
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.client import Client
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.catalogue.equipment import load_stations
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.graph.page.picture import Picture
from lowcostnav_ros.graph.page.server import USUAL_PORT, PageServer, parse_listen, token_for, with_token
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.radionav.station_cells import StationError
from lowcostnav_ros.radionav.stations import Station
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import ERROR, OK, Status
from lowcostnav_ros.ros.node_base import NodeBase, message_class

FRAME_S, TABLES_S = 0.1, 1.0
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


@dataclass
class _Asked:
    """A service that a viewer wants called, and its answer."""

    node: str
    verb: str
    answered: threading.Event = field(default_factory=threading.Event)
    answer: tuple[bool, str] = (False, "no answer")


@executable("page", kind="monitor", Settings=PageSettings, compiled=False)
class Page(NodeBase):
    """Listen to what the nodes report and to what can be drawn, best effort, and serve it; a graph flies the same with it or without."""

    poll_period_s = 0.04

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("page", [PageSettings()], **kwargs)
        self._server: PageServer | None = None
        self._trouble, self._try_at, self._said = "", 0.0, ""
        self._lock = threading.Lock()
        self._asked: queue.Queue[_Asked] = queue.Queue(MOST_ASKED)
        self._service_clients: dict[str, Client] = {}
        self._heard_topics: set[str] = set()
        self._frame_at = self._tables_at = 0.0
        settings: PageSettings = self.parameters.settings[0]
        try:
            self._listen = parse_listen(settings.listen)
            self.picture = Picture(_stations(settings.stations))
        except (SettingsError, StationError, OSError) as error:
            self.destroy_node()
            raise SettingsError(f"page: {error}") from error
        self._token = token_for(self._listen[0])
        self.subscribe(DiagnosticArray, "/diagnostics", self._report, qos.sensor_subscription())
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
        with self._lock:
            count = super().poll()
        now = time.monotonic()
        if now >= self._tables_at:
            self._tables_at = now + TABLES_S
            self._guarded(self._look_around)
        if now >= self._frame_at:
            self._frame_at = max(self._frame_at + FRAME_S, now)
            self._guarded(self._show_flight)
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

    def _guarded(self, work: Any) -> None:
        """Do what shows something; what cannot be shown is no reason to stop showing the rest."""
        try:
            with self._lock:
                work()
        except Exception as error:
            if not self.context.ok():
                raise
            if (said := type(error).__name__) != self._said:
                self._said = said
                self.get_logger().error(f"part of the page cannot be drawn: {said}: {error}")

    def _report(self, raw: bytes) -> None:
        from lowcostnav_ros.messages.store import from_cdr

        try:
            message = from_cdr(raw, "diagnostic_msgs/msg/DiagnosticArray")
        except Exception:  # not a message of ours
            return
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.picture.report(status.name, int(status.level), status.message, values, status.hardware_id)

    def _look_around(self) -> None:
        """Once a second: listen to what is new, draw the tracks on, show the tables."""
        for topic, kind in self.picture.wanted():
            if topic not in self._heard_topics:
                self._heard_topics.add(topic)
                self._listen_to(topic, kind)
        self.picture.follow()
        if self._server is None and time.monotonic() >= self._try_at:
            self._open()
        if self._server is not None:
            self._server.show("tables", self.picture.tables())

    def _listen_to(self, topic: str, kind: Kind) -> None:
        profile = qos.latched() if kind.latched else QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.subscribe(message_class(kind.msgtype), topic, partial(self.picture.take, topic.lstrip("/"), kind), profile)

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


def _stations(tables: Iterable[str]) -> list[Station]:
    return list({station.ident: station for table in tables for station in load_stations(table)}.values())
