"""Work aside: a call in a fork of this process, which has everything that this one has, and gives back its result alone.

Nothing is sent to it, so what it works on may be as large and as odd as it likes.  A fork that ends without a result (killed, out of
memory, interrupted) costs time and no result: the call is then made here.
"""

import os
import pickle
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from lowcostnav_ros.studies.campaign import cores

T = TypeVar("T")


def room() -> int:
    """How many forks may work beside this process: a core each; none where there is no fork, or a thread, which a fork would lose."""
    return cores() - 1 if sys.platform.startswith("linux") and threading.active_count() == 1 else 0


class Aside(Generic[T]):
    """A call that is made aside, or here once it is asked for.

    Parameters
    ----------
    work : callable
        Without arguments; it must change nothing that lasts, since what it changes is lost.  Its result is pickled.
    is_aside : bool
        Whether it is made in a fork, from now on.
    """

    def __init__(self, work: Callable[[], T], is_aside: bool) -> None:
        self._work, self._pid = work, 0
        if is_aside:
            self._file: Any = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the result has been read
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of the algebra library's threads, which are made for a fork
                self._pid = os.fork()
            if self._pid == 0:
                self._end_with(work)

    def _end_with(self, work: Callable[[], T]) -> None:
        status = 1
        try:
            pickle.dump(work(), self._file)
            self._file.flush()
            status = 0
        finally:
            os._exit(status)  # what is buffered for other files is the parent's to write

    @property
    def is_running(self) -> bool:
        """Whether the fork works on."""
        return self._pid > 0 and os.waitid(os.P_PID, self._pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None

    def result(self) -> T:
        """Return the result, once it is there; to be asked for once."""
        if self._pid > 0:
            with self._file:
                if os.waitpid(self._pid, 0)[1] == 0:
                    self._file.seek(0)
                    found: T = pickle.load(self._file)
                    return found
        return self._work()
