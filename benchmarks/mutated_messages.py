"""One bad message into every navigator in the middle of a flight: what does it do to a solution that everything else holds?

A simulated flight becomes CDR messages.  Each navigator is flown to a point with GPS and to one 35 s after GPS was lost, and kept there
as a copy.  One message of its inputs is mutated (bits, lengths, weird numbers, covariances, frames, quaternions, clouds, scales, stamps,
inertial spikes) and takes the place of the true one; the copy flies on for 12 s with everything else as it was.

refused      by the decoder or the navigator, under a phrase
same value   the mutation changed nothing that a navigator reads
harmless     the solution stays within 6 sigma, or within 1.5 times what it is without the mutation
shaken       it does not, for up to 10 s
thrown       it does not, for longer
restarted    the navigator began anew
blinded      no solution for 1.5 s
unsound      a number that is none, or a negative variance, went out
exception    something was raised
"""

import copy
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from common import compare, run, scenario

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import complete_settings, make_navigator
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected, decode
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.messages.store import from_cdr, to_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.links import Link
from lowcostnav_ros.replay.session import simulated
from lowcostnav_ros.simulation.simulator import Simulation

OUTCOMES = ("refused", "same value", "harmless", "shaken", "thrown", "restarted", "blinded", "unsound", "exception")
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "ahrs full": ("ahrs", {}),
    "ahrs euler": ("ahrs", {"filter": "euler"}),
    "ahrs quaternion": ("ahrs", {"filter": "quaternion"}),
    "ahrs vector_matching": ("ahrs", {"filter": "vector_matching"}),
    "ahrs switched": ("ahrs", {"filter": "switched"}),
    "dead_reckoning full": ("dead_reckoning", {}),
    "dead_reckoning reduced": ("dead_reckoning", {"model": "reduced"}),
    "ins_gps": ("ins_gps", {}),
    "ins_gps, all blocks": (
        "ins_gps",
        {"split_turn_on": True, "imu": {"gyro_scale_ppm": 1e3, "accel_scale_ppm": 1e3}, "gps": {"position_bias_m": 1.0}},
    ),
    "gnss_only pv": ("gnss_only", {"model": "pv"}),
    "gnss_only pva": ("gnss_only", {"model": "pva"}),
    "ins_gnss tight": ("ins_gnss", {}),
    "ins_gnss tight, coast": ("ins_gnss", {"gnss": {"integrity": {"on_alarm": "coast"}}}),
    "ins_gnss loose, epochs": ("ins_gnss", {"coupling": "loose"}),
    "ins_gnss loose, gnss_only": ("ins_gnss", {"coupling": "loose", "loose_source": "gnss_only"}),
    "ins_gnss loose, receiver": ("ins_gnss", {"coupling": "loose", "loose_source": "receiver"}),
    "supervisor": ("supervisor", {}),
}
SENSORS = ["imu", "magnetometer", "air_data", "gps", "dme", "gnss", "gps_attitude"]
GPS_SOURCES = ("gps/fix", "gps/vel", "gps/attitude", "gnss/raw")
CHAIN = ("ahrs", "ins_gps", "dead_reckoning", "gnss_only")
"""Navigators whose solutions are inputs of others."""
MISSION = ["straight duration_s=40", "turn by_deg=90 bank_deg=25", "straight duration_s=40", "turn by_deg=-120 bank_deg=20"] * 3
GOOD_S, LOST_S, OUT_S = 100.0, 120.0, 155.0
"""Where the copies are taken, and when GPS is lost."""
ON_S, WITHIN_S = 12.0, 2.0
"""How long a copy flies on, and from how long a stretch the message is chosen."""
SIGMAS, WORSE, LONG_S, BLIND_S = 6.0, 1.5, 10.0, 1.5


@dataclass(frozen=True, slots=True)
class Sent:
    """One message of the flight, and what it decodes to."""

    source: str
    msgtype: str
    raw: bytes
    measurement: Measurement


@dataclass(frozen=True, slots=True)
class Flight:
    """Truth and the messages in order of arrival, with the origins of the navigators' map frames."""

    truth: TruthBlock
    sent: list[Sent]
    rules: DecodeRules
    start_ns: int


def settings_of(name: str, values: dict[str, Any]) -> Any:
    """Settings of a navigator for this flight."""
    stations = {"dme": {"stations_file": "dme_stations_bay_area.csv"}} if name == "dead_reckoning" else {}
    return complete_settings(NAVIGATORS[name].Settings, {**stations, **values})


def build(variant: str, further: dict[str, Any] | None = None) -> Navigator:
    """A fresh navigator, with ``further`` groups of settings."""
    name, values = VARIANTS[variant]
    groups = {key: {**values.get(key, {}), **group} for key, group in (further or {}).items()}
    return make_navigator(settings_of(name, {**values, **groups}), NAVIGATORS[name])


@cache
def flight_of(seed: int) -> Flight:
    """Fly, with GPS lost at :data:`LOST_S`; sensors and navigators publish."""
    changes = {"truth.duration_s": OUT_S + ON_S + 5.0, "truth.mission": MISSION, "sensors": SENSORS, "gps.outages_s": []}
    seconds = list(Simulation(scenario("livermore", seed, **changes)).blocks())
    truth = TruthBlock.joined(block for block, _ in seconds)
    start_ns, rules, sent = int(truth.stamps_ns[0]), DecodeRules(), list[Sent]()
    decoder = Decoder(rules)
    links = [Link(name, make_navigator(settings_of(name, {}), NAVIGATORS[name]), rules) for name in CHAIN]

    def publish(measurement: Measurement) -> None:
        lost = measurement.source in GPS_SOURCES and measurement.stamp_ns - start_ns > 1e9 * LOST_S
        for _, source, msgtype, raw in () if lost else encode_cdr(measurement):
            deliver(source, msgtype, raw)

    def deliver(source: str, msgtype: str, raw: bytes) -> None:
        received = decoder.decode(source, msgtype, raw)
        assert not isinstance(received, Rejected), received
        sent.append(Sent(source, msgtype, raw, received))
        for link in links:
            if source in link.navigator.inputs:
                for solution in link.navigator.feed(received):
                    message = link.message(solution)
                    if message is not None:
                        deliver(link.topic, link.msgtype, to_cdr(message))

    for item in simulated(seconds):
        if not isinstance(item, TruthBlock):
            publish(item)
    return Flight(truth, sent, rules, start_ns)


# mutations: (rng, raw, message type) to raw ------------------------------------------------------------------------------------


def leaves(message: Any, path: str = "") -> Iterator[tuple[str, Callable[[], Any], Callable[[Any], None]]]:
    """Path, getter and setter of every float and every array of a message."""
    for name in message.__dataclass_fields__:
        value = getattr(message, name)
        if name.startswith("__"):
            continue
        if isinstance(value, float | np.ndarray):
            yield f"{path}{name}", lambda n=name: getattr(message, n), lambda v, n=name: setattr(message, n, v)
        elif hasattr(value, "__dataclass_fields__"):
            yield from leaves(value, f"{path}{name}.")


def edited(raw: bytes, msgtype: str, edit: Callable[[Any], None]) -> bytes:
    """CDR of the message after ``edit``."""
    message = from_cdr(raw, msgtype)
    edit(message)
    return to_cdr(message)


def bits(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """Bits flipped, bytes drawn, a word replaced, cut, padded, another encapsulation."""
    out, form, at = bytearray(raw), rng.integers(0, 6), int(rng.integers(0, len(raw)))
    if form == 0:
        for position in rng.integers(0, 8 * len(raw), rng.integers(1, 9)).tolist():
            out[position // 8] ^= 1 << position % 8
    elif form == 1:
        out[at : at + 4] = rng.bytes(len(out[at : at + 4]))
    elif form == 2:
        at -= at % 4
        out[at : at + 4] = struct.pack("<I", int(rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 1 << 20])))[: len(out[at : at + 4])]
    elif form == 3:
        del out[at:]
    elif form == 4:
        out += rng.bytes(int(rng.integers(1, 64)))
    else:
        out[: 4 if rng.random() < 0.5 else len(out)] = rng.bytes(4 if rng.random() < 0.5 else len(out))
    return bytes(out)


WEIRD = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e154, -1e154, 1e30, -1e30, 1e-154, 5e-324, -5e-324, 2.2e-308, 0.0, -0.0, -1.0)


def numbers(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """A weird number in one place, or in a few."""
    out = bytearray(raw)
    words = (len(raw) - 4) // 8
    for _ in range(int(rng.integers(1, 4))):
        at = 4 + 8 * int(rng.integers(0, max(words, 1)))
        if rng.random() < 0.3:
            at = max(4, at - 4)
        out[at : at + 8] = struct.pack("<d", rng.choice(WEIRD))[: len(out[at : at + 8])]
    return bytes(out)


def covariances(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """A covariance or variance that is negative, asymmetric, indefinite, of rank one, tiny, denormal, huge or zero."""

    def edit(message: Any) -> None:
        found = [leaf for leaf in leaves(message) if "covariance" in leaf[0] or leaf[0].endswith("variance")]
        if not found:
            return
        _, get, put = found[int(rng.integers(len(found)))]
        value = get()
        scale = float(rng.choice([-1.0, 0.0, 5e-324, 1e-310, 1e-160, 1e-30, 1e-18, 1e-12, 1e-6, 1e6, 1e12, 1e29, 1e31, 1e300]))
        if isinstance(value, float):
            put(value * scale if rng.random() < 0.5 else scale)
            return
        n = round(len(value) ** 0.5)
        matrix = value.reshape(n, n).astype(float)
        form = rng.integers(0, 6)
        if form == 0:
            matrix *= scale
        elif form == 1:
            matrix[:] = scale * np.eye(n)
        elif form == 2:
            v = rng.standard_normal(n) * np.sqrt(np.abs(matrix.diagonal())) * np.sqrt(abs(scale) or 1.0)
            matrix[:] = np.outer(v, v)
        elif form == 3:
            i, j = rng.integers(0, n, 2)
            matrix[i, j] += scale
        elif form == 4:
            root = np.sqrt(np.abs(matrix.diagonal()))
            matrix[:3, :3] = np.outer(root[:3], root[:3]) * (1.0 - rng.choice([0.0, 1e-16, 1e-12, 1e-9, 1e-3]) * (1.0 - np.eye(3)))
        else:
            matrix[:3, :3] *= rng.choice([1e-18, 1.0, 1e18], (3, 3))
        put(matrix.ravel())

    return edited(raw, msgtype, edit)


def scaled(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """One number of the datum scaled, shifted or with the other sign: a plausible lie."""

    def edit(message: Any) -> None:
        found = [leaf for leaf in leaves(message) if "covariance" not in leaf[0] and leaf[0] != "data"]
        if msgtype == topics.POINT_CLOUD:
            data = np.frombuffer(bytes(message.data), np.uint8).copy()
            at = message.point_step * int(rng.integers(message.width)) + 8 * int(rng.integers(11))
            data[at : at + 8] = np.frombuffer(struct.pack("<d", lie(struct.unpack("<d", data[at : at + 8].tobytes())[0])), np.uint8)
            message.data = data
        elif found:
            _, get, put = found[int(rng.integers(len(found)))]
            put(lie(get()) if isinstance(get(), float) else get())

    def lie(value: float) -> float:
        form = rng.integers(0, 3)
        size = 10.0 ** rng.uniform(-3.0, 3.0)
        return -value if form == 0 else value * size if form == 1 else value + float(rng.choice([-1.0, 1.0])) * size

    return edited(raw, msgtype, edit)


def spikes(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """A spike of any size in one number of the datum, within what the decoder lets pass of inertial samples."""

    def edit(message: Any) -> None:
        vector, most = (message.angular_velocity, 35.0) if rng.random() < 0.5 else (message.linear_acceleration, 1000.0)
        setattr(vector, str(rng.choice(list("xyz"))), float(rng.choice([-1.0, 1.0])) * most * 10.0 ** rng.uniform(-3.0, 0.0))

    return edited(raw, msgtype, edit)


def frames(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """Another frame id or station."""

    def edit(message: Any) -> None:
        names = ["", "map", "base_link", "odom", "gps", "OAK", "SJC", "x" * 300, "\u00e9", "imu_link", "a/b"]
        message.header.frame_id = str(rng.choice(names))

    return edited(raw, msgtype, edit)


def quaternions(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """An orientation of another norm, none at all, or another turn."""

    def edit(message: Any) -> None:
        q, form = (message.pose.pose if hasattr(message, "pose") else message).orientation, rng.integers(0, 4)
        factor = (0.0, -1.0, float(10.0 ** rng.uniform(-3, 3)), 1.0)[form]
        for name in "xyzw":
            setattr(q, name, factor * getattr(q, name) + (float(rng.normal()) if form == 3 else 0.0))

    return edited(raw, msgtype, edit)


def clouds(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """Another layout of a point cloud, or a value anywhere in it."""

    def edit(message: Any) -> None:
        form = rng.integers(0, 6)
        data = np.frombuffer(bytes(message.data), np.uint8).copy()
        if form == 0:
            one = message.fields[int(rng.integers(len(message.fields)))]
            setattr(one, str(rng.choice(["offset", "datatype", "count"])), int(rng.choice([0, 1, 7, 8, 90, 200])))
        elif form == 1:
            message.point_step = int(rng.choice([0, 1, 90, 92, 1 << 30]))
        elif form == 2:
            message.width, message.height = int(rng.choice([0, 1, 3, 1 << 30])), int(rng.choice([0, 1, 2]))
        elif form == 3:
            message.data = data[: int(rng.integers(0, len(data)))]
        elif form == 4:
            at = message.point_step * int(rng.integers(message.width)) + 8 * int(rng.integers(11))
            data[at : at + 8] = np.frombuffer(struct.pack("<d", rng.choice(WEIRD)), np.uint8)
            message.data = data
        else:
            column = 8 * int(rng.integers(11))
            for k in range(message.width):
                at = message.point_step * k + column
                data[at : at + 8] = np.frombuffer(struct.pack("<d", rng.choice([1e-9, 1e154, -1e154, 1e300, 5e-324])), np.uint8)
            message.data = data

    return edited(raw, msgtype, edit)


def stamps(rng: np.random.Generator, raw: bytes, msgtype: str) -> bytes:
    """A stamp within the jump limit, early or late."""
    sec, nanosec = struct.unpack_from("<iI", raw, 4)
    moved = sec * 1_000_000_000 + nanosec + round(1e9 * float(rng.choice([-1.0, 1.0])) * 10.0 ** rng.uniform(-3.0, 0.995))
    return raw[:4] + struct.pack("<iI", *divmod(moved, 1_000_000_000)) + raw[12:]


SUITED = {"spikes": (topics.IMU,), "quaternions": (topics.IMU, topics.ODOMETRY, topics.POSE), "clouds": (topics.POINT_CLOUD,)}
"""Types of message that a mutation is for, where it is not for all."""
MUTATIONS = {f.__name__: f for f in (bits, numbers, covariances, scaled, spikes, frames, quaternions, clouds, stamps)}


# what became of it ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a mutation did: a word of :data:`OUTCOMES`, which variant, which kind, and what it was, for people."""

    word: str
    variant: str
    kind: str
    what: str


class Point:
    """A navigator in mid-flight: its copy, what comes next, and what it does without a mutation."""

    def __init__(self, flight: Flight, navigator: Navigator, following: list[Sent]) -> None:
        self.flight, self.navigator = flight, navigator
        self.following = [sent for sent in following if sent.source in navigator.inputs]
        first_ns = following[0].measurement.stamp_ns
        self.candidates = [k for k, sent in enumerate(self.following) if sent.measurement.stamp_ns - first_ns < 1e9 * WITHIN_S]
        self.sources = sorted({self.following[k].source for k in self.candidates})
        self.restarts = navigator.restarts.copy()
        self.healthy, _ = self.fly(None, None)
        self.usual = dict(zip(*self.off(self.healthy), strict=True))

    def fly(self, row: int | None, mutant: Measurement | None) -> tuple[list[NavSolution], Navigator]:
        """Fused and low-latency solutions of a copy that gets ``mutant`` in place of message ``row``."""
        navigator, out = copy.deepcopy(self.navigator), list[NavSolution]()
        for k, sent in enumerate(self.following):
            fused = navigator.feed(mutant if k == row and mutant is not None else sent.measurement)
            out += fused
            if fused and (latest := navigator.output()) is not None and not sound(latest):
                out.append(latest)
        return out, navigator

    def off(self, solutions: list[NavSolution]) -> tuple[list[int], list[float]]:
        """Stamps, and the largest error over sigma of position, velocity and attitude at each."""
        errors, _ = compare(self.flight.truth, solutions)
        ratios = np.abs(errors.values[:, :9]) / np.maximum(errors.sigmas[:, :9], 1e-12)
        return errors.stamps_ns.tolist(), np.nanmax(ratios, axis=1).tolist()

    def mutate(self, rng: np.random.Generator, kind: str) -> tuple[str, str]:
        """Mutate one message, fly on, and say what became of it and what it was."""
        types = {self.following[k].source: self.following[k].msgtype for k in self.candidates}
        suited = [source for source in self.sources if types[source] in SUITED.get(kind, types.values())]
        if not suited:
            return self.mutate(rng, "scaled")
        source = str(rng.choice(suited))  # each source as often as the others, however often it sends
        row = int(rng.choice([k for k in self.candidates if self.following[k].source == source]))
        sent = self.following[row]
        try:
            raw = MUTATIONS[kind](rng, sent.raw, sent.msgtype)
        except (OverflowError, struct.error, AttributeError, UnicodeError):
            return "refused", "no such message can be written"
        try:
            mutant = decode(source, sent.msgtype, raw, self.flight.rules)
            if isinstance(mutant, Rejected):
                return "refused", mutant.reason
            if same(mutant, sent.measurement):
                return "same value", ""
            solutions, navigator = self.fly(row, mutant)
        except Exception as error:  # the very thing that is looked for
            return "exception", f"{source} {type(error).__name__}: {error}"
        return self.judge(solutions, navigator), f"{source} {difference(mutant, sent.measurement)}"

    def judge(self, solutions: list[NavSolution], navigator: Navigator) -> str:
        """Which of the outcomes it is."""
        if not all(map(sound, solutions)):
            return "unsound"
        if navigator.restarts != self.restarts:
            return "restarted"
        stamps_ns, ratios = self.off(solutions)
        expected = np.array(sorted(self.usual))
        if len(expected) and (not stamps_ns or np.diff([expected[0], *stamps_ns, expected[-1]]).max() > 1e9 * BLIND_S):
            return "blinded"
        worst = max(self.usual.values(), default=0.0)
        beyond = [t for t, ratio in zip(stamps_ns, ratios, strict=True) if ratio > SIGMAS and ratio > WORSE * self.usual.get(t, worst)]
        if not beyond:
            return "harmless"
        step_s = 1e-9 * float(np.median(np.diff(stamps_ns)))
        return "thrown" if len(beyond) * step_s > LONG_S else "shaken"


def sound(solution: NavSolution) -> bool:
    """Whether every number is one and no variance is negative; not the navigators' own test."""
    values = [np.ravel(v) for name in solution.__dataclass_fields__ if isinstance(v := getattr(solution, name), float | np.ndarray)]
    covariances = [v for v in (solution.cov_pos, solution.cov_vel, solution.cov_att, solution.cov_wind) if v is not None]
    return all(np.isfinite(v).all() for v in values) and all((np.diag(c) >= 0.0).all() for c in covariances)


def same(a: Measurement, b: Measurement) -> bool:
    """Whether two measurements are equal to the bit."""
    return type(a) is type(b) and not difference(a, b)


def difference(a: Measurement, b: Measurement) -> str:
    """The fields in which two measurements differ, with the values of the first."""
    names = [n for n in a.__dataclass_fields__ if n not in ("states", "integrity")]
    return "; ".join(f"{n} {getattr(a, n)}" for n in names if not np.array_equal(getattr(a, n, None), getattr(b, n, None)))


def points(flight: Flight, variants: list[str]) -> Iterator[tuple[str, Point]]:
    """Every variant in mid-flight, with GPS and without."""
    for variant in variants:
        navigator, begun = build(variant), 0
        for at_s in (GOOD_S, OUT_S):
            at_ns = flight.start_ns + round(1e9 * at_s)
            end = next(k for k, sent in enumerate(flight.sent) if sent.measurement.stamp_ns >= at_ns)
            for sent in flight.sent[begun:end]:
                if sent.source in navigator.inputs:
                    navigator.feed(sent.measurement)
            begun = end
            until_ns = at_ns + round(1e9 * ON_S)
            following = [sent for sent in flight.sent[end:] if sent.measurement.stamp_ns < until_ns]
            point = Point(flight, copy.deepcopy(navigator), following)
            if point.sources:
                yield variant, point


def campaign(messages: int, seed: int, variants: list[str], kinds: list[str]) -> list[Outcome]:
    """Mutate so many messages, spread over variants, points and kinds."""
    rng, flight, out = np.random.default_rng(seed), flight_of(seed), list[Outcome]()
    share = max(1, round(messages / (2 * len(variants))))
    for variant, point in points(flight, variants):
        for k in range(share):
            kind = kinds[k % len(kinds)]
            word, what = point.mutate(rng, kind)
            out.append(Outcome(word, variant, kind, what))
    return out


def table(outcomes: list[Outcome], by: str) -> dict[str, dict[str, int]]:
    """Counts of the outcomes by an attribute."""
    rows: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        rows.setdefault(getattr(outcome, by), Counter())[outcome.word] += 1
    rows["all"] = Counter(outcome.word for outcome in outcomes)
    return {name: {word: row[word] for word in OUTCOMES} for name, row in rows.items()}


def measure(options: Any) -> dict[str, Any]:
    """Run the campaign and count."""
    kinds = [kind for kind in MUTATIONS if not options.kinds or kind in options.kinds.split(",")]
    variants = [name for name in VARIANTS if options.only in name]
    outcomes = campaign(300 if options.quick else options.messages, options.seed, variants, kinds)
    for heading, rows in (("variant", table(outcomes, "variant")), ("mutation", table(outcomes, "kind"))):
        print(f"| {heading} | {' | '.join(OUTCOMES)} |\n|{'---|' * (len(OUTCOMES) + 1)}")
        for name, row in rows.items():
            print(f"| {name} | {' | '.join(str(n) for n in row.values())} |")
    bad = [replace(o, what=o.what[:300]) for o in outcomes if o.word in ("thrown", "restarted", "blinded", "unsound", "exception")]
    return {"messages": len(outcomes), "by_variant": table(outcomes, "variant"), "by_mutation": table(outcomes, "kind"), "bad": [
        [o.word, o.variant, o.kind, o.what] for o in bad
    ]}  # fmt: skip


if __name__ == "__main__":
    run(
        __doc__.splitlines()[0],
        measure,
        messages={"type": int, "default": 3400, "metavar": "N", "help": "messages in all"},
        seed={"type": int, "default": 1, "help": "of the flight and of the mutations"},
        only={"default": "", "metavar": "TEXT", "help": "variants whose name holds this"},
        kinds={"default": "", "metavar": "A,B", "help": "kinds of mutation"},
    )
