"""Every executable as a process: clean exit on one and two interrupts, refusal of what cannot run, recorder and player."""

import importlib.util
import signal
import time

import pytest

pytest.importorskip("rclpy")

from lowcostnav_ros.graph.executables import EXECUTABLES, KINDS, kind_of
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.nodes.recorder import free_path, header_stamp_ns

HOLD = ("-p", "start.expected_subscribers:=['truth/imu:9']")


def wait_until_up(ros, *names: str) -> None:
    table = ros.diagnostics()

    def missing() -> set[str]:
        return set(names) - {name for name, _ in ros.probe.get_node_names_and_namespaces()}

    def silent() -> set[str]:
        return {name for name in names if name != "monitor" and not any(row.startswith(f"{name}: ") for row in table)}

    assert ros.spin_until(lambda: not missing(), 60.0), missing()
    # it spins once its diagnostics are heard; a navigator whose kernels are not in the cache yet compiles them first
    assert ros.spin_until(lambda: not silent(), 90.0), silent()


def arguments_of(executable: str, tmp_path) -> tuple[str, ...]:
    if executable == "player":
        return ("-p", f"path:={small_bag(tmp_path)}", "-p", "start.expected_subscribers:=['imu/data_raw:9']")
    if executable == "recorder":
        return ("-p", f"path:={tmp_path / 'recording'}")
    return HOLD if executable == "truth_source" else ()


def small_bag(tmp_path):
    import numpy as np

    from lowcostnav_ros.base.measurements import ImuBlock
    from lowcostnav_ros.messages.bag_writer import BagWriter

    stamps = 10**18 + 10_000_000 * np.arange(100)
    block = ImuBlock.of("imu/data_raw", stamps, np.tile([0.0, 0.0, -9.81], (100, 1)), np.zeros((100, 3)))
    with BagWriter(tmp_path / "small") as bag:
        for stamp, topic, msgtype, cdr in encode_cdr(block):
            bag.write(topic, msgtype, stamp, cdr)
    return tmp_path / "small"


@pytest.mark.parametrize("kind", KINDS)
def test_two_interrupts_end_a_node_cleanly(ros, start, tmp_path, kind):
    processes = {name: start(name, *arguments_of(name, tmp_path)) for name in EXECUTABLES.own() if kind_of(name) == kind and can_run(name)}
    assert processes
    wait_until_up(ros, *processes)
    for name, process in processes.items():
        process.send_signal(signal.SIGINT)
        time.sleep(0.02)  # the second one arrives in the middle of the teardown
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0, (name, process.log.read_text())
        assert "Traceback" not in process.log.read_text(), name


def can_run(executable: str) -> bool:
    """Whether what an executable needs is installed; the extra 'foxglove' need not be."""
    return executable != "foxglove" or importlib.util.find_spec("foxglove") is not None


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_signal_is_enough(ros, start, number):
    process = start("gps_simulator")
    wait_until_up(ros, "gps_simulator")
    process.send_signal(number)
    assert process.wait(5.0) == 0, process.log.read_text()


def test_what_cannot_run_says_so_in_one_sentence_and_exits_with_2(start, tmp_path):
    (tmp_path / "taken").mkdir()
    cases = (
        ("gps_simulator", "rate_hx:=5.0", "did you mean 'rate_hz'"),
        ("gps_simulator", "scenario:=livermoor", "did you mean 'livermore'"),
        ("recorder", f"path:={tmp_path / 'taken'}", "exists already"),
        ("player", "path:=/nowhere", "/nowhere"),
    )
    processes = [start(executable, "-p", value) for executable, value, _ in cases]
    for process, (_, _, sentence) in zip(processes, cases, strict=True):
        assert process.wait(40.0) == 2
        text = process.log.read_text()
        assert sentence in text and "Traceback" not in text


def test_what_the_player_plays_the_recorder_records(ros, start, tmp_path):
    bag = small_bag(tmp_path)
    recorder = start("recorder", "-p", f"path:={tmp_path / 'copy'}", "-p", "qos.lossless:=true")
    wait_until_up(ros, "recorder")
    player = start(
        "player", "-p", f"path:={bag}", "-p", "qos.lossless:=true", "-p", "real_time_factor:=5.0",
        "-p", "start.expected_subscribers:=['imu/data_raw:1']",
    )  # fmt: skip
    table = ros.diagnostics()
    assert ros.spin_until(lambda: "player: source" in table and table["player: source"].message.startswith("finished"), 15.0)
    heard = "recorder: input imu/data_raw"
    assert ros.spin_until(lambda: heard in table and count(table[heard]) == 100, 15.0)
    for process in (player, recorder):
        process.send_signal(signal.SIGINT)
        assert process.wait(5.0) == 0
    with BagReader(bag) as before, BagReader(tmp_path / "copy") as after:
        assert [r[2] for r in after.stream(["imu/data_raw"])] == [r[2] for r in before.stream()]
        assert after.duration_s == pytest.approx(0.99, abs=1e-3)


def count(status) -> int:
    return int(next(e.value for e in status.values if e.key == "count"))


def test_the_stamp_of_a_serialised_message_is_read_without_decoding():
    from lowcostnav_ros.messages.encode import imu_raw
    from lowcostnav_ros.messages.store import to_cdr

    zero = [0.0, 0.0, 0.0]
    assert header_stamp_ns(to_cdr(imu_raw(1_234_567_890_123_456_789, zero, zero))) == 1_234_567_890_123_456_789
    with pytest.raises(ValueError, match="too short"):
        header_stamp_ns(b"\x00\x01")


def test_a_taken_folder_gets_a_number(tmp_path):
    assert free_path(tmp_path / "a") == tmp_path / "a"
    (tmp_path / "a").mkdir()
    (tmp_path / "a_2").mkdir()
    assert free_path(tmp_path / "a") == tmp_path / "a_3"


def test_the_player_plays_satellites_with_the_other_sensors():
    from types import SimpleNamespace

    from lowcostnav_ros.messages.decode import Decoder
    from lowcostnav_ros.nodes.player import Player

    recorded = ("imu/data_raw", "gnss/raw", "truth/odometry", "gnss_only/odometry")
    bag = SimpleNamespace(types=dict.fromkeys(recorded, "any"))
    assert Player._sensors(SimpleNamespace(_bag=bag, decoder=Decoder())) == ["imu/data_raw", "gnss/raw"]
