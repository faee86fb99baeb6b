"""Columns from the disk on: windows of a recording, and the messages decoded in them, equal what is read and decoded one by one."""

import dataclasses
import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.messages import arrival, encode, topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.decode import Decoder, Rejected
from lowcostnav_ros.messages.layouts import layout_of
from lowcostnav_ros.messages.store import STORE, from_cdr, to_cdr
from lowcostnav_ros.messages.windows import Window
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.replay.columns import columns_of, columns_of_messages
from lowcostnav_ros.replay.digest import imu_record, odometry_record, records_of_messages, records_of_solutions

REFERENCE = Path(__file__).resolve().parents[1] / "bags" / "reference"


def parts(one):
    """Fields of a measurement, arrays as shape and bytes, floats to the bit."""
    values = (getattr(one, field.name) for field in dataclasses.fields(one))
    return [(v.shape, v.dtype, v.flags.c_contiguous, v.tobytes()) if isinstance(v, np.ndarray) else repr(v) for v in values]


def one_by_one(messages, types):
    """Decode messages (source, stamp, bytes) as a node does."""
    decoder = Decoder()
    results = [decoder.decode(source, types[source], raw) for source, _, raw in messages]
    return decoder, [one for one in results if not isinstance(one, Rejected)]


def in_columns(messages, types):
    """Decode the same together."""
    decoder, found = Decoder(), {}
    window = Window.of_messages(messages)
    origins = [row for row, (source, _, _) in enumerate(messages) if source.endswith("/origin")]
    for rows in (np.array(origins, int), np.setdiff1d(np.arange(len(messages)), origins)):
        for source, within in window[rows].by_source():
            columns, rest = decoder.decode_many(window, rows[within], types[source])
            for one in columns:
                if one.kind.measurement is m.ImuBlock:
                    samples = m.ImuBlock.of(source, one.stamps_ns, *one.fields)
                    found.update({row: samples[k : k + 1] for k, row in enumerate(one.rows.tolist())})
                else:
                    found.update(zip(one.rows.tolist(), one.measurements(), strict=True))
            found.update(rest)
    return decoder, [found[row] for row in sorted(found)]


def mutated(raw, rng):
    """One message with a byte turned, cut off, made big-endian, or a number that is none."""
    raw, kind = bytearray(raw), rng.integers(6)
    if kind == 0:
        raw[rng.integers(len(raw))] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        del raw[int(rng.integers(1, len(raw))) :]
    elif kind == 2:
        raw[1] ^= 1
    elif kind == 3:
        raw += bytes(int(rng.integers(1, 6)))
    else:
        at = len(raw) - 8 * int(rng.integers(1, max(2, (len(raw) - 24) // 8)))
        raw[at : at + 8] = struct.pack("<d", rng.choice([np.nan, np.inf, -1.0, 0.0, -0.0, 1e300, 1e-300, 250.0, 3.0e5]))
    return bytes(raw)


@pytest.fixture(scope="module")
def recorded():
    with BagReader(REFERENCE) as bag:
        return dict(bag.types), [(source, stamp, bytes(raw)) for source, stamp, raw in bag.stream(bag.decodable())]


@pytest.mark.parametrize("share", [0.0, 0.03, 0.7])
def test_messages_decoded_together_equal_those_decoded_one_by_one(recorded, share):
    types, messages = recorded
    rng = np.random.default_rng(5)
    messages = [(s, t, mutated(raw, rng) if not s.endswith("/origin") and rng.random() < share else raw) for s, t, raw in messages[:3000]]
    (single, expected), (together, found) = one_by_one(messages, types), in_columns(messages, types)
    assert len(found) == len(expected) > 300
    assert all(parts(a) == parts(b) for a, b in zip(found, expected, strict=True))
    assert (together.accepted, together.rejected) == (single.accepted, single.rejected)
    assert together.notes == single.notes
    assert share == 0.0 or single.rejected.total() > 20


def _varied(rng, n):
    """Messages of every kind that is decoded in columns, with covariances that differ, are unknown, or too small to be true."""
    for k in range(n):
        stamp = 10**18 + k * 10**7
        root = rng.normal(size=(3, 3)) * rng.choice([1e-9, 1.0, 10.0])
        cov = [np.zeros((3, 3)), np.eye(3), root @ root.T][rng.integers(3)]
        q = rng.normal(size=4)
        yield m.GpsPosition(stamp, "gps/fix", 0.5, -2.0, float(rng.normal(300.0, 9.0)), cov)
        yield m.GpsVelocity(stamp, "gps/vel", rng.normal(size=3), cov)
        yield m.AirVelocity(stamp, "air/velocity", np.array([40.0, *rng.normal(size=2)]), cov)
        yield m.Attitude(stamp, "imu/data", q / np.linalg.norm(q), cov, rng.normal(size=3), rng.normal(size=3))
        yield m.Attitude(stamp, "hars/attitude", q / np.linalg.norm(q), cov, rng.normal(size=3), np.zeros(3))  # without specific force
        yield m.MagneticField(stamp, "imu/mag", rng.normal(size=3) * 2e-5, cov * 1e-14)
        yield m.Pressure(stamp, "air/static_pressure", float(rng.normal(9.5e4, 100.0)), float(rng.choice([0.0, 1e-9, 400.0])))
        yield m.AirTemperature(stamp, "air/temperature", float(rng.normal(285.0, 9.0)), float(rng.choice([0.0, 1.0])))


def test_covariances_of_all_sorts_are_checked_as_in_single_messages():
    sent = [one for measurement in _varied(np.random.default_rng(8), 60) for one in encode.encode_cdr(measurement)]
    messages, types = [(topic, stamp, raw) for stamp, topic, _, raw in sent], {topic: msgtype for _, topic, msgtype, _ in sent}
    (single, expected), (together, found) = one_by_one(messages, types), in_columns(messages, types)
    assert [parts(a) for a in found] == [parts(b) for b in expected]
    assert together.notes == single.notes and len(single.notes) > 7 and together.rejected == single.rejected


def test_a_layout_reads_what_the_parser_reads_whatever_the_strings(recorded):
    types, messages = recorded
    checked = set()
    for source, _, raw in messages[:400]:
        dtype = layout_of(types[source], raw)
        if dtype is None:
            continue
        message, row = from_cdr(raw, types[source]), np.frombuffer(raw[: dtype.itemsize], dtype)[0]
        for frame in ("", "b", "base_link", "a/long/frame/id"):
            message.header.frame_id = frame
            own = to_cdr(message)
            row = np.frombuffer(own[: layout_of(types[source], own).itemsize], layout_of(types[source], own))[0]
            for name in (n for n in row.dtype.names if not n.endswith("frame_id") and not n.endswith(".size")):
                value = message
                for word in name.split("."):
                    value = getattr(value, word)
                np.testing.assert_array_equal(row[name], value)
        checked.add(types[source])
    assert {topics.IMU, topics.MAGNETIC_FIELD, topics.NAV_SAT_FIX, topics.TWIST, topics.FLUID_PRESSURE, topics.ODOMETRY} <= checked


def test_what_has_no_fixed_places_has_no_layout():
    for msgtype in (topics.POINT_CLOUD, topics.DIAGNOSTICS, "sensor_msgs/msg/NoSuchThing"):
        assert layout_of(msgtype, b"\0\1\0\0" + bytes(200)) is None
    assert layout_of(topics.TEMPERATURE, b"\0\1\0\0" + bytes(8) + b"\xff" * 40) is None


def _write(path, messages, storage, mode=None):
    writer = Writer(path, version=9, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics_of = {source: (f"/{source}", topics.NAV_SAT_FIX) for source in ("gps/fix", "radar/fix")}
        connections = {source: writer.add_connection(*named, typestore=STORE) for source, named in topics_of.items()}
        for source, stamp, raw in messages:
            writer.write(connections[source], stamp, raw)


@pytest.mark.parametrize("storage, mode", [(StoragePlugin.MCAP, None), (StoragePlugin.SQLITE3, None)] + [
    (storage, mode) for storage in (StoragePlugin.MCAP, StoragePlugin.SQLITE3) for mode in (CompressionMode.FILE, CompressionMode.MESSAGE)
    if (storage, mode) != (StoragePlugin.MCAP, CompressionMode.MESSAGE)
] + [(StoragePlugin.MCAP, CompressionMode.STORAGE)])  # fmt: skip
@pytest.mark.parametrize("order", ["as it comes", "topic by topic", "late", "set back"])
def test_windows_hold_what_the_reader_yields(tmp_path, monkeypatch, storage, mode, order):
    """Over several chunks, compressed in every way, with stamps that overlap, tie and go back."""
    n = 1500
    stamps = 10**18 + np.arange(n) // 2 * 10_000_000
    names = np.array(["gps/fix", "radar/fix"])[np.arange(n) % 2]
    if order == "late":
        stamps = np.where(names == "gps/fix", stamps, stamps - 40_000_000)
    elif order == "set back":
        stamps = np.where(np.arange(n) < n // 2, stamps, stamps - 2_000_000_000)
    rows = np.argsort(names, kind="stable") if order == "topic by topic" else np.arange(n)
    numbers = [bytes(3000) + struct.pack("<Q", k) for k in range(n)]
    _write(tmp_path / "bag", [(str(names[k]), int(stamps[k]), numbers[k]) for k in rows.tolist()], storage, mode)
    with BagReader(tmp_path / "bag") as bag:
        expected = [(c.topic.lstrip("/"), stamp, bytes(raw)) for c, stamp, raw in bag._reader.messages(bag._reader.connections)]
        if storage == StoragePlugin.MCAP and order in ("as it comes", "late") and mode != CompressionMode.FILE:
            monkeypatch.setattr(arrival, "batched", None)  # the way through columns is the one that is taken
        windows = list(bag.windows())
        assert [one for window in windows for one in window.messages()] == expected and len(expected) == n
        assert len(windows) > 1 or order == "topic by topic"
        only = [one for window in bag.windows(["radar/fix"]) for one in window.messages()]
        assert only == [one for one in expected if one[0] == "radar/fix"]


def _solutions(rng, n):
    eye = np.eye(3)
    for k in range(n):
        q, what = rng.normal(size=4), rng.integers(4)
        place = (0.6 + 1e-4 * rng.normal(), -2.0, 300.0) if what != 1 else (None, None, None)
        vectors = rng.normal(size=3), q / np.linalg.norm(q), rng.normal(size=3), rng.normal(size=3)
        vel_n, q_nb, rate, force = (None if what == gone else v for gone, v in zip((2, 3, 3, 2), vectors, strict=True))
        covs = (None if value is None else eye * rng.uniform(1.0, 9.0) for value in (place[0], vel_n, q_nb))
        yield m.NavSolution(10**18 + k, "x", *place, vel_n, q_nb, rate, force, *covs)


def test_records_in_columns_are_those_of_the_messages_to_the_bit():
    origin = LocalFrame(0.6, -2.0, 250.0)
    solutions = list(_solutions(np.random.default_rng(4), 40))
    messages = [encode.odometry_from_solution(one, origin) for one in solutions]
    found = records_of_solutions(solutions, columns_of(solutions), origin)
    assert [row.tobytes() for row in found] == [odometry_record(message) for message in messages]
    window = Window.of_messages([("x/odometry_fused", 0, to_cdr(message)) for message in messages])
    stamps, read = records_of_messages(window, np.arange(len(messages)), topics.ODOMETRY)
    assert read.tobytes() == found.tobytes() and stamps.tolist() == [one.stamp_ns for one in solutions]
    turning = [one for one in solutions if one.q_nb is not None]
    attitudes = [encode.imu_from_solution(one) for one in turning]
    found = records_of_solutions(turning, columns_of(turning), None)
    assert [row.tobytes() for row in found] == [imu_record(message) for message in attitudes]
    mixed = [*map(to_cdr, attitudes), b"\0\1", to_cdr(encode.imu_raw(10**18, np.ones(3), np.ones(3), "another_frame"))]
    window = Window.of_messages([("imu/data_fused", 0, raw) for raw in mixed])
    stamps, read = records_of_messages(window, np.arange(len(mixed)), topics.IMU)  # one by one
    assert read[:-1].tobytes() == found.tobytes() and len(stamps) == len(attitudes) + 1


def test_true_states_in_columns_are_those_of_the_solutions(recorded):
    types, messages = recorded
    decoder = Decoder()
    true = [one for one in messages if one[0].startswith("truth/")]
    _, solutions = one_by_one(true, types)
    window = Window.of_messages(true)
    for source, rows in window.by_source():
        columns = columns_of_messages(*decoder.decode_many(window, rows, types[source]))
        expected = columns_of([one for one in solutions if one.source == source])
        for name in ("stamps_ns", "position", "vel_n", "q_nb", "wind_n", "cov_pos", "cov_vel", "cov_att", "cov_wind"):
            np.testing.assert_array_equal(getattr(columns, name), getattr(expected, name))
        assert len(columns) and Counter(one.source for one in solutions)[source] == len(columns)


def test_an_attitude_is_no_solution_in_columns():
    sent = [raw for one in _varied(np.random.default_rng(8), 30) if isinstance(one, m.Attitude) for *_, raw in encode.encode_cdr(one)]
    window = Window.of_messages([("imu/data", 0, raw) for raw in sent])
    found, rest = Decoder().decode_many(window, np.arange(len(sent)), topics.IMU)
    assert found and len(columns_of_messages(found, rest)) == 0


def test_memory_of_a_window_is_bounded_by_bytes(tmp_path):
    with BagWriter(tmp_path / "bag", "sqlite3") as bag:
        for k in range(40):
            bag.write("camera/image", "sensor_msgs/msg/PointCloud2", 10**18 + k, bytes(500_000))
    with BagReader(tmp_path / "bag") as bag:
        assert [len(window) for window in bag.windows()] == [8] * 5
