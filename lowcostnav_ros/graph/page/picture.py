"""What the page of a running graph shows: the newest message of every topic that it draws, and what the nodes report of themselves.

What arrives is kept as bytes and decoded when somebody looks: an aircraft drawn ten times a second needs no solution in between.  All of it
is foreign: rows and topics are bounded in number, and what cannot be decoded is not drawn.
"""

import math
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, Attitude, NavSolution
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.text import numeric
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.messages.decode import Decoder
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.navigators.registry import NAVIGATORS, label_of
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.geomagnetism import declination, year_of_stamp
from lowcostnav_ros.physics.rotation import quat_to_euler
from lowcostnav_ros.radionav.ellipse import ellipse_of
from lowcostnav_ros.radionav.stations import Station

MOST_ROWS, MOST_TOPICS, MOST_STATIONS = 2000, 200, 500
MOST_VALUES, LONGEST = 200, 300  # of one row; characters of a text
LOST_S = 3.0  # nodes report once a second
TRUTH = "truth"
OWN = ("navigator", "source", "recording", "page", "magnetometer calibration")
"""Rows in which a node speaks of itself."""
TRACK_POINTS, TRACK_S = 1500, 1.0  # of one source; when there are more, every other one goes
SIGMAS = 2.0  # of everything that is drawn around a value
NODE = re.compile(r"(/[A-Za-z_]\w*)+")
ODOMETRY, WIND, ORIGIN, ATTITUDE = "odometry", "wind", "origin", "imu/data"


@dataclass(slots=True)
class _Newest:
    """The newest message of a topic, when it came, and what it was decoded to."""

    kind: Kind
    raw: bytes = b""
    arrived: float = -math.inf
    decoded: Any = None


@dataclass(slots=True)
class Track:
    """Where a source has been: (lat, lon) in degrees, thinned to a bounded number of points."""

    points: list[tuple[float, float]] = field(default_factory=list)
    every_s: float = TRACK_S
    last_ns: int = 0

    def pass_by(self, solution: NavSolution) -> None:
        """Add a place when it is time; a stamp that steps back begins anew."""
        since_s = 1e-9 * (solution.stamp_ns - self.last_ns)
        if since_s < -self.every_s:
            self.points.clear()
        if self.points and abs(since_s) < self.every_s:
            return
        self.last_ns = solution.stamp_ns
        lat, lon, _ = solution.place
        self.points.append((round(math.degrees(lat), 6), round(math.degrees(lon), 6)))
        if len(self.points) > TRACK_POINTS:
            del self.points[1::2]
            self.every_s *= 2.0


@dataclass(frozen=True, slots=True)
class _Row:
    level: int
    message: str
    values: Mapping[str, str]
    node: str  # with its namespace
    arrived: float

    def source(self, topic: str) -> str:
        """A topic of the node with its namespace, as sources are called."""
        return f"{self.node.rpartition('/')[0]}/{topic}".lstrip("/")


class Picture:
    """Follow a graph.

    Parameters
    ----------
    stations : iterable of Station
        Drawn on the map.
    clock : callable
        Steady time, s: by the time of arrival it is judged what is stale.
    """

    def __init__(self, stations: Iterable[Station] = (), clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._decoder = clock, Decoder()
        self._stations = list(stations)[:MOST_STATIONS]
        self._rows: dict[str, _Row] = {}
        self._topics: dict[str, _Newest] = {}
        self._tracks: dict[str, Track] = {}
        self._heard: dict[str, float] = {}
        self._rooms: dict[str, str] = {}
        self.events: deque[dict[str, Any]] = deque(maxlen=50)

    # what comes in

    def report(self, name: str, level: int, message: str, values: Mapping[str, str], hardware_id: str) -> None:
        """Take a row of the diagnostics."""
        node = hardware_id.rpartition(" ")[0]
        if not NODE.fullmatch(node) or len(name) > LONGEST or (name not in self._rows and len(self._rows) >= MOST_ROWS):
            return
        message, values = message[:LONGEST], {key[:LONGEST]: values[key][:LONGEST] for key in list(values)[:MOST_VALUES]}
        before = self._rows.get(name)
        self._rows[name] = _Row(min(int(level), Level.ERROR), message, values, node, self._clock())
        if name.endswith(": navigator") and (before is None or before.values.get("mode") != values.get("mode")):
            self.events.append({"at": time.time(), "node": name.partition(": ")[0], "level": self._rows[name].level, "text": message})

    def wanted(self) -> list[tuple[str, Kind]]:
        """Topics to listen to, as (absolute name, kind): of those that somebody is known to publish, those that are drawn.

        Nobody listens before the first message has been sent: a lossless publisher that waits for its listeners waits for others.
        """
        found = []
        for name, row in self._rows.items():
            what = name.partition(": ")[2]
            topic = what.removeprefix("output ")
            kind = self._decoder.rules.kind_of(topic) if topic != what and row.values.get("count", "0") != "0" else None
            if kind is not None and _is_drawn(topic, kind):
                found.append((f"/{row.source(topic)}", kind))
        return found[:MOST_TOPICS]

    def take(self, source: str, kind: Kind, raw: bytes) -> None:
        """Take the bytes of a message."""
        if source not in self._topics and len(self._topics) >= MOST_TOPICS:
            return
        if source not in self._topics:
            self._topics[source] = _Newest(kind)
            if self._decoder.rules.kind_of(source) is None:  # in a namespace
                self._decoder.rules.assign(source, kind.name)
        newest = self._topics[source]
        newest.raw, newest.arrived, newest.decoded = raw, self._clock(), None
        if kind.latched:  # needed to decode the rest
            self._decoder.decode(source, kind.msgtype, raw)
        elif _names_station(kind):
            station = getattr(self._decoder.decode(source, kind.msgtype, raw), "station", None)
            if station is not None and (station in self._heard or len(self._heard) < MOST_STATIONS):
                self._heard[station] = newest.arrived

    # what is shown

    def flight(self) -> dict[str, Any]:
        """What moves: every navigator's newest solution with its age, and the truth where it is simulated."""
        shown = {node: self._aircraft(node, room) for node, room in self._rooms.items()}
        return {"navigators": shown, "truth": self._aircraft(TRUTH, TRUTH) if f"{TRUTH}/{ODOMETRY}" in self._topics else None}

    def tables(self) -> dict[str, Any]:
        """What the nodes report: their state, inputs, aids, the stations heard and the last changes of mode."""
        nodes: dict[str, dict[str, Any]] = {}
        for name, row in sorted(self._rows.items()):
            node, _, what = name.partition(": ")
            silent = self._clock() - row.arrived
            if node not in nodes:
                nodes[node] = {"level": 0, "message": "", "silent": silent, "inputs": [], "aids": [], "does": self._does(node)}
            entry = nodes[node]
            entry["silent"] = min(entry["silent"], silent)
            kind, _, about = what.partition(" ")
            if kind == "input":
                entry["inputs"].append(_input(about, row, silent))
            elif kind == "aid":
                entry["aids"].append(_aid(about, row, silent))
            if row.level > entry["level"] or (row.level == entry["level"] and what in OWN):
                entry["level"], entry["message"] = row.level, row.message
            if what == "navigator":
                entry["flying_on"] = row.values.get("flying_on", "")
        for node, room in self._rooms.items():
            nodes.get(node, {})["colour"] = _colour(node, room)
        for entry in nodes.values():
            if entry["silent"] > LOST_S:
                entry["level"], entry["message"] = int(Level.ERROR), f"no report for {entry['silent']:.0f} s"
        now = self._clock()
        return {"nodes": nodes, "heard": {ident: round(now - at, 1) for ident, at in self._heard.items()}, "events": list(self.events)}

    def chart(self) -> dict[str, Any]:
        """What a browser gets when it comes: stations, and the tracks so far."""
        places = [
            {"ident": s.ident, "kind": s.kind, "lat": round(math.degrees(s.lat), 6), "lon": round(math.degrees(s.lon), 6)}
            for s in self._stations
        ]
        return {"stations": places, "tracks": {name: list(track.points) for name, track in self._tracks.items()}}

    def frame_of(self, node: str) -> LocalFrame | None:
        """Map frame in which a navigator's solution is published, None before its origin is known."""
        return self._decoder.rules.origins.get(self._rooms.get(node, ""))

    def service_of(self, node: str, verb: str) -> str:
        """Absolute name of a service of a node that the page offers; empty for any other."""
        does = self._does(node)
        row = next((row for name, row in self._rows.items() if name.startswith(f"{node}: ")), None)
        return f"{row.node}/{verb}" if row is not None and verb in does else ""

    def _does(self, node: str) -> list[str]:
        """Services of a node that can be called from the page."""
        if f"{node}: navigator" not in self._rows:
            return []
        calibrates = f"{node}: output {ATTITUDE}" in self._rows
        return ["reset", *(("calibrate_start", "calibrate_stop") if calibrates else ())]

    def follow(self) -> None:
        """See which navigators there are and draw the tracks on: to be called about once a second."""
        self._rooms = self._find_rooms()
        for name, room in {**self._rooms, TRUTH: TRUTH}.items():
            solution = self._newest(f"{room}/{ODOMETRY}")[0]
            if isinstance(solution, NavSolution) and solution.lat is not None:
                self._tracks.setdefault(name, Track()).pass_by(solution)

    def _find_rooms(self) -> dict[str, str]:
        """First part of the topics of every navigator, namespace included, empty for one without a position."""
        rooms = {}
        for name, row in self._rows.items():
            node, _, what = name.partition(": ")
            if what == "navigator":
                outputs = (other.partition(": output ")[2] for other in self._rows if other.startswith(f"{node}: output "))
                room = next((topic.removesuffix(f"/{ODOMETRY}") for topic in outputs if topic.endswith(f"/{ODOMETRY}")), "")
                rooms[node] = row.source(room) if room else ""
        return rooms

    def _newest(self, source: str) -> tuple[Any, float]:
        """The newest message of a topic, decoded, None where there is none; and its age, s."""
        newest = self._topics.get(source)
        if newest is None:
            return None, math.inf
        if newest.decoded is None:
            newest.decoded = self._decoder.decode(source, newest.kind.msgtype, newest.raw)
        return newest.decoded, self._clock() - newest.arrived

    def _wind(self, room: str) -> NavSolution | None:
        wind, age = self._newest(f"{room}/{WIND}")
        return wind if isinstance(wind, NavSolution) and age < LOST_S else None

    def _aircraft(self, node: str, room: str) -> dict[str, Any]:
        row = self._rows.get(f"{node}: navigator")
        attitude = ATTITUDE if row is None else row.source(ATTITUDE)
        solution, age = self._newest(f"{room}/{ODOMETRY}" if room else attitude)
        shown: dict[str, Any] = {"age": None if math.isinf(age) else round(age, 2)}
        if row is not None:
            lost = self._clock() - row.arrived > LOST_S
            shown |= {"level": int(Level.ERROR) if lost else row.level, "message": "no report" if lost else row.message}
        if isinstance(solution, NavSolution | Attitude):
            shown["stamp"] = round(1e-9 * solution.stamp_ns, 2)
            shown |= _attitude(solution)
        if isinstance(solution, NavSolution):
            shown |= _position(solution)
            flown = self._rooms.get(row.values.get("flying_on", ""), "") if row is not None else ""
            shown |= _velocity(solution, self._wind(room) or self._wind(flown))
        return {key: value for key, value in shown.items() if value is not None}


@cache
def _colour(node: str, room: str) -> str:
    names = [name for name in NAVIGATORS if name == node or label_of(name).room == room != ""]
    return label_of(names[0]).colour if names else ""


def _names_station(kind: Kind) -> bool:
    return "station" in getattr(kind.measurement, "__dataclass_fields__", {})


def _is_drawn(topic: str, kind: Kind) -> bool:
    return topic == ATTITUDE or _names_station(kind) or topic.rpartition("/")[2] in (ODOMETRY, WIND, ORIGIN)


def _input(topic: str, row: _Row, silent: float) -> dict[str, Any]:
    age = numeric(row.values, "age_s")
    rejected = {"rejected": int(numeric(row.values, "rejected") or 0), "why": row.values.get("last_reject", "")}
    rate = numeric(row.values, "rate_hz")
    age = None if age is None else round(age + silent, 1)
    return {"topic": topic, "level": row.level, "message": row.message, "rate": rate, "age": age, **rejected}


def _aid(name: str, row: _Row, silent: float) -> dict[str, Any]:
    values, age = row.values, numeric(row.values, "age_s")
    counts = {key: int(numeric(values, key) or 0) for key in ("fused", "rejected")}
    age = None if age is None else round(age + silent, 1)
    ratio = numeric(values, "test_ratio")
    return {"aid": name, "level": row.level, "ratio": ratio, "age": age, "why": values.get("reason", ""), **counts}


def _attitude(solution: NavSolution | Attitude) -> dict[str, Any]:
    """Roll, pitch and true heading in degrees, with the sigma bound of the worst tilt and of the heading."""
    if solution.q_nb is None:
        return {}
    roll, pitch, heading = np.degrees(quat_to_euler(np.asarray(solution.q_nb, float))).tolist()
    shown = {"roll": round(roll, 2), "pitch": round(pitch, 2), "heading": round(heading % 360.0, 2)}
    cov = getattr(solution, "cov_att", None)
    if cov is not None:
        tilt, turn = math.degrees(math.sqrt(max(cov[0, 0], cov[1, 1]))), math.degrees(math.sqrt(cov[2, 2]))
        shown |= {"tilt_bound": round(SIGMAS * tilt, 2), "heading_bound": round(SIGMAS * turn, 2)}
    return shown


def _position(solution: NavSolution) -> dict[str, Any]:
    if solution.lat is None:
        return {}
    lat, lon, height = solution.place
    shown: dict[str, Any] = {"lat": round(math.degrees(lat), 7), "lon": round(math.degrees(lon), 7)}
    shown["height"] = round(height, 2)
    year = year_of_stamp(solution.stamp_ns)
    if year is not None:
        shown["declination"] = _declination_deg(round(math.degrees(lat), 1), round(math.degrees(lon), 1), round(year, 1))
    shown["msl"] = round(height - float(undulation(lat, lon)), 1)
    if solution.cov_pos is not None:
        ellipse = ellipse_of(solution.cov_pos[:2, :2])
        axes = round(SIGMAS * ellipse.major, 1), round(SIGMAS * ellipse.minor, 1), round(math.degrees(ellipse.orientation), 1)
        shown |= {"ellipse": axes, "height_bound": round(SIGMAS * math.sqrt(solution.cov_pos[2, 2]), 1)}
    return shown


@lru_cache(maxsize=256)
def _declination_deg(lat_deg: float, lon_deg: float, year: float) -> float | None:
    """Magnetic declination to a tenth of a degree, east positive; None where the model does not reach."""
    try:
        return round(math.degrees(declination(math.radians(lat_deg), math.radians(lon_deg), 0.0, year)), 1)
    except ValueError:
        return None


def _velocity(solution: NavSolution, wind: NavSolution | None) -> dict[str, Any]:
    """Ground speed, track and climb; wind, and the airspeed that it leaves."""
    if solution.vel_n is None:
        return {}
    north, east, down = solution.vel_n.tolist()
    shown: dict[str, Any] = {"speed": round(math.hypot(north, east), 2), "climb": round(-down, 2)}
    if shown["speed"] > 1.0:
        shown["track"] = round(math.degrees(math.atan2(east, north)) % 360.0, 1)
    if solution.cov_vel is not None:
        shown["speed_bound"] = round(SIGMAS * math.sqrt(max(solution.cov_vel[0, 0], solution.cov_vel[1, 1])), 2)
    if wind is not None and wind.wind_n is not None and wind.cov_wind is not None and wind.cov_wind[0, 0] < UNKNOWN_VARIANCE:
        w_north, w_east = wind.wind_n.tolist()
        shown["wind"] = round(math.hypot(w_north, w_east), 2)
        shown["wind_from"] = round(math.degrees(math.atan2(-w_east, -w_north)) % 360.0)
        shown["wind_bound"] = round(SIGMAS * math.sqrt(max(wind.cov_wind[0, 0], wind.cov_wind[1, 1])), 2)
        shown["airspeed"] = round(math.hypot(north - w_north, east - w_east, down), 2)
    return shown
