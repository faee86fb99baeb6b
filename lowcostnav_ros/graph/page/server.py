"""The server of the page: three files, one stream of events a viewer, one way to call a service; standard library only.

Nothing of it can hold up the node: frames are handed to bounded queues, and a viewer that does not keep up is let go (its browser comes
back by itself).  Requests are answered from a fixed table, so no path leads to a file of this machine.  A web page of somebody else, opened
in the same browser, can neither read nor do anything: the Host must be an address or a name of this machine, which defeats DNS
rebinding, and what comes from another origin is refused.
"""

import contextlib
import hmac
import ipaddress
import json
import math
import os
import queue
import secrets
import socket
import socketserver
import threading
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs, quote, unquote, urlencode, urlsplit

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.catalogue.background import airports, coast

USUAL_PORT, TRIED_PORTS = 8040, 20
MOST_VIEWERS, MOST_CONNECTIONS = 8, 32
QUEUE = 30  # frames: three seconds; a viewer further behind is let go
SOCKET_S = 5.0
SEND_BUFFER = 1 << 16  # what a viewer that does not read can make the system keep
LONGEST_BODY = 1000
COOKIE = "lowcostnav"
TOKEN = "LOWCOSTNAV_PAGE_TOKEN"
"""Environment variable with the token of a page; it is no parameter, which anybody could read, and a recording would keep."""
SCRIPT, AROUND_DEG = "text/javascript", 2.0
ASSETS = {
    "/": ("graph/page/assets/page.html", "text/html"),
    "/page.css": ("graph/page/assets/page.css", "text/css"),
    "/page.js": ("graph/page/assets/page.js", SCRIPT),
    "/map.js": ("graph/page/assets/map.js", SCRIPT),
    "/instruments.js": ("report/instruments.js", SCRIPT),
}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


def parse_listen(text: str) -> tuple[str, int]:
    """Return (address, port) of ``127.0.0.1:8040``, ``[::1]:8040``, an address or a port alone; port 0 is any that is free.

    Raises
    ------
    SettingsError
        For what is neither.
    """
    if text.isdecimal():
        host, port = "127.0.0.1", text
    elif text.startswith("[") or text.count(":") == 1:
        host, _, port = text.rpartition(":")
    else:
        host, port = text, ""
    host = host.strip("[]")
    with contextlib.suppress(ValueError):
        address = str(ipaddress.ip_address("127.0.0.1" if host == "localhost" else host))
        if not port or (port.isdecimal() and int(port) < 65536):
            return address, int(port or USUAL_PORT)
    raise SettingsError(f"listen: '{text}' must be an address and a port, such as 127.0.0.1:{USUAL_PORT} or 0.0.0.0:{USUAL_PORT}.")


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach an address."""
    return ipaddress.ip_address(address).is_loopback


def token_for(address: str) -> str:
    """Return the token for a page at an address: none for this machine alone, else that of the environment, or a new one."""
    return "" if is_loopback(address) else os.environ.get(TOKEN, "") or secrets.token_urlsafe(16)


def with_token(address: str, token: str) -> str:
    """Return what is typed into a browser."""
    return f"{address}?{urlencode({'token': token})}" if address and token else address


class PageServer(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """Serve the page until :meth:`close`.

    Parameters
    ----------
    listen : (str, int)
        Address and port; where the port is taken, one of the next twenty, else any.
    token : str
        Asked of every viewer; empty on loopback.
    welcome : callable
        Returns the event a new viewer gets first, as (name, content).
    act : callable
        Called with (node, verb) by a button; returns (success, sentence).

    Raises
    ------
    OSError
        When the address cannot be listened on.
    """

    daemon_threads, allow_reuse_address, request_queue_size = True, True, 16

    def __init__(
        self,
        listen: tuple[str, int],
        token: str,
        welcome: Callable[[], tuple[str, Any]],
        act: Callable[[str, str], tuple[bool, str]],
    ) -> None:
        self.token, self.welcome, self.act = token, welcome, act
        self.dropped = 0
        self._viewers: set[queue.Queue[bytes | None]] = set()
        self._lock, self._room = threading.Lock(), threading.Semaphore(MOST_CONNECTIONS)
        address, port = listen
        self.address_family = socket.AF_INET6 if ":" in address else socket.AF_INET
        for attempt in (*(range(port, min(port + TRIED_PORTS, 65536)) if port else ()), 0):
            try:
                super().__init__((address, attempt), _Request)
                break
            except OSError as error:
                if not attempt or error.errno not in (98, 13):  # in use, not permitted
                    raise
        own = socket.gethostname().lower()
        self.names = {"localhost", own, own.partition(".")[0], f"{own}.local"}
        self._thread = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.1}, name="page", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Address of the page, without the token."""
        host, port = str(self.server_address[0]), self.server_address[1]
        shown = socket.gethostname() if ipaddress.ip_address(host).is_unspecified else f"[{host}]" if ":" in host else host
        return f"http://{shown}:{port}/"

    @property
    def viewers(self) -> int:
        """How many look."""
        return len(self._viewers)

    def show(self, event: str, content: Any) -> None:
        """Send an event to all viewers; never blocks."""
        if not self._viewers:
            return
        frame = _frame(event, content)
        with self._lock:
            for viewer in list(self._viewers):
                try:
                    viewer.put_nowait(frame)
                except queue.Full:
                    self._viewers.discard(viewer)
                    self.dropped += 1

    def close(self) -> None:
        """Let everybody go and stop."""
        with self._lock:
            for viewer in self._viewers:
                with contextlib.suppress(queue.Full):
                    viewer.put_nowait(None)
            self._viewers.clear()
        self.shutdown()
        self.server_close()

    @contextlib.contextmanager
    def looking(self) -> Iterator[queue.Queue[bytes | None] | None]:
        """A queue of frames for one more viewer, None when there are too many."""
        frames: queue.Queue[bytes | None] = queue.Queue(QUEUE)
        with self._lock:
            has_room = len(self._viewers) < MOST_VIEWERS
            if has_room:
                self._viewers.add(frames)
        try:
            yield frames if has_room else None
        finally:
            with self._lock:
                self._viewers.discard(frames)

    def is_looking(self, frames: queue.Queue[bytes | None]) -> bool:
        """Whether a viewer has not been let go."""
        return frames in self._viewers

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start a thread for a connection; beyond :data:`MOST_CONNECTIONS` it is closed at once."""
        if not self._room.acquire(blocking=False):
            self.shutdown_request(request)
            return
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that breaks is of no interest."""


def _frame(event: str, content: Any) -> bytes:
    return f"event: {event}\ndata: {json.dumps(content, separators=(',', ':'), allow_nan=False)}\n\n".encode()


def _background(query: str) -> dict[str, Any]:
    """Coast and airports around the place that a query names; nothing around none."""
    asked = parse_qs(query)
    try:
        lat, lon = (float(asked[name][0]) for name in ("lat", "lon"))
    except (KeyError, ValueError):
        lat = lon = math.nan
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        return {"coast": [], "airports": []}
    half = AROUND_DEG / max(math.cos(math.radians(lat)), 0.1)
    square = lat - AROUND_DEG, lon - half, lat + AROUND_DEG, lon + half
    places = [{"ident": one.ident, "lat": one.lat_deg, "lon": one.lon_deg} for one in airports(*square)]
    return {"coast": [line.round(3).tolist() for line in coast(*square)], "airports": places}


class _Request(BaseHTTPRequestHandler):
    """One connection, one answer."""

    server: PageServer
    server_version, sys_version = "lowcostnav", ""
    timeout = SOCKET_S

    def setup(self) -> None:
        super().setup()
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    def do_GET(self) -> None:
        """A file of the page, or the stream of events."""
        path = urlsplit(self.path).path
        if not self._is_welcome():
            return
        if path == "/events":
            self._stream()
        elif path in ASSETS:
            name, kind = ASSETS[path]
            self._answer(HTTPStatus.OK, (files("lowcostnav_ros") / name).read_bytes(), kind)
        elif path == "/background":
            self._answer(HTTPStatus.OK, json.dumps(_background(urlsplit(self.path).query)).encode(), "application/json")
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        """A button: the body is ``{"node": ..., "verb": ...}``; the answer ``{"success": ..., "message": ...}``."""
        if not self._is_welcome():
            return
        asked = self._asked()
        if self.path != "/do" or asked is None:
            self._refuse(HTTPStatus.BAD_REQUEST, "this is not what a button sends")
            return
        success, message = self.server.act(*asked)
        self._answer(HTTPStatus.OK, json.dumps({"success": success, "message": message}).encode(), "application/json")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing is logged for a request."""

    def _asked(self) -> tuple[str, str] | None:
        length = self.headers.get("Content-Length", "")
        if self.headers.get_content_type() != "application/json" or not length.isdecimal() or int(length) > LONGEST_BODY:
            return None  # what a form of another page sends cannot be JSON
        with contextlib.suppress(ValueError, KeyError, TypeError, RecursionError):
            content = json.loads(self.rfile.read(int(length)))
            if isinstance(content["node"], str) and isinstance(content["verb"], str):
                return content["node"], content["verb"]
        return None

    def _is_welcome(self) -> bool:
        """Whether the request comes from a page of ours by a name of ours, with the token; if not, it is refused."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if not self._is_own(host):
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST, "the page goes by an address or a name of this machine")
        elif origin not in (None, f"http://{host}") or self.headers.get("Sec-Fetch-Site") == "cross-site" and self.command != "GET":
            self._refuse(HTTPStatus.FORBIDDEN, "requests of other pages are not answered")
        elif not self._has_token():
            self._refuse(HTTPStatus.FORBIDDEN, "the address with the token is printed where the graph was started")
        else:
            return True
        return False

    def _is_own(self, host: str) -> bool:
        with contextlib.suppress(ValueError):
            name = urlsplit(f"//{host}").hostname or ""
            if name.lower() in self.server.names:
                return True
            address = ipaddress.ip_address(name)
            return address.is_loopback or not is_loopback(str(self.server.server_address[0]))
        return False

    def _has_token(self) -> bool:
        if not self.server.token:
            return True
        given = parse_qs(urlsplit(self.path).query).get("token", [""])[0]
        with contextlib.suppress(CookieError):
            morsel = SimpleCookie(self.headers.get("Cookie", "")).get(COOKIE)
            given = given or (unquote(morsel.value) if morsel else "")
        return hmac.compare_digest(given.encode(), self.server.token.encode())

    def _stream(self) -> None:
        with self.server.looking() as frames:
            if frames is None:
                self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_VIEWERS} look already")
                return
            self.close_connection = True
            self._head(HTTPStatus.OK, "text/event-stream")
            with contextlib.suppress(OSError):
                self.wfile.write(_frame(*self.server.welcome()))
                while (frame := self._next(frames)) is not None:
                    self.wfile.write(frame)

    def _next(self, frames: "queue.Queue[bytes | None]") -> bytes | None:
        """The next frame, a comment where there is none (it finds out whether the viewer is there), None at the end."""
        try:
            return frames.get(timeout=SOCKET_S) if self.server.is_looking(frames) else None
        except queue.Empty:
            return b":\n\n"

    def _answer(self, status: HTTPStatus, body: bytes, kind: str) -> None:
        self._head(status, kind, len(body))
        with contextlib.suppress(OSError):
            self.wfile.write(body)

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self._answer(status, f"Refused: {why}.\n".encode(), "text/plain")

    def _head(self, status: HTTPStatus, kind: str, length: int | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        if length is not None:
            self.send_header("Content-Length", str(length))
        if self.server.token and status == HTTPStatus.OK:
            self.send_header("Set-Cookie", f"{COOKIE}={quote(self.server.token)}; HttpOnly; SameSite=Strict; Path=/")
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
