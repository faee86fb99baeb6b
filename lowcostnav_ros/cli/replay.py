"""The replay job: options in, tables and files out, verdict as exit status."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.replay import baseline
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.replay.tables import WIDTH, print_summary, verdict_table
from lowcostnav_ros.replay.withhold import parse_withhold


def replay(arguments: argparse.Namespace) -> int:
    """Replay a bag; 0 when nothing is worse than the baseline, 1 when something is."""
    expected = baseline.load_baseline(Path(arguments.baseline)) if arguments.baseline else None
    for path in (arguments.json, arguments.write_baseline):
        if path and not Path(path).resolve().parent.is_dir():
            raise SettingsError(f"The folder of {path} does not exist; create it first.")
    out = Path(arguments.out) if arguments.out else None
    summary = replay_with_progress(arguments, out, arguments.truth)
    if expected is not None:
        _check_identity(expected[0], summary, arguments.baseline)
    console = result_console()
    print_summary(summary, console)
    wanted = set(summary["navigators"]) if arguments.navigators else None
    judged = [e for e in expected[1] if wanted is None or e.navigator in wanted] if expected is not None else []
    verdicts = baseline.judge(judged, summary)
    if expected is not None:
        summary = {**summary, "verdicts": [{"metric": f"{v.navigator}.{v.metric}", "verdict": v.verdict} for v in verdicts]}
        console.print(verdict_table(verdicts))
        console.print(_verdict_sentence(verdicts), highlight=False)
    _write(arguments, out, summary, console)
    return 1 if any(v.verdict == baseline.WORSE for v in verdicts) else 0


def replay_with_progress(arguments: argparse.Namespace, out: Path | None, truth: str | None = None) -> dict[str, Any]:
    """Replay as the common options of ``replay`` and ``report`` say, with a progress bar on a terminal; return the summary."""
    names = tuple(n.strip() for n in arguments.navigators.split(",") if n.strip()) if arguments.navigators else None
    withhold = tuple(parse_withhold(text) for text in arguments.withhold)
    config = Path(arguments.config) if arguments.config else None
    with progress_bar("replay") as advance:
        options = ReplayOptions(names, config, withhold, truth, out, arguments.registry, advance)
        return replay_bag(arguments.bag if "bag" in arguments else arguments.source, options).summary


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float], None] | None]:
    """A bar on a terminal's stderr, fed with the share done; None elsewhere, so that logs stay clean."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def result_console() -> Console:
    """Where tables go: stdout, never wider than 100 columns."""
    return Console(width=min(WIDTH, Console().width) if sys.stdout.isatty() else WIDTH, soft_wrap=False)


def _check_identity(identity: str | None, summary: dict[str, Any], path: str) -> None:
    found = summary["bag"]["sha256"]
    if identity is not None and identity != found:
        raise baseline.BaselineError(f"Baseline {path} belongs to another bag (sha256 {identity[:16]}, this one is {found[:16]}).")


def _verdict_sentence(verdicts: list[baseline.Verdict]) -> str:
    count = {v: sum(1 for x in verdicts if x.verdict == v) for v in (baseline.BETTER, baseline.SAME, baseline.WORSE)}
    total = ", ".join(f"{n} {verdict}" for verdict, n in count.items())
    return f"{'WORSE' if count[baseline.WORSE] else 'PASS'}: {total}"


def _write(arguments: argparse.Namespace, out: Path | None, summary: dict[str, Any], console: Console) -> None:
    text = json.dumps(summary, indent=1, allow_nan=False)
    if arguments.json:
        Path(arguments.json).write_text(text + "\n", encoding="utf-8")
    if out is not None:
        (out / "summary.json").write_text(text + "\n", encoding="utf-8")
        console.print(f"results in {out}", highlight=False)
    if arguments.write_baseline:
        count = baseline.write_baseline(Path(arguments.write_baseline), summary)
        console.print(f"baseline of {count} metrics in {arguments.write_baseline}", highlight=False)
