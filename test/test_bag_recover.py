"""A recording whose recorder was killed, or whose disk was full, is read to its last whole message."""

import errno
import logging
import os
import signal
from pathlib import Path

import pytest

from lowcostnav_ros.cli.main import main
from lowcostnav_ros.messages import bag as bags
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, BagError, BagWriter
from lowcostnav_ros.messages.store import to_cdr

SECOND = 1_000_000_000


def fill(writer: BagWriter, seconds: range) -> None:
    """Ten messages a second on two topics, the bag flushed at the end of each second."""
    for second in seconds:
        for k in range(10):
            stamp_ns = second * SECOND + k * SECOND // 10
            writer.write(("clock", "other/clock")[k % 2], topics.CLOCK, stamp_ns, to_cdr(encode.clock(stamp_ns)))
        writer.flush()


def killed(path: Path, storage: str) -> None:
    """Record five seconds and a half in a process that is killed."""
    pid = os.fork()
    if not pid:
        writer = BagWriter(path, storage)
        fill(writer, range(1, 6))
        for k in range(5):
            writer.write("clock", topics.CLOCK, 6 * SECOND + k, to_cdr(encode.clock(k)))
        os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitpid(pid, 0)[1] == signal.SIGKILL


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_killed_recorder_loses_what_came_since_the_last_flush(tmp_path, storage, caplog, capsys):
    path = tmp_path / "flight"
    killed(path, storage)
    (path / SETTINGS_FOLDER).mkdir()
    (path / SETTINGS_FOLDER / "ahrs.yaml").write_text("{}")
    with caplog.at_level(logging.WARNING), BagReader(path) as bag:
        stamps = [stamp_ns for _, stamp_ns, _ in bag.stream()]
        identity, counts = bag.identity(), bag.counts
        assert not bag.is_closed and bag.duration_s == pytest.approx(4.9)
    assert len(stamps) == 50 and stamps == sorted(stamps) and counts == {"clock": 25, "other/clock": 25}
    assert "the recorder was killed; read to its last message at 4.9 s; 'lowcostnav recover" in caplog.text
    before = {file: file.read_bytes() for file in path.iterdir() if file.is_file()}
    assert main(["recover", str(path)]) == 0 and "50 messages on 2 topics" in capsys.readouterr().out
    with BagReader(tmp_path / "flight_recovered") as copy:
        assert copy.is_closed and copy.identity() == identity and copy.settings_folder is not None
    assert before == {file: file.read_bytes() for file in path.iterdir() if file.is_file()}


@pytest.mark.parametrize("filler", [b"", bytes(3000), b"\xff" * 70])
def test_a_torn_chunk_is_read_to_its_last_whole_message(tmp_path, filler):
    with BagWriter(tmp_path / "whole") as writer:
        fill(writer, range(1, 6))
    whole = (tmp_path / "whole" / "whole.mcap").read_bytes()
    with BagReader(tmp_path / "whole") as bag:
        messages = list(bag.stream())
    (tmp_path / "torn").mkdir()
    last = 0
    for length in range(0, len(whole), 97):
        (tmp_path / "torn" / "torn.mcap").write_bytes(whole[:length] + filler)
        try:
            with BagReader(tmp_path / "torn") as torn:
                found = list(torn.stream())
                assert sum(torn.counts.values()) == len(found) and torn.end_ns == found[-1][1]
        except BagError as error:
            assert length < 1300 and any(words in str(error) for words in ("holds no messages", "cannot be read", "not a recording"))
            continue
        assert [m[:2] for m in found] == [m[:2] for m in messages[: len(found)]] and last <= len(found)
        assert found[:-1] == messages[: len(found) - 1]  # the last may end in what a power cut wrote
        last = len(found)
    assert last == 50


@pytest.mark.parametrize("numbers", [(0, 1, 2), (0, 2, 10)])
def test_the_files_of_a_split_recording_are_read_in_their_order(tmp_path, numbers):
    (tmp_path / "split").mkdir()
    for place, number in enumerate(numbers):
        with BagWriter(tmp_path / f"part{number}") as writer:
            fill(writer, range(1 + 5 * place, 6 + 5 * place))
        data = (tmp_path / f"part{number}" / f"part{number}.mcap").read_bytes()
        (tmp_path / "split" / f"split_{number}.mcap").write_bytes(data if place < 2 else data[:-200])
    with BagReader(tmp_path / "split") as bag:
        stamps = [stamp_ns for _, stamp_ns, _ in bag.stream(["clock"])]
    assert stamps == sorted(stamps) and len(stamps) == 75


def test_a_recording_that_was_closed_and_cut_later_is_refused_and_can_be_recovered(tmp_path, capsys):
    with BagWriter(tmp_path / "cut") as writer:
        fill(writer, range(1, 6))
    file = tmp_path / "cut" / "cut.mcap"
    file.write_bytes(file.read_bytes()[:4000])
    with pytest.raises(BagError, match="try 'lowcostnav recover'"):
        BagReader(tmp_path / "cut")
    assert main(["recover", str(tmp_path / "cut"), "-o", str(tmp_path / "new")]) == 0
    with BagReader(tmp_path / "new") as bag:
        assert 10 < sum(bag.counts.values()) < 50
    assert main(["recover", str(tmp_path / "cut"), "-o", str(tmp_path / "new")]) == 2 and "exists already" in capsys.readouterr().err


class FullDisk:
    """A file on a disk that is full from a length on."""

    def __init__(self, file, length: int) -> None:
        self._file, self.length = file, length

    def write(self, data) -> int:
        room = self.length - self._file.tell()
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._file.write(data[:room])

    def __getattr__(self, name: str):
        return getattr(self._file, name)


@pytest.mark.parametrize("space_comes_back", [False, True])
def test_on_a_full_disk_what_was_recorded_is_kept_and_what_is_lost_is_counted(tmp_path, space_comes_back):
    writer = BagWriter(tmp_path / "full")
    pieces = writer._writer.storage.bio
    pieces._file = disk = FullDisk(pieces._file, 4000)
    refused = 0
    for second in range(1, 12):
        try:
            fill(writer, range(second, second + 1))
        except OSError as error:
            assert error.errno == errno.ENOSPC
            refused += 1
    assert refused > 5 and writer.lost == 10 * refused
    if space_comes_back:
        disk.length = 10**6
        fill(writer, range(20, 22))
        writer.close()
    else:
        with pytest.raises(OSError):
            writer.close()
    kept = 10 * (11 - refused)
    with BagReader(tmp_path / "full") as bag:
        stamps = [stamp_ns for _, stamp_ns, _ in bag.stream()]
        assert bag.is_closed == space_comes_back and sum(bag.counts.values()) == len(stamps) == kept + 20 * space_comes_back
    assert stamps[kept - 1] < 12 * SECOND and (not space_comes_back or stamps[kept] == 20 * SECOND)


def test_nothing_to_recover_is_a_sentence(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "empty.mcap").write_bytes(b"")
    for path in (tmp_path / "empty", tmp_path / "none"):
        with pytest.raises(BagError, match="empty|does not exist"):
            bags.recover(path, tmp_path / "new")
    assert not (tmp_path / "new").exists()
