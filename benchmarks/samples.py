"""Every sample log: converted or refused, replayed, compared with what the log's own autopilot believed; prints JSON.

    python benchmarks/samples.py            # all samples of $LOWCOSTNAV_DATA/samples, else ../shared/data/samples
    python benchmarks/samples.py --page     # and writes the table into docs/convert.md
"""

import argparse
import gzip
import tempfile
import time
from pathlib import Path
from typing import Any

from common import data_folder, run

from lowcostnav_ros.convert.any_log import convert_any
from lowcostnav_ros.convert.profile import shipped_profile_for
from lowcostnav_ros.convert.rinex import convert_rinex
from lowcostnav_ros.formats.log import AUTOPILOT
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.replay.result import NavigatorResult

NOT_LOGS = ("LICENSE", "COPYING", "NOTICE", "README", ".chk", "metadata.yaml", ".nav.gz", "_GN.", "_EN.", "_CN.", "yuma")
NAVIGATION = {"static_coldstart_16db.obs.gz": ("*.nav.gz",), "NYA100NOR_2024124_02h_30S_MO.rnx.gz": ("*_GN.rnx.gz", "*_EN.rnx.gz")}
"""Ephemerides of the RINEX files that have some beside them."""
PAGE = Path(__file__).resolve().parents[1] / "docs" / "convert.md"
BEGIN, END = "<!-- samples begin -->", "<!-- samples end -->"
LONGEST = 300


def samples(root: Path) -> list[Path]:
    """The logs, without the licences beside them."""
    return sorted(path for path in root.rglob("*") if path.is_file() and not any(word in path.name for word in NOT_LOGS))


def tried(path: Path, folder: Path) -> dict[str, Any]:
    """Convert and replay a sample; what is refused is a sentence."""
    began = time.perf_counter()
    bag = folder / path.name.replace(".", "_")
    try:
        if path.name in NAVIGATION:
            navigation = [found for pattern in NAVIGATION[path.name] for found in path.parent.glob(pattern)]
            report = convert_rinex(path, navigation, bag)
            return {"format": "RINEX", "topics": report.messages, "seconds": 0.0, "replay": replayed(bag, None)}
        summary = convert_any(unpacked(path, folder), bag)
        if summary is None:
            return {"refused": str(shipped_profile_for(path))}
    except ValueError as error:
        return {"refused": str(error).replace(f"{folder}/", "").replace(str(path), path.name).replace(str(path.parent), path.parent.name)}
    seconds = time.perf_counter() - began
    found: dict[str, Any] = {"format": summary.format, "topics": summary.messages, "seconds": round(seconds, 2)}
    found["mb_per_s"] = round(path.stat().st_size / 1e6 / seconds, 2)
    truth = f"{AUTOPILOT}/odometry" if f"{AUTOPILOT}/odometry" in summary.messages else None
    return found | {"replay": replayed(bag, truth)}


def unpacked(path: Path, folder: Path) -> Path:
    """A database of ROS 2 is not read packed."""
    if not path.name.endswith(".db3.gz"):
        return path
    (folder / path.stem).write_bytes(gzip.decompress(path.read_bytes()))
    return folder / path.stem


def replayed(bag: Path, truth: str | None) -> dict[str, str] | str:
    """The navigators that add something, in a few words each, or why none ran."""
    try:
        result = replay_bag(bag, ReplayOptions(truth=truth, sparing=True))
    except ValueError as error:
        return str(error).replace(str(bag), "it")[:LONGEST]
    return {name: words(one) for name, one in result.navigators.items() if name != "supervisor"} or "no navigator: see the topics"


def words(one: NavigatorResult) -> str:
    """A navigator in a few words: mode at the end, and its difference from the autopilot where there is one."""
    text = f"{one.mode_at_end}, {one.fused.count} solutions" if one.fused.count else f"no solution ({one.mode_at_end})"
    errors = one.errors.whole if one.errors is not None else None
    if errors is None:
        return text
    for name, unit, label in (("horizontal_m", " m", "horizontally"), ("heading_deg", "°", "heading"), ("roll_deg", "°", "roll")):
        size = errors.size(name)
        text += f", {label} {size.median:.2g}{unit} median, {size.p95:.2g}{unit} 95 %" if size is not None else ""
    return text


def page(results: dict[str, dict[str, Any]]) -> str:
    """The results as a table."""
    lines = ["| sample | becomes | navigators, and how far they are from the log's own autopilot |", "|---|---|---|"]
    for name, result in results.items():
        if "refused" in result:
            lines.append(f"| `{name}` | refused | {result['refused'].partition(';')[0].rstrip('.')} |")
            continue
        topics = ", ".join(f"`{topic}` {count}" for topic, count in sorted(result["topics"].items()) if not topic.endswith("/origin"))
        replay = result["replay"]
        text = replay if isinstance(replay, str) else "; ".join(f"`{navigator}`: {words}" for navigator, words in replay.items())
        lines.append(f"| `{name}` | {result['format']}: {topics} | {text} |")
    return "\n".join(lines)


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Try all samples."""
    root = data_folder("samples")
    with tempfile.TemporaryDirectory() as folder:
        results = {}
        for k, path in enumerate(samples(root)):
            if arguments.only and arguments.only not in str(path):
                continue
            place = Path(folder) / str(k)
            place.mkdir()
            results[str(path.relative_to(root))] = tried(path, place)
    if arguments.page:
        text = PAGE.read_text(encoding="utf-8")
        head, tail = text.partition(BEGIN)[0], text.partition(END)[2]
        PAGE.write_text(f"{head}{BEGIN}\n{page(results)}\n{END}{tail}", encoding="utf-8")
    return results


if __name__ == "__main__":
    run(__doc__ or "", measure, page={"action": "store_true"}, only={"default": ""})
