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
from time import perf_counter
from typing import Any, TypeVar

import numpy as np

from lowcostnav_ros.base.interrupts import Held

F = TypeVar("F", bound=Callable)

COMPILING = "compiling for this machine, once"
"""What a line of progress begins with, which a first start says on stderr, or where :data:`tell` leads."""
FIRST_S, EVERY_S = 2.0, 8.0
"""Seconds spent compiling after which the first line is said, and each further one."""
INTERPRETED = os.environ.get("LOWCOSTNAV_KERNELS", "compiled") == "interpreted"

_PACKAGE = Path(__file__).parents[1]
_IMPORT = re.compile(rb"^\s*(?:from|import)\s+lowcostnav_ros(?:\.([\w.]+))?(?:\s+import\s+([\w, ]+))?", re.MULTILINE)


def kernel(function: F) -> F:
    """Compile ``function`` with numba: cached, IEEE arithmetic, numpy division rules."""
    if INTERPRETED:
        return function
    import numba

    _watch_compiler()
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


def on_stderr(words: str) -> None:
    """Say it there."""
    print(words, file=sys.stderr, flush=True)


tell: Callable[[str], None] = on_stderr
"""Where the progress of a first start is said; set by who shows it elsewhere."""


@cache
def _watch_compiler() -> None:
    """Have a line said now and then while kernels are compiled; those that are loaded from the cache are no work."""
    from numba.core import event

    class Holder(event.Listener):
        """Holds interrupts while the compiler, or what loads from its cache, is at work."""

        held = Held()

        def on_start(self, _: event.Event) -> None:
            self.held.begin()

        def on_end(self, _: event.Event) -> None:
            self.held.end()

    event.register("numba:compiler_lock", Holder())
    event.register("numba:compile", progress(lambda words: tell(words)))


def progress(say: Callable[[str], None]) -> Any:
    """Return a listener to the compiler's events that says how far it is."""
    from numba.core import event

    class Progress(event.Listener):
        """Adds up what the outermost compilations take: a kernel compiles those that it calls."""

        depth, count, spent_s, next_s, began = 0, 0, 0.0, FIRST_S, 0.0

        def on_start(self, _: event.Event) -> None:
            self._look()
            self.began = self.began if self.depth else perf_counter()
            self.depth += 1

        def on_end(self, _: event.Event) -> None:
            self._look()
            self.depth, self.count = self.depth - 1, self.count + 1
            self.spent_s += 0.0 if self.depth else perf_counter() - self.began

        def _look(self) -> None:
            spent_s = self.spent_s + (perf_counter() - self.began if self.depth else 0.0)
            if spent_s >= self.next_s:
                self.next_s = spent_s + EVERY_S
                say(f"{COMPILING}: {self.count} functions after {spent_s:.0f} s ...")

    return Progress()


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
