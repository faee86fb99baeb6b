"""Processes that run and do not answer: named, and killed where they will not come back by themselves.

Every node reports at least once a second.  One that is silent and uses no processor time is stopped or waits for ever; one that does use
some may be busy, or starved by the machine, and is given longer.  A killed node is started again as any dead one.
"""

from dataclasses import dataclass

from lowcostnav_ros.graph.process import Event, NodeProcess, What

SILENT_S, BUSY_S = 1.7, 15.0  # reports come every 0.8 to 1.2 s
STILL_S = 0.8  # without any use of a processor
LOSSLESS_S = 20.0  # there a node waits for its listeners, which may take 15 s to be matched


@dataclass(slots=True)
class _Silence:
    cpu_s: float
    moved_s: float  # into the silence, when it last used a processor
    named_again: bool = False

    def still_s(self, cpu_s: float, silent_s: float) -> float:
        """How long no processor time has been used."""
        if cpu_s != self.cpu_s:
            self.cpu_s, self.moved_s = cpu_s, silent_s
        return silent_s - self.moved_s


class Watchdog:
    """Judge the silence of the nodes of one graph."""

    def __init__(self, is_lossless: bool) -> None:
        self.silent_s = LOSSLESS_S if is_lossless else SILENT_S
        self._may_kill = not is_lossless
        self._silent: dict[str, _Silence] = {}

    def look(self, process: NodeProcess, silent_s: float | None) -> Event | None:
        """Return what is to be said of a process that has reported nothing for so long (None: not yet once)."""
        before = self._silent.get(process.name)
        if not process.alive or silent_s is None or silent_s < self.silent_s:
            self._silent.pop(process.name, None)
            return Event(process.name, What.ANSWERS) if before and process.alive and silent_s is not None else None
        words = f"no report for {silent_s:.1f} s{' (the process is stopped)' if process.is_stopped() else ''}"
        if before is None:
            self._silent[process.name] = _Silence(process.cpu_seconds(), silent_s)
            return Event(process.name, What.SILENT, words)
        is_still = before.still_s(process.cpu_seconds(), silent_s) >= STILL_S
        if not (is_still or silent_s >= BUSY_S) or before.named_again:
            return None
        before.named_again = True
        if not self._may_kill or not process.respawn or process.process is None:
            return Event(process.name, What.SILENT, f"still {words}")
        process.process.kill()
        return Event(process.name, What.KILLED, f"gave {words}")
