"""The cache of compiled kernels follows the sources that are inside the machine code."""

from pathlib import Path

import lowcostnav_ros
from lowcostnav_ros.base import kernels
from lowcostnav_ros.cores import inertial

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
