"""The command behind ``lowcostnav up``: a graph on a terminal."""

import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.graph.description import Graph, GraphError
from lowcostnav_ros.graph.runner import WATCH_S, GraphRunner
from lowcostnav_ros.graph.table import table

DRAW_S = 1.0


class _Stop(Exception):
    """The operator (or a signal) asked it to stop."""


def up(graph: Graph, out: Path | None = None, show: bool | None = None, until_finished: bool = False) -> int:
    """Bring a graph up and keep it up until Ctrl-C, or until its flight is finished.

    Parameters
    ----------
    graph : Graph
    out : Path, optional
        Where the recording goes.
    show : bool, optional
        Draw a live table; default only on a terminal, elsewhere events are printed.
    until_finished : bool
        Stop when the source has finished.

    Returns
    -------
    int
        0 all went well, 1 a node died on the way (restarted or not), 2 the graph cannot run (the sentence is on stderr).
    """
    show = sys.stdout.isatty() if show is None else show
    before = {number: signal.signal(number, _raise_stop) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        with GraphRunner(graph, out=out, on_event=(lambda _: None) if show else _say) as runner:
            if not show:
                _say(f"{runner.title}; {len(graph.nodes)} nodes; logs in {runner.log_dir}")
            try:
                _watch(runner, show, until_finished)
            except _Stop:
                pass
            finally:
                for number in before:
                    signal.signal(number, signal.SIG_IGN)  # the nodes are being stopped in order; a second Ctrl-C must not break that
        trouble = [event for event in runner.events if event.is_trouble]
        with suppress(OSError):  # the terminal may be gone
            for event in trouble:
                print(event, file=sys.stderr)
            if runner.recording is not None:
                _say(f"recording in {runner.recording}; lowcostnav report {runner.recording} -o report.html shows it")
        return Exit.WORSE if trouble else Exit.OK
    except _Stop:
        return Exit.OK
    except (GraphError, SettingsError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return Exit.CANNOT_RUN
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(what: object) -> None:
    """Print at once, also into a pipe."""
    print(what, flush=True)


def _raise_stop(*_: object) -> None:
    raise _Stop


def _watch(runner: GraphRunner, show: bool, until_finished: bool) -> None:
    if not show:
        _follow(runner, until_finished, once_shown(runner, _say))
        return
    from rich.live import Live

    with Live(_drawn(runner), refresh_per_second=4, transient=False) as live:
        drawn = [0.0]

        def draw() -> None:
            if time.monotonic() - drawn[0] >= DRAW_S:
                drawn[0] = time.monotonic()
                live.update(_drawn(runner))

        _follow(runner, until_finished, draw)


def once_shown(runner: GraphRunner, say: Callable[[str], None]) -> Callable[[], None]:
    """Return what is to be called again and again to say, once, where the flight is shown."""
    printed: list[str] = []

    def look() -> None:
        if not printed and runner.page:
            printed.append(runner.page)
            say(f"the flight is shown at {runner.page}")

    return look


def _drawn(runner: GraphRunner) -> Any:
    """The table; what cannot be drawn must not end a flight."""
    try:
        return table(runner)
    except Exception as error:
        return f"the table cannot be drawn ({type(error).__name__}: {error}); the nodes fly on"


def _follow(runner: GraphRunner, until_finished: bool, each: Callable[[], None]) -> None:
    if until_finished:
        runner.wait_until_finished(each=each)
        return
    while True:
        runner.watch()
        each()
        time.sleep(WATCH_S)
