"""The one way this package compiles its hot paths.

``@kernel`` marks a small function on float64 arrays in the subset numba compiles.  The compiled code is cached on disk so a
node starts warm; with ``NUMBA_DISABLE_JIT=1`` the same source runs as plain Python for debugging and coverage.  IEEE rules are
kept (no fast-math): a replay must equal the flight to the last bit.

numba keys its cache on the file of a function alone, though the machine code also holds the kernels it calls from other files.
So the cache folder carries a hash of the file and of everything of this package that it imports: a changed gravity model can
never fly on as yesterday's machine code inside today's filter.
"""

import hashlib
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable)

INTERPRETED = os.environ.get("LOWCOSTNAV_KERNELS", "compiled") == "interpreted"

_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(rb"^\s*(?:from|import)\s+lowcostnav_ros(?:\.([\w.]+))?(?:\s+import\s+([\w, ]+))?", re.MULTILINE)


def kernel(function: F) -> F:
    """Compile ``function`` with numba: cached, IEEE arithmetic, numpy division rules."""
    if INTERPRETED:
        return function
    import numba

    config: Any = numba.core.config
    root = cache_root()
    compiler: Any = numba.njit(cache=root is not None, fastmath=False, error_model="numpy")
    file = Path(sys.modules[function.__module__].__file__ or "")
    if config.DISABLE_JIT or root is None or _PACKAGE not in file.parents:
        return compiler(function)
    before, config.CACHE_DIR = config.CACHE_DIR, str(root / _closure_hash(file))
    try:
        return compiler(function)
    finally:
        config.CACHE_DIR = before


def plain(column: np.ndarray) -> np.ndarray:
    """A column of numbers or truth values as compiled code takes it: contiguous, float64 or bool."""
    return np.ascontiguousarray(column, dtype=bool if column.dtype == bool else float)


@cache
def cache_root() -> Path | None:
    """Folder of the compiled kernels: NUMBA_CACHE_DIR, else the user's cache, else a temporary folder of this user's own, else none.

    What lies in it is loaded as code, so a folder that others could have filled is not used.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"])
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~")) / ".cache") / "lowcostnav_ros"
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            return root
    except OSError:
        return _own_folder(Path(tempfile.gettempdir()) / f"lowcostnav_ros_{os.getuid()}")


def _own_folder(path: Path) -> Path | None:
    """Make a folder that only this user can read and write; None where something else is in its place."""
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        found = path.lstat()
    except OSError:
        return None
    is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    return path if is_own else None


@cache
def _closure_hash(file: Path) -> str:
    """Hash of a module's source and of every module of this package it imports, directly or not."""
    seen: set[Path] = set()
    waiting = [file]
    while waiting:
        path = waiting.pop()
        if path not in seen and path.is_file():
            seen.add(path)
            waiting += _imports(path)
    digest = hashlib.sha256()
    for path in sorted(seen):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _imports(path: Path) -> tuple[Path, ...]:
    found = []
    for module, names in _IMPORT.findall(path.read_bytes()):
        base = _PACKAGE.joinpath(*module.decode().split(".")) if module else _PACKAGE
        found.append(base.with_suffix(".py"))
        found += [base / f"{name.strip()}.py" for name in names.decode().split(",") if name.strip()]
    return tuple(found)
