"""Recordings: both storages, order, chunks that change no bit, identity, and a sentence for everything that is wrong."""

import numpy as np
import pytest

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.messages import encode as e
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagError, BagWriter
from lowcostnav_ros.messages.decode import Rejected, decode
from lowcostnav_ros.messages.store import to_cdr

T0 = 1_700_000_000_000_000_000


def write(path, storage="mcap", seconds=3, bad_every=0):
    """100 Hz inertial samples, 5 Hz fixes; returns the inertial block that was written."""
    n = seconds * 100
    rng = np.random.default_rng(3)
    block = m.ImuBlock.of("imu/data_raw", T0 + np.arange(n) * 10_000_000, rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
    with BagWriter(path, storage) as bag:
        for k, (stamp, topic, msgtype, raw) in enumerate(e.encode_cdr(block)):
            if bad_every and k % bad_every == 0:
                raw = to_cdr(e.imu_raw(stamp, np.full(3, np.nan), np.zeros(3)))
            bag.write(topic, msgtype, stamp, raw)
            if k % 20 == 19:
                fix = m.GpsPosition(stamp - 50_000_000, "gps/fix", 0.6, -2.0, 100.0 + k, np.eye(3))
                for _stamp, topic, msgtype, raw in e.encode_cdr(fix):
                    bag.write("/" + topic, msgtype, stamp, raw)
        bag.write("diagnostics", topics.DIAGNOSTICS, stamp, to_cdr(e.diagnostics(stamp, [])))
    return block


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_what_is_written_comes_back_in_order(tmp_path, storage):
    block = write(tmp_path / "bag", storage)
    with BagReader(tmp_path / "bag") as bag:
        assert bag.counts == {"imu/data_raw": 300, "gps/fix": 15, "diagnostics": 1}
        assert bag.types["gps/fix"] == topics.NAV_SAT_FIX
        assert (bag.start_ns, bag.end_ns) == (T0, T0 + 2_990_000_000)
        measurements = list(bag.measurements())
    assert [x.source for x in measurements] == ["imu/data_raw", "gps/fix"] * 15
    assert [len(x) for x in measurements[::2]] == [20] * 15  # runs end where another measurement stands between
    assert np.concatenate([x.specific_force_b for x in measurements[::2]]).tobytes() == block.specific_force_b.tobytes()
    assert np.concatenate([x.stamps_ns for x in measurements[::2]]).tobytes() == block.stamps_ns.tobytes()


@pytest.mark.parametrize("chunk_s", [0.001, 0.07, 0.2, 100.0])
def test_chunks_change_no_value_and_equal_decoding_one_by_one(tmp_path, chunk_s):
    write(tmp_path / "bag", bad_every=7)
    with BagReader(tmp_path / "bag") as bag:
        got = list(bag.measurements(["imu/data_raw", "gps/fix"], chunk_s))
        rejected = dict(bag.decoder.rejected)
        singles = [decode(s, bag.types[s], raw) for s, _t, raw in bag.stream(["imu/data_raw", "gps/fix"])]
    good = [x for x in singles if not isinstance(x, Rejected)]
    expected = b"".join(x.specific_force_b.tobytes() for x in good if isinstance(x, m.ImuBlock))
    assert b"".join(x.specific_force_b.tobytes() for x in got if isinstance(x, m.ImuBlock)) == expected
    order = [(x.source, t) for x in got for t in (x.stamps_ns.tolist() if isinstance(x, m.ImuBlock) else [x.stamp_ns])]
    assert order == [(x.source, x.stamp_ns) for x in good]
    assert rejected == {("imu/data_raw", "specific force is not finite"): 43}


def test_identity_is_of_the_content(tmp_path):
    write(tmp_path / "a")
    write(tmp_path / "b", "sqlite3")
    write(tmp_path / "c", bad_every=100)
    one, two, other = (BagReader(tmp_path / name).identity() for name in "abc")
    assert one == two != other
    assert (tmp_path / "a" / "a.mcap").read_bytes() == (write(tmp_path / "x" / "a"), (tmp_path / "x" / "a" / "a.mcap").read_bytes())[1]


def test_a_storage_file_without_its_folder_opens(tmp_path):
    write(tmp_path / "bag")
    with BagReader(tmp_path / "bag" / "bag.mcap") as bag:
        assert bag.counts["imu/data_raw"] == 300


def test_writer_keeps_what_was_recorded_when_its_body_fails(tmp_path):
    with pytest.raises(RuntimeError), BagWriter(tmp_path / "bag") as bag:
        bag.write("clock", topics.CLOCK, T0, to_cdr(e.clock(T0)))
        raise RuntimeError
    with BagReader(tmp_path / "bag") as bag:
        assert bag.counts == {"clock": 1}


def refusal(action):
    with pytest.raises(BagError) as caught:
        action()
    text = str(caught.value)
    assert text.endswith(".")
    assert "\n" not in text
    return text


def test_every_unusable_recording_has_its_sentence(tmp_path):
    write(tmp_path / "bag")
    (tmp_path / "folder").mkdir()
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "fake.mcap").write_bytes(b"hello, this is no recording at all, it is only long enough to be read")
    (tmp_path / "zero.mcap").write_bytes(b"")
    whole = (tmp_path / "bag" / "bag.mcap").read_bytes()
    with BagWriter(tmp_path / "empty"):
        pass
    assert "does not exist" in refusal(lambda: BagReader(tmp_path / "nothing"))
    assert "is not a recording" in refusal(lambda: BagReader(tmp_path / "folder"))
    assert "is not a recording" in refusal(lambda: BagReader(tmp_path / "notes.txt"))
    assert "is not a recording" in refusal(lambda: BagReader(tmp_path / "fake.mcap"))
    assert "truncated" in refusal(lambda: BagReader(tmp_path / "zero.mcap"))
    (tmp_path / "bag" / "bag.mcap").write_bytes(whole[: len(whole) // 2])
    assert "truncated" in refusal(lambda: BagReader(tmp_path / "bag"))
    assert "holds no messages" in refusal(lambda: BagReader(tmp_path / "empty"))
    assert "exists already" in refusal(lambda: BagWriter(tmp_path / "bag"))
    assert "use mcap or sqlite3" in refusal(lambda: BagWriter(tmp_path / "new", "rosbag1"))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_damage_anywhere_is_a_sentence_never_another_exception(tmp_path, storage):
    write(tmp_path / "bag", storage)
    (file,) = [p for p in (tmp_path / "bag").iterdir() if p.suffix in (".mcap", ".db3")]
    whole = file.read_bytes()
    for part in range(1, 8):
        file.write_bytes(whole[: len(whole) * part // 8])
        try:
            with BagReader(tmp_path / "bag") as bag:
                list(bag.measurements())
        except BagError as error:
            assert str(error).endswith(".")


def test_missing_topic_and_wrong_type_are_named(tmp_path):
    write(tmp_path / "bag")
    with BagWriter(tmp_path / "odd") as bag:
        bag.write("gps/fix", topics.TEMPERATURE, T0, to_cdr(e.encode(m.AirTemperature(T0, "x", 280.0, 1.0))))
    with BagReader(tmp_path / "bag") as bag:
        text = refusal(lambda: list(bag.measurements(["gps/fixx"])))
        assert "no topic 'gps/fixx' (did you mean 'gps/fix'?)" in text
    with BagReader(tmp_path / "odd") as bag:
        assert "is of type sensor_msgs/msg/Temperature, expected sensor_msgs/msg/NavSatFix" in refusal(lambda: bag.require(["gps/fix"]))
        assert list(bag.measurements()) == []


def numbered(path, storage, order):
    """A recording of messages (topic, receive stamp in s) in this order; each carries its number in it."""
    with BagWriter(path, storage) as bag:
        for k, (topic, second) in enumerate(order):
            fix = m.GpsPosition(T0 + k, topic, 0.6, -2.0, float(k), np.eye(3))
            ((stamp, _, msgtype, raw),) = e.encode_cdr(fix)
            bag.write(topic, msgtype, T0 + round(second * 1e9), raw)


def read_numbers(bag):
    """Numbers of the messages as they are read."""
    return [int(decode("gps/fix", topics.NAV_SAT_FIX, raw).stamp_ns) - T0 for _source, _stamp, raw in bag.stream()]


def step_back(seconds, messages):
    """Two topics in turn, 10 Hz; half way the clock is set back."""
    return [(("gps/fix", "radar/fix")[k % 2], 0.1 * k - (seconds if k >= messages // 2 else 0.0)) for k in range(messages)]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("messages", [60, 20_000])  # within a chunk, and over several
def test_after_a_step_of_the_clock_messages_come_as_they_arrived(tmp_path, storage, messages):
    numbered(tmp_path / "bag", storage, step_back(2.0, messages))
    with BagReader(tmp_path / "bag") as bag:
        assert read_numbers(bag) == list(range(messages))
        assert bag._reader.storage.storages[0].goes_back


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_topics_written_one_after_the_other_are_merged_by_stamp(tmp_path, storage):
    order = sorted(step_back(0.0, 60), key=lambda pair: pair[0])
    numbered(tmp_path / "bag", storage, order)
    with BagReader(tmp_path / "bag") as bag:
        numbers = read_numbers(bag)
    assert numbers == sorted(range(60), key=lambda k: order[k][1]) != list(range(60))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_killed_recording_with_a_step_of_the_clock_comes_as_it_arrived(tmp_path, storage):
    numbered(tmp_path / "bag", storage, step_back(2.0, 60))
    (tmp_path / "bag" / "metadata.yaml").unlink()
    file = next((tmp_path / "bag").iterdir())
    if storage == "mcap":
        file.write_bytes(file.read_bytes()[:-200])
    with BagReader(tmp_path / "bag") as bag:
        assert read_numbers(bag) == list(range(60))
