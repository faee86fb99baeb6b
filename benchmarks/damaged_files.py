"""Files damaged in every way a disk, an editor or another program damages them, given to the commands that read them.

Each run must end with status 0, 1 or 2, say a sentence where it refuses, show no traceback, end in time, take less than 1 GB, and leave no
recording behind that is not whole.  Each runs in a process of its own, forked from one that has loaded the package.
"""

import argparse
import contextlib
import faulthandler
import gzip
import io
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from common import run

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from rinex_text import ephemerides, navigation_text, observation_text, seen_at, yuma_text

from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.catalogue.equipment import load_almanac, load_stations
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.physics.earth import geodetic_to_ecef

SECONDS, MEGABYTES = 60, 1000
RUNS = 1000
PLACE = geodetic_to_ecef(0.6755, -0.1588, 120.0)
SCENARIO = """name: short
seed: 3
sensors: [imu, magnetometer, air_data, gps]
truth: {kind: jsbsim, name: demo, mission: ["straight duration_s=20"], rate_hz: 50, duration_s: 8.0}
imu: {profile: automotive, rate_hz: 50.0}
gps: {rate_hz: 2.0, latency_s: 0.1}
"""
TABLE_PROFILE = """tables:
  - file: log.csv
    time: {column: t, unit: s}
    keep: {fix: [1, 5]}
    topics:
      gps/fix:
        lat: {column: lat, unit: deg}
        lon: {column: lon, unit: deg}
        height: {column: alt, unit: m}
        sigma: {constants: [5, 5, 10], unit: m, frame: NED}
      imu/data_raw:
        force: {columns: [ax, ay, az], unit: m/s^2, frame: FRD}
        rate: {columns: [gx, gy, gz], unit: deg/s, frame: FRD}
"""
NAVAIDS = (
    "ident,name,type,frequency_khz,latitude_deg,longitude_deg,elevation_ft,iso_country,dme_frequency_khz,dme_channel,"
    "dme_latitude_deg,dme_longitude_deg,dme_elevation_ft,slaved_variation_deg,usageType,power\n"
    "OAK,Oakland,VORTAC,116800,37.72,-122.22,10,US,116800,115X,,,,17,BOTH,HIGH\n"
    "SJC,San Jose,VOR-DME,114100,37.37,-121.94,50,US,114100,088X,,,,16,BOTH,MEDIUM\n"
)

Damage = Callable[[random.Random, bytes], bytes]


@dataclass(frozen=True)
class Kind:
    """A kind of file: sound content, the commands that read it (``{file}``, ``{out}``, ``{folder}``), and whether it is YAML."""

    name: str
    content: dict[str, bytes]
    commands: tuple[Any, ...]
    written: str = "text"


# what happens to a file ------------------------------------------------------------------------------------------------------


def cut(chance: random.Random, raw: bytes) -> bytes:
    """The end is lost."""
    return raw[: chance.randrange(len(raw) + 1)]


def flip(chance: random.Random, raw: bytes) -> bytes:
    """Single bits, few or many."""
    out = bytearray(raw)
    for _ in range(chance.choice((1, 3, 30, 300))):
        out[chance.randrange(len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def block(chance: random.Random, raw: bytes) -> bytes:
    """A block of zeros, of noise, or of another place of the file."""
    size = min(len(raw), chance.choice((16, 512, 4096)))
    at, source = chance.randrange(len(raw) - size + 1), chance.randrange(len(raw) - size + 1)
    return raw[:at] + chance.choice((bytes(size), chance.randbytes(size), raw[source : source + size])) + raw[at + size :]


def hole(chance: random.Random, raw: bytes) -> bytes:
    """A part is missing or there twice."""
    a, b = sorted(chance.randrange(len(raw) + 1) for _ in range(2))
    return raw[:a] + raw[b:] if chance.random() < 0.5 else raw[:b] + raw[a:]


def noise(chance: random.Random, raw: bytes) -> bytes:
    """Nothing of the file is left."""
    return chance.choice((b"", chance.randbytes(2000), b"\0" * 3000, b"\xff\xfe" + raw[:100], raw[:100].decode("latin-1").encode("utf-16")))


def lines(chance: random.Random, raw: bytes) -> bytes:
    """Lines are lost, doubled or change places."""
    rows = raw.splitlines(keepends=True)
    for _ in range(chance.choice((1, 3, 10))):
        a, b = chance.randrange(len(rows)), chance.randrange(len(rows))
        rows[a : a + 1] = chance.choice(([], [rows[a], rows[a]], [rows[b]]))
        rows = rows or [b"\n"]
    return b"".join(rows)


CELLS = (b"", b"nan", b"inf", b"-1e400", b"9" * 400, b"\xe9\xb0", b"a,b;c\t", b'"', b"-", b"1e9", b"0x10", b"37:41.6", b"\0", b"{}", b"'")


def cells(chance: random.Random, raw: bytes) -> bytes:
    """Words and numbers become others."""
    parts = re.split(rb"([\s,;:\[\]{}]+)", raw)
    for _ in range(chance.choice((1, 1, 4, 20))):
        parts[2 * chance.randrange((len(parts) + 1) // 2)] = chance.choice(CELLS)
    return b"".join(parts)


def encoded(chance: random.Random, raw: bytes) -> bytes:
    """Another program saved it."""
    text = raw.decode("latin-1").replace("e", "é", 3)
    return chance.choice((text.encode("utf-16"), text.encode("latin-1"), text.encode("utf-8-sig"), text.replace("\n", "\r").encode()))


STRANGE = (
    ".inf", "-.nan", "9" * 400, "1e999", "0x" + "f" * 3000, "[]", "{}", "{5: 6}", "[[1], 2]", "2020-99-99", "2026-01-01", "yes", "~",
    "!!python/object:os.system {}", "&a [*a]", "[1, 2, 3]", "text", "5", "-5", "''", "'" + "x" * 5000 + "'", "!!set {a, b}",
    "!!binary aGk=", "[true, 1, x]", '"\\0"',
)  # fmt: skip


def values(chance: random.Random, raw: bytes) -> bytes:
    """A value of YAML becomes one that nobody thought of."""
    rows = raw.decode("utf-8", "replace").split("\n")
    for _ in range(chance.choice((1, 1, 3))):
        places = [k for k, row in enumerate(rows) if ":" in row and not row.lstrip().startswith("#")]
        if places:
            k = chance.choice(places)
            head, mark, rest = rows[k].partition(": ") if chance.random() < 0.7 else rows[k].rpartition(": ")
            end = "".join(c for c in rest if c in "]}")[-1:] if "}" in rest else ""
            rows[k] = head + (mark or ": ") + chance.choice(STRANGE) + end
    return "\n".join(rows).encode("utf-8", "replace")


def whole(chance: random.Random, raw: bytes) -> bytes:
    """The whole document is something else, or hides in itself."""
    laughs = "\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9) if k else 'lol'}]" for k in range(12))
    deep = (b"[" * 1500, b"a: " + b"{a: " * 1500, b"- " * 2000, b"[" * 3000 + b"]" * 3000, b"{" * 400 + b"}" * 400)
    odd = (b"5", b"text", b"- 1\n- 2", b"null", b"&a [*a]", b"&a {b: *a}", b"{1: 2, 3.5: 4}", b"? [1]\n: 2", b"config: 5", laughs.encode())
    return chance.choice(deep + odd + (raw + b"\n" + raw, b"%YAML 9.9\n---\n" + raw, raw + b"\n...\n---\nx: 1"))


def keys(chance: random.Random, raw: bytes) -> bytes:
    """A name of YAML becomes no text, or another."""
    names = re.findall(rb"[A-Za-z_][\w.]*(?=:)", raw) or [b"name"]
    others = (b"5:", b"~:", b"true:", b"1.5:", b"'':", b"[1, 2]:", b"2026-01-01:", b"x" * 3000 + b":")
    return raw.replace(chance.choice(names) + b":", chance.choice(others), 1)


BYTES, TEXT, YAML = (cut, flip, block, hole, noise), (lines, cells, encoded), (values, values, values, whole, keys)
DAMAGES: dict[str, tuple[Damage, ...]] = {"bytes": BYTES, "text": BYTES + TEXT + TEXT, "yaml": BYTES + TEXT + YAML + YAML}


# what there is to damage -----------------------------------------------------------------------------------------------------


def make_kinds(folder: Path) -> list[Kind]:
    """Make one sound file of every kind in ``folder``."""
    (folder / "short.yaml").write_text(SCENARIO)
    for storage in ("mcap", "sqlite3"):
        _command("simulate", folder / "short.yaml", "-o", folder / storage, "--storage", storage)
    _command("replay", folder / "mcap", "--navigators", "ins_gps", "--write-baseline", folder / "baseline.yaml")
    _zstd(folder / "mcap", folder / "zstd")
    replay = ("replay", "{file}", "--navigators", "ins_gps,ahrs")
    bags = [Kind(f"bag, {name}", _files(folder / name), (replay, ("allan", "{file}")), "bytes") for name in ("mcap", "sqlite3", "zstd")]
    report = ("report", "{file}", "-o", "{out}.html", "--navigators", "ahrs")
    bags.append(Kind("bag, messages", _files(folder / "mcap"), (replay, report), "messages"))
    bags.append(Kind("bag, metadata", _files(folder / "sqlite3"), (replay,), "metadata"))
    config = config_dir()
    flown = str(folder / "mcap")
    ins_gps = ("replay", flown, "--config", "{folder}", "--navigators", "ins_gps")
    judged = ("replay", flown, "--navigators", "ins_gps", "--baseline", "{file}")
    convert = ("convert", "{folder}", "--profile", "{folder}/p.yaml", "-o", "{out}")
    gyros = ("--column", "gx,gy,gz", "--unit", "deg/s")
    magcal = ("magcal", "{file}", "--column", "mx,my,mz", "--strength", "48", "-o", "{out}")
    return [
        *bags,
        Kind("settings", {"ins_gps.yaml": (config / "ins_gps.yaml").read_bytes()}, (ins_gps,), "yaml"),
        Kind("scenario", {"a.yaml": SCENARIO.encode()}, (("simulate", "{file}", "-o", "{out}", "--duration", "0.2"),), "yaml"),
        Kind("graph", {"a.yaml": (config / "graphs" / "backup_vor_dme.yaml").read_bytes()}, (load_graph,), "yaml"),
        Kind("IMU profile", {"a.yaml": (config / "profiles" / "crista.yaml").read_bytes()}, (("profiles", "{file}"),), "yaml"),
        Kind("baseline", {"a.yaml": (folder / "baseline.yaml").read_bytes()}, (judged,), "yaml"),
        Kind("column profile", {"p.yaml": TABLE_PROFILE.encode(), "log.csv": _log()}, (convert,), "yaml"),
        Kind("table", {"log.csv": _log(), "p.yaml": TABLE_PROFILE.encode()}, (convert,)),
        Kind("calibration table", {"a.csv": _log()}, (("allan", "{file}", *gyros), ("identify", "{file}", *gyros), magcal)),
        Kind("stations", {"a.csv": (config / "dme_stations_bay_area.csv").read_bytes()}, (load_stations,)),
        Kind("navaid list", {"a.csv": NAVAIDS.encode()}, (("dme", "import", "{file}", "--near", "37.7,-121.8", "-o", "{out}"),)),
        *_rinex(),
    ]


def _rinex() -> list[Kind]:
    satellites = ephemerides()
    epochs = [(s, seen_at(satellites, s, PLACE, 3.0e4 + 100.0 * s)) for s in (0.0, 5.0, 10.0, 20.0)]
    files = {"s.obs": observation_text(epochs, PLACE).encode(), "s.nav": navigation_text(satellites).encode()}
    turned = {name: files[name] for name in ("s.nav", "s.obs")}
    packed = {"s.obs.gz": gzip.compress(files["s.obs"]), "s.nav": files["s.nav"]}
    convert = ("convert", "{folder}/s.obs", "--navigation", "{folder}/s.nav", "-o", "{out}")
    locate = ("gnss", "locate", "{folder}/s.obs", "{folder}/s.nav")
    return [
        Kind("RINEX observations", files, (convert, locate)),
        Kind("RINEX navigation", turned, (convert, locate)),
        Kind("RINEX, gzip", packed, (("gnss", "locate", "{file}", "{folder}/s.nav"),), "bytes"),
        Kind("almanac", {"a.alm": yuma_text(satellites).encode()}, (load_almanac,)),
    ]


def _command(*words: Any) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        status = cli.main([str(word) for word in words])
    if status != 0:
        raise SystemExit(f"The sound input could not be made: {words} ended with status {status}.")


def _files(bag: Path) -> dict[str, bytes]:
    """The files of a bag, the data first."""
    names = sorted((p for p in bag.rglob("*") if p.is_file()), key=lambda p: (p.name == "metadata.yaml", p.suffix == ".yaml", p.name))
    return {str(path.relative_to(bag)): path.read_bytes() for path in names}


def _zstd(bag: Path, out: Path) -> None:
    """The same recording, compressed file by file."""
    import zstandard

    shutil.copytree(bag, out)
    (data,) = out.glob("*.mcap")
    (out / f"{data.name}.zstd").write_bytes(zstandard.compress(data.read_bytes()))
    data.unlink()
    text = (out / "metadata.yaml").read_text()
    content = yaml.safe_load(text)
    information = content["rosbag2_bagfile_information"]
    information |= {"compression_format": "zstd", "compression_mode": "FILE", "relative_file_paths": [f"{data.name}.zstd"]}
    (out / "metadata.yaml").write_text(yaml.safe_dump(content))


def _log() -> bytes:
    rng, rows = np.random.default_rng(2), ["t,fix,lat,lon,alt,ax,ay,az,gx,gy,gz,mx,my,mz"]
    for k in range(400):
        up, around = rng.uniform(-1.0, 1.0), rng.uniform(0.0, 6.28)
        field = 48.0 * np.array([np.sqrt(1 - up * up) * np.cos(around), np.sqrt(1 - up * up) * np.sin(around), up]) + (12.0, -8.0, 20.0)
        sensed = np.concatenate((rng.normal((0.0, 0.0, -9.8), 0.05), rng.normal(0.0, 0.1, 3), field + rng.normal(0.0, 0.2, 3)))
        rows.append(f"{1_700_000_000 + 0.1 * k:.2f},3,37.5,-121.5,100.0," + ",".join(f"{v:.5f}" for v in sensed))
    return "\n".join(rows).encode() + b"\n"


# one run ---------------------------------------------------------------------------------------------------------------------


def sound(kind: Kind, folder: Path) -> Path:
    """Write the files of a kind into ``folder``; return the path to give to a command."""
    bag = folder / "bag" if kind.name.startswith("bag") else folder
    for name, content in kind.content.items():
        (bag / name).parent.mkdir(parents=True, exist_ok=True)
        (bag / name).write_bytes(content)
    return folder / next(iter(kind.content)) if bag == folder else bag


def damage(kind: Kind, chance: random.Random, folder: Path) -> tuple[Path, str]:
    """The same with one of the files damaged; return the name of the damage, too."""
    given, bag = sound(kind, folder), kind.name.startswith("bag")
    if kind.written == "messages":
        return _rewritten(folder / "bag", folder / "new", chance), "messages"
    name = "metadata.yaml" if kind.written == "metadata" or (bag and chance.random() < 0.1) else next(iter(kind.content))
    path = folder / ("bag" if bag else "") / name
    chosen = chance.choice(DAMAGES["yaml" if name.endswith(".yaml") else kind.written])
    path.write_bytes(chosen(chance, path.read_bytes()))
    return given, chosen.__name__


def _rewritten(bag: Path, out: Path, chance: random.Random) -> Path:
    """A sound recording of messages that are not."""
    share = chance.choice((0.001, 0.05, 1.0))
    with BagReader(bag) as reader, BagWriter(out) as writer:
        for source, stamp, raw in reader.stream():
            changed = bytearray(raw)
            if chance.random() < share:
                for _ in range(chance.choice((1, 8))):
                    changed[chance.randrange(4, len(changed))] = chance.choice((0, 1, 127, 128, 240, 255))
                changed = changed[: chance.choice((len(changed), len(changed), chance.randrange(len(changed))))]
            writer.write(source, reader.types[source], stamp, bytes(changed))
    return out


def outcome(command: Any, path: Path, folder: Path) -> tuple[str, str, float]:
    """Run a command in a process of its own; return the outcome, what it printed, and the megabytes it took."""
    printed = folder / "printed.txt"
    child = os.fork()
    if child == 0:
        _child(command, path, folder, printed)
    end = time.monotonic() + SECONDS
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > end:
            os.kill(child, signal.SIGABRT)  # so that the traceback says where
            _, status, usage = os.wait4(child, 0)
            return "hang", printed.read_text(errors="replace"), usage.ru_maxrss / 1024.0
        time.sleep(0.005)
    said, code = printed.read_text(errors="replace"), os.waitstatus_to_exitcode(status)
    megabytes = usage.ru_maxrss / 1024.0
    if code not in (0, 1, 2) or "Traceback" in said:
        return "traceback", said, megabytes
    if megabytes > MEGABYTES:
        return "memory", said, megabytes
    if code == 2 and not said.strip():
        return "silent", said, megabytes
    if code == 2 and (list(folder.glob("out*")) or list(folder.glob(".out*"))):
        return "left behind", said, megabytes
    return ("used", "worse", "refused")[code], said, megabytes


def _child(command: Any, path: Path, folder: Path, printed: Path) -> None:
    file = os.open(printed, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
    os.dup2(file, 1)  # for what does not go through Python
    os.dup2(file, 2)
    sys.stdout = sys.stderr = os.fdopen(file, "w", encoding="utf-8", errors="replace")
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    faulthandler.enable(sys.stderr)
    status = 70
    try:
        status = _main(command, path, folder)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _main(command: Any, path: Path, folder: Path) -> int:
    if callable(command):
        try:
            command(str(path))
        except ValueError as error:
            if not type(error).__module__.startswith("lowcostnav_ros"):
                raise
            print(error)
            return 2
        return 0
    return cli.main([word.format(file=path, out=folder / "out", folder=path.parent) for word in command])


def _refuse_unsound(kinds: list[Kind], folder: Path) -> None:
    """What is refused undamaged shows nothing damaged."""
    for kind in kinds:
        for command in kind.commands:
            folder.mkdir()
            result, said, _ = outcome(command, sound(kind, folder), folder)
            shutil.rmtree(folder)
            if result not in ("used", "worse"):
                raise SystemExit(f"The sound input of '{kind.name}' is {result}: {said[-500:]}")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Damage and run; what fails is printed at once, with the seed that makes it again."""
    runs = options.runs or (60 if options.quick else RUNS)
    counts: Counter[tuple[str, str]] = Counter()
    largest, worst, failures = 0.0, 0.0, []
    deadline = time.monotonic() + options.minutes * 60.0
    with tempfile.TemporaryDirectory(prefix="damaged-") as name:
        kinds = [kind for kind in make_kinds(Path(name)) if options.only in kind.name]
        _refuse_unsound(kinds, Path(name) / "run")
        for number in range(runs):
            chance = random.Random(f"{options.seed} {number}")
            kind = kinds[number % len(kinds)]
            folder = Path(name) / "run"
            folder.mkdir()
            path, how = damage(kind, chance, folder)
            command = chance.choice(kind.commands)
            began = time.monotonic()
            if began > deadline:
                runs = number
                break
            result, said, megabytes = outcome(command, path, folder)
            largest, worst = max(largest, megabytes), max(worst, time.monotonic() - began)
            counts[kind.name, result] += 1
            if result not in ("used", "worse", "refused"):
                failures.append({"run": number, "kind": kind.name, "damage": how, "outcome": result, "said": said[-600:]})
                print(f"run {number}: {kind.name}, {how}: {result}\n{said[-1500:]}", file=sys.stderr, flush=True)
                if options.keep:
                    shutil.copytree(folder, Path(options.keep) / str(number))
            shutil.rmtree(folder)
    table = {kind.name: {result: n for (name, result), n in sorted(counts.items()) if name == kind.name} for kind in kinds}
    limits = {"largest_mb": round(largest), "longest_s": round(worst, 1)}
    return {"runs": runs, "seed": options.seed, **limits, "kinds": table, "failures": failures}


if __name__ == "__main__":
    run(
        __doc__.splitlines()[0],
        measure,
        runs={"type": int, "help": f"how many files (default: {RUNS})"},
        seed={"type": int, "default": 1, "help": "of the damages (default: 1)"},
        minutes={"type": float, "default": 600.0, "help": "stop after this long"},
        only={"default": "", "metavar": "KIND", "help": "kinds whose name holds this"},
        keep={"default": "", "metavar": "DIR", "help": "keep the files of failures there"},
    )
