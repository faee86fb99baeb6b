"""Interrupts that wait while kernels are compiled."""

import signal
import threading
from typing import Any

holds = False
"""Whether an interrupt waits while a function is compiled or loaded; for a process without signal handlers of another library."""


class Held:
    """An interrupt that comes while the compiler is at work: raised inside one of its call backs it would be lost."""

    def __init__(self) -> None:
        self._depth, self._came = 0, False
        self._before: Any = None

    def begin(self) -> None:
        """Hold what comes from now on; may be called again before it has ended."""
        self._depth += 1
        if self._before is None and holds and threading.current_thread() is threading.main_thread():
            before = signal.getsignal(signal.SIGINT)
            if callable(before):
                self._before, self._came = before, False
                signal.signal(signal.SIGINT, self._take)

    def _take(self, *_: Any) -> None:
        self._came = True

    def end(self) -> None:
        """Let go what came, and with the last call all."""
        self._depth -= 1
        if self._before is not None and (self._came or not self._depth) and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, self._before)
            self._before = None
            if self._came:
                signal.raise_signal(signal.SIGINT)
