"""The page of the flight: what it shows of messages, what its server refuses, and what a browser sees when a node is killed."""

import http.client
import importlib
import json
import math
import os
import signal
import socket
import time
from itertools import count

import numpy as np
import pytest
from browser import Browser

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.graph.page import server as serving
from lowcostnav_ros.graph.page.picture import MOST_TOPICS, TRACK_POINTS, Picture
from lowcostnav_ros.graph.page.server import MOST_VIEWERS, PageServer, parse_listen, token_for, with_token
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import euler_to_quat

ORIGIN = LocalFrame(0.65, -2.1, 300.0)


def solution(stamp_ns=10**9, north_m=0.0):
    """Banked 10 degrees right on a heading of 300 with 60 m/s to the north-west, sigmas 30 m along north and 10 m along east."""
    q = euler_to_quat(math.radians(10.0), math.radians(2.0), math.radians(300.0))
    cov = np.diag([900.0, 100.0, 25.0])
    place = 0.65 + north_m / 6.36e6, -2.1, 1300.0
    return NavSolution(
        stamp_ns, "toy", *place, np.array([30.0, -52.0, -1.0]), q, np.zeros(3), None, cov, 0.25 * np.eye(3), 1e-4 * np.eye(3)
    )


class Seen(Picture):
    """A picture of one navigator, `toy`, at a time of our own."""

    def __init__(self):
        self.now = 0.0
        super().__init__(clock=lambda: self.now)
        self.report("toy: navigator", 1, "coasting: no GPS for 3 s", {"mode": "coasting", "flying_on": ""}, "/toy 7")
        for part in ("odometry", "origin", "wind"):
            self.report(f"toy: output toy/{part}", 0, "", {"count": "1"}, "/toy 7")
        self.follow()
        self.hear("toy/origin", encode.origin_fix(10**9, ORIGIN))

    def hear(self, source, message):
        self.take(source, topics.spec(source), to_cdr(message))


def test_what_is_drawn_is_what_the_solution_says_and_grows_old():
    seen = Seen()
    assert {name for name, _ in seen.wanted()} == {"/toy/odometry", "/toy/origin", "/toy/wind"}
    assert "lat" not in seen.flight()["navigators"]["toy"]
    seen.hear("toy/odometry", encode.odometry_from_solution(solution(), ORIGIN))
    seen.hear("toy/wind", encode.wind_message(10**9, np.array([0.0, 8.0]), np.eye(2)))
    seen.now = 0.7
    toy = seen.flight()["navigators"]["toy"]
    assert (toy["age"], toy["level"], toy["message"]) == (0.7, 1, "coasting: no GPS for 3 s")
    assert (toy["roll"], toy["pitch"], toy["heading"]) == pytest.approx((10.0, 2.0, 300.0), abs=0.01)
    assert (toy["lat"], toy["lon"]) == pytest.approx((math.degrees(0.65), math.degrees(-2.1)), abs=1e-6)
    assert toy["ellipse"] == (60.0, 20.0, 0.0) and toy["height_bound"] == 10.0
    assert toy["speed"] == pytest.approx(60.03, abs=0.01) and toy["track"] == pytest.approx(300.0, abs=0.05) and toy["climb"] == 1.0
    assert (toy["wind"], toy["wind_from"], toy["wind_bound"]) == (8.0, 270, 2.0)  # it blows to the east
    assert toy["airspeed"] == pytest.approx(math.sqrt(30.0**2 + 60.0**2 + 1.0), abs=0.01)
    assert 1320.0 < toy["msl"] < 1350.0  # the geoid of California lies 30 m below the ellipsoid
    seen.now = 9.0
    toy = seen.flight()["navigators"]["toy"]
    assert (toy["age"], toy["level"], toy["message"]) == (9.0, 2, "no report") and "wind" not in toy
    assert seen.tables()["nodes"]["toy"]["message"] == "no report for 9 s"


def test_what_a_stranger_sends_neither_breaks_nor_fills_the_picture():
    seen = Seen()
    for number in range(3000):
        seen.report(f"n{number}: input x", 9, "<script>", {"age_s": "nan", "rate_hz": "x"}, "/n 1")
    seen.report("bad: output toy/odometry", 0, "", {"count": "1"}, "no path 7")
    for number in range(300):
        seen.take(f"x{number}/odometry", topics.spec(f"x{number}/odometry"), b"not a message")
    seen.hear("toy/odometry", encode.odometry_from_solution(solution(), ORIGIN))
    seen.take("toy/odometry", topics.spec("toy/odometry"), b"\0\1\0\0")
    content = json.dumps([seen.flight(), seen.tables(), seen.chart()], allow_nan=False)
    assert len(content) < 500_000 and len(seen._topics) == MOST_TOPICS and "lat" not in seen.flight()["navigators"]["toy"]
    assert seen.service_of("toy", "reset") == "/toy/reset"
    assert not seen.service_of("toy", "calibrate_start") and not seen.service_of("toy", "x") and not seen.service_of("n1", "reset")


def test_a_track_of_days_stays_small_and_keeps_both_ends():
    seen = Seen()
    for second in range(1, 3 * TRACK_POINTS):
        seen.hear("toy/odometry", encode.odometry_from_solution(solution(second * 10**9, float(second)), ORIGIN))
        seen.follow()
    (track,) = seen.chart()["tracks"].values()
    assert TRACK_POINTS / 2 < len(track) <= TRACK_POINTS
    assert (track[-1][0] - track[0][0]) * math.pi / 180 * 6.36e6 == pytest.approx(3 * TRACK_POINTS, rel=0.01)


@pytest.mark.parametrize(
    ("text", "means"),
    [("127.0.0.1:80", ("127.0.0.1", 80)), ("9000", ("127.0.0.1", 9000)), ("0.0.0.0", ("0.0.0.0", 8040)), ("[::1]:7", ("::1", 7))],
)
def test_where_to_listen_is_read(text, means):
    assert parse_listen(text) == means


@pytest.mark.parametrize("text", ["", "example.org:80", "127.0.0.1:99999", "127.0.0.1:x", "a:b:c"])
def test_where_nobody_can_listen_is_one_sentence(text):
    with pytest.raises(SettingsError, match="must be an address and a port"):
        parse_listen(text)


def test_only_beyond_this_machine_a_token_is_made_and_an_address_carries_it(monkeypatch):
    monkeypatch.delenv(serving.TOKEN, raising=False)
    assert token_for("127.0.0.1") == token_for("::1") == "" and len(token_for("0.0.0.0")) > 16
    assert with_token("http://h:1/", "a b") == "http://h:1/?token=a+b" and with_token("http://h:1/", "") == "http://h:1/"


@pytest.fixture
def serve():
    """Start servers; all are closed at the end."""
    started = []

    def start(token="", act=lambda node, verb: (True, f"{node} {verb}")):
        started.append(PageServer(("127.0.0.1", 0), token, lambda: ("chart", {"stations": []}), act))
        return started[-1]

    yield start
    for one in started:
        one.close()


def ask(server, method="GET", path="/", body=None, **headers):
    """Status and text of the answer; header names with _ for -."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=5.0)
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    text = "" if path.startswith("/events") and answer.status == 200 else answer.read().decode()
    connection.close()
    return answer.status, text, answer.headers


def test_the_files_of_the_page_are_served_and_small(serve):
    server = serve()
    pages = {path: ask(server, path=path) for path in serving.ASSETS}
    assert all(status == 200 for status, _, _ in pages.values()) and sum(len(text) for _, text, _ in pages.values()) < 300_000
    assert "default-src 'self'" in pages["/"][2]["Content-Security-Policy"] and "http" not in pages["/"][1]


def test_the_map_has_coast_and_airports_around_a_place_that_is_one(serve):
    server = serve()
    found = json.loads(ask(server, path="/background?lat=37.7&lon=-121.8")[1])
    assert any(a["ident"] == "KLVK" for a in found["airports"]) and sum(map(len, found["coast"])) > 50
    for query in ("", "?lat=x&lon=1", "?lat=nan&lon=0", "?lat=inf&lon=0", "?lat=1e9&lon=0", "?lat=1"):
        assert json.loads(ask(server, path=f"/background{query}")[1]) == {"coast": [], "airports": []}


@pytest.mark.parametrize(
    "path", ["/../../../etc/passwd", "/%2e%2e/page.py", "/page.js/../server.py", "//etc/passwd", "/assets/page.js", "/\0"]
)
def test_no_path_leads_to_a_file(serve, path):
    connection = socket.create_connection(("127.0.0.1", serve().server_address[1]), timeout=5.0)
    connection.sendall(f"GET {path} HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n".encode())
    answer = connection.makefile("rb").read()
    assert answer.split(b"\r\n")[0].split()[1] in (b"404", b"400") and b"root:" not in answer and b"import" not in answer


def test_another_host_another_page_and_a_wrong_token_are_refused(serve):
    server = serve()
    for host in ("evil.example", "127.0.0.1.evil.example", "8.8.8.8", "", "[", "localhost@evil.example:80"):
        assert ask(server, Host=host)[0] == 421, host
    assert ask(server, Host="localhost:1")[0] == ask(server, Host="[::1]:1")[0] == 200
    button = {"body": json.dumps({"node": "toy", "verb": "reset"}), "Content_Type": "application/json"}
    assert ask(server, "POST", "/do", **button)[:2] == (200, '{"success": true, "message": "toy reset"}')
    assert ask(server, "POST", "/do", Origin="http://evil.example", **button)[0] == 403
    assert ask(server, "POST", "/do", Sec_Fetch_Site="cross-site", **button)[0] == 403
    assert ask(server, path="/events", Origin="http://evil.example")[0] == 403
    assert ask(server, "POST", "/do", **(button | {"Content_Type": "text/plain"}))[0] == 400
    for body in ("{}", "[]", "7", "x", '{"node": 1, "verb": "reset"}', "[" * 900, "a" * 2000):
        assert ask(server, "POST", "/do", **(button | {"body": body}))[0] == 400
    guarded = serve(token="right")
    assert ask(guarded)[0] == ask(guarded, path="/?token=wrong")[0] == ask(guarded, Cookie="lowcostnav=wrong")[0] == 403
    status, _, headers = ask(guarded, path="/?token=right")
    assert status == 200 and "HttpOnly; SameSite=Strict" in headers["Set-Cookie"]
    assert ask(guarded, Cookie="lowcostnav=right")[0] == 200 and ask(guarded, path="/events", Cookie="lowcostnav=right")[0] == 200
    assert ask(guarded, "POST", "/do", **button)[0] == 403


def looking(server):
    """A connection to the stream, its head read."""
    viewer = socket.create_connection(("127.0.0.1", server.server_address[1]), timeout=5.0)
    viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    viewer.sendall(b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n")
    assert b"200" in viewer.recv(100)
    return viewer


def test_a_viewer_who_does_not_read_is_let_go_and_holds_nothing_up(serve):
    server = serve()
    viewer, frames = looking(server), count()
    wait_until(lambda: server.viewers == 1)
    big = {"words": "x" * 50_000}
    began = time.process_time()
    while server.viewers and next(frames) < 500:
        server.show("flight", big)
    assert server.dropped == 1 and server.viewers == 0 and time.process_time() - began < 2.0
    viewer.close()


def test_there_are_never_more_viewers_than_there_is_room_for(serve):
    server = serve()
    viewers = [looking(server) for _ in range(MOST_VIEWERS)]
    wait_until(lambda: server.viewers == MOST_VIEWERS)
    assert ask(server, path="/events")[:2] == (503, f"Refused: {MOST_VIEWERS} look already.\n")
    for viewer in viewers:
        viewer.close()


def test_a_taken_port_is_passed_by(serve):
    taken = serve()
    other = PageServer(("127.0.0.1", taken.server_address[1]), "", lambda: ("chart", {}), lambda *_: (True, ""))
    assert other.server_address[1] != taken.server_address[1]
    other.close()


def wait_until(condition, timeout_s=5.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


TOY = '''
"""A navigator in nothing but name: it circles, and publishes what every navigator does."""

import math
import time

from test_page import ORIGIN, solution
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.messages import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.ros.input_monitor import Status
from lowcostnav_ros.ros.node_base import NodeBase, ResetRefusedError


@executable("toy", kind="node", compiled=False)
class Toy(NodeBase):
    def __init__(self, **kwargs):
        super().__init__("toy", **kwargs)
        self.create_timer(0.05, self.fly)
        self.output("toy/origin").send(to_cdr(encode.origin_fix(10**9, ORIGIN)))

    def fly(self):
        now = time.time_ns()
        flown = encode.odometry_from_solution(solution(now, 1e-9 * now % 1000 * 60.0), ORIGIN)
        self.output("toy/odometry").send(to_cdr(flown))

    def rows(self):
        yield from super().rows()
        yield Status("toy: navigator", 0, "gps: <b>good</b>", {"mode": "gps", "flying_on": ""})
        yield Status("toy: aid gps_position", 0, "used", {"test_ratio": "0.4", "age_s": "0.1", "fused": "7", "rejected": "0"})

    def reset(self, reason):
        raise ResetRefusedError("toy flies without GPS; ask again")
'''
FRESH = "document.querySelector('#link').textContent == 'live' && !document.querySelector('#banner').textContent"


def test_a_browser_sees_a_graph_fly_a_node_die_and_come_back(tmp_path, monkeypatch):
    pytest.importorskip("rclpy")
    from lowcostnav_ros.graph.description import parse_graph
    from lowcostnav_ros.graph.executables import NODES
    from lowcostnav_ros.graph.runner import GraphRunner
    from lowcostnav_ros.graph.wiring import with_page

    here = os.path.dirname(__file__)
    (tmp_path / "toy_navigator.py").write_text(TOY)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), here, os.path.dirname(here), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("LOWCOSTNAV_PLUGINS", "toy_navigator")
    importlib.import_module("toy_navigator")  # plugins are loaded once a process
    graph = with_page(parse_graph({"nodes": ["toy"]}, "toys"), "127.0.0.1:0")
    browser = Browser(tmp_path)
    try:
        with GraphRunner(graph, log_dir=tmp_path / "logs") as runner:
            assert runner.wait_for(lambda: runner.page, 20.0)
            browser.open(runner.page)
            browser.wait_for(FRESH)
            assert browser.value("document.querySelector('.chip').innerText") == "toy\ngps: <b>good</b>"  # text, never markup
            browser.wait_for("document.querySelector('#aids').innerText.includes('gps_position')")
            before = ink(browser)
            os.kill(runner.processes["toy"].process.pid, signal.SIGKILL)
            browser.wait_for("document.querySelector('#banner').textContent.startsWith('toy: no data for')")
            assert ink(browser) != before and browser.value("document.querySelector('.chip').className") == "chip l2"
            assert "\u2715 toy: no data for" in browser.value("document.querySelector('#nodes .t2').innerText")
            assert runner.wait_for(lambda: runner.processes["toy"].restarts == 1, 10.0)
            browser.wait_for(FRESH)
            browser.wait_for("(b => b && (b.click(), true))(document.querySelector('#nodes button'))")
            browser.wait_for(
                "document.querySelector('#ask').open && document.querySelector('#ask-text').textContent.startsWith('Reset toy?')"
            )
            browser.value("document.querySelector('#ask-yes').click()")
            browser.wait_for("document.querySelector('#answer').textContent == 'toy flies without GPS; ask again'")
        browser.wait_for("document.querySelector('#link').textContent.startsWith('no data for')")  # the graph has ended
        assert [error for error in browser.errors if "ERR_" not in error] == []
    finally:
        browser.close()
        NODES.forget("toy_navigator")


def ink(browser):
    """Colour of the instruments' corner, sky while they live."""
    return browser.value("[...document.querySelector('#pfd').getContext('2d').getImageData(150, 40, 1, 1).data].join()")
