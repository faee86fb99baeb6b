"""The cache of compiled kernels follows the sources that are inside the machine code."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lowcostnav_ros
from lowcostnav_ros.base import interrupts, kernels
from lowcostnav_ros.cores import inertial
from lowcostnav_ros.physics.rotation import quat_rotate

PACKAGE = Path(lowcostnav_ros.__file__).parent


def test_the_closure_reaches_the_kernels_of_other_files():
    direct = kernels._imports(PACKAGE / "cores" / "inertial.py")
    assert PACKAGE / "physics" / "strapdown.py" in direct
    assert PACKAGE / "estimation" / "kalman.py" in direct


def test_a_change_two_imports_away_changes_the_cache_folder(monkeypatch):
    file = PACKAGE / "cores" / "inertial.py"
    before = kernels._closure_hash.__wrapped__(file)
    original = Path.read_bytes
    def changed(path):
        return original(path) + (b"#" if path.name == "earth.py" else b"")

    monkeypatch.setattr(Path, "read_bytes", changed)
    assert kernels._closure_hash.__wrapped__(file) != before
    assert kernels._closure_hash.__wrapped__(PACKAGE / "base" / "units.py") == kernels._closure_hash(PACKAGE / "base" / "units.py")


def test_compiled_kernels_lie_under_the_cache_root():
    path = Path(inertial.covariance_step.stats.cache_path)
    assert kernels.cache_root() in path.parents


SECOND = """
import numpy as np
import pytest
from lowcostnav_ros.physics.rotation import quat_rotate
quat_rotate(np.array([1.0, 0.0, 0.0, 0.0]), np.ones(3))
print(sum(quat_rotate.stats.cache_hits.values()), sum(quat_rotate.stats.cache_misses.values()))
"""


def test_a_second_process_loads_what_a_first_has_compiled():
    quat_rotate(np.array([1.0, 0.0, 0.0, 0.0]), np.ones(3))
    found = subprocess.run([sys.executable, "-c", SECOND], check=True, capture_output=True, text=True).stdout
    assert found.split() == ["1", "0"]


def test_a_folder_that_others_could_fill_is_no_cache(tmp_path, monkeypatch):
    monkeypatch.setattr(kernels.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(kernels.Path, "mkdir", lambda path, *a, **k: os.mkdir(path, 0o700) if path.parent == tmp_path else no_home())
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    root = kernels.cache_root.__wrapped__
    monkeypatch.setattr(kernels, "_own_folder", own := kernels._own_folder)
    folder = root()
    assert folder is not None and folder.parent == tmp_path and folder.stat().st_mode & 0o777 == 0o700
    monkeypatch.undo()
    assert own(folder) == folder
    folder.chmod(0o770)
    assert own(folder) is None
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "file").write_text("")
    assert own(tmp_path / "link") is None and own(tmp_path / "file") is None and own(tmp_path / "none" / "below") is None
    monkeypatch.setattr(kernels.os, "getuid", lambda: os.stat(tmp_path).st_uid + 1)
    assert own(tmp_path / "elsewhere") is None


def no_home() -> None:
    raise PermissionError("no home")


def test_a_first_start_says_how_far_the_compiler_is_and_a_second_one_nothing(monkeypatch):
    from numba.core import event

    said, clock = [], [0.0]
    monkeypatch.setattr(kernels, "perf_counter", lambda: clock[0])
    listener = kernels.progress(said.append)
    with event.install_listener("numba:compile", listener):
        for _ in range(20):
            with event.trigger_event("numba:compile"):
                clock[0] += 0.5
                with event.trigger_event("numba:compile"):  # what it calls: its time counts once
                    clock[0] += 0.5
            clock[0] += 100.0  # flown, not compiled
        assert [line.split(": ")[1] for line in said] == [f"{n} functions after {s} s ..." for n, s in ((2, 2), (18, 10), (34, 18))]
        assert all(line.startswith(kernels.COMPILING) for line in said)
        before = listener.count
        fresh = kernels.kernel(lambda x: x + 1.0)
        assert fresh(1.0) == 2.0 and listener.count == before + 1
        assert fresh(2.0) == 3.0 and listener.count == before + 1


def test_an_interrupt_waits_until_the_compiler_has_ended(monkeypatch):
    monkeypatch.setattr(interrupts, "holds", True)
    ours, held = signal.default_int_handler, interrupts.Held()
    before = signal.signal(signal.SIGINT, ours)  # a job in a shell's background would ignore it
    held.begin()
    held.begin()
    signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        held.end()  # within the outer one: as soon as it may
    held.end()
    assert signal.getsignal(signal.SIGINT) is ours
    held.begin()
    held.end()
    assert signal.getsignal(signal.SIGINT) is ours
    signal.signal(signal.SIGINT, before)
