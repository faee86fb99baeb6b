"""Any log as a standard recording, made once and kept beside it under a name that its content gives."""

import hashlib
import json
import os
import re
from dataclasses import asdict, dataclass
from pathlib import Path

from lowcostnav_ros import __version__
from lowcostnav_ros.convert.any_log import convert_any, is_bag
from lowcostnav_ros.convert.convert import convert
from lowcostnav_ros.convert.profile import ConvertError, shipped_profile_for
from lowcostnav_ros.convert.recognise import Options
from lowcostnav_ros.convert.rinex import convert_rinex
from lowcostnav_ros.convert.rinex_files import holds, is_rinex
from lowcostnav_ros.convert.ros_bags import is_ros_1
from lowcostnav_ros.messages.bag import BagReader

ACCOUNT = "conversion.json"
"""File in the recording that says what was found in the log."""
MOST_FILES = 200
"""Files of a folder in which ephemerides are looked for."""


@dataclass(frozen=True)
class Opened:
    """A log as a recording.

    Attributes
    ----------
    bag : str
    heading : str
        What the log is.
    rows : list of list of str
        Topic, messages, Hz, longest gap in s, of what it was made.
    notes : list of str
        What was refused, left out, decided.
    """

    bag: str
    heading: str
    rows: list[list[str]]
    notes: list[str]


def open_log(path: Path, options: Options | None = None, profile: str | None = None) -> Opened:
    """Return the standard recording of a log, converted now or before.

    Parameters
    ----------
    path : Path
        A log of any format that is converted, a bag, or with ``profile`` a table.
    options : Options, optional
    profile : str, optional
        Column profile of a table; where None the shipped one that fits.

    Raises
    ------
    ConvertError, FormatError, BagError, GnssError
        Each with one sentence that says what to do.
    """
    options = options or Options()
    if path.name == "metadata.yaml" and is_bag(path.parent):
        path = path.parent
    if not path.exists():
        raise ConvertError(f"{path} does not exist; give a log, a bag, or a folder of recorded tables.")
    if is_bag(path) and not is_ros_1(path) and (own := _own(path)) is not None:
        return own
    name = f"{_stem(path)}-{_fingerprint(path, options, profile)}"
    beside = path.resolve().parent
    places = [beside, _kept()] if _takes_files(beside) else [_kept()]
    for folder in places:
        if (account := folder / name / ACCOUNT).is_file():
            return Opened(**json.loads(account.read_text(encoding="utf-8")) | {"bag": str(folder / name)})
    bag = places[0] / name
    opened = _converted(path, bag, options, profile)
    (bag / ACCOUNT).write_text(json.dumps(asdict(opened)), encoding="utf-8")
    return opened


def _own(path: Path) -> Opened | None:
    """A bag with topics of ours, which is replayed as it is; None for one that has none."""
    with BagReader(path) as bag:
        if not bag.decodable():
            return None
        duration_s = max(bag.duration_s, 1e-9)
        rows = [[topic, f"{n}", f"{n / duration_s:.1f}", "", bag.types[topic]] for topic, n in sorted(bag.counts.items())]
        return Opened(str(path), f"recording with the standard topics: {duration_s:.1f} s", rows, [])


def _converted(path: Path, bag: Path, options: Options, profile: str | None) -> Opened:
    if profile is None and is_rinex(path):
        return _of_rinex(path, bag)
    summary = None if profile else convert_any(path, bag, options)
    if summary is not None:
        return Opened(str(bag), summary.heading, [list(row) for row in summary.rows()], summary.notes())
    try:
        profile = profile or shipped_profile_for(path)
    except ConvertError as error:
        guess = f"'lowcostnav convert --guess {path} -o my.yaml'"
        text = f"{path} is of no known format; if it is a table, write a first profile with {guess}, then give --profile my.yaml."
        raise ConvertError(text) from error
    report = convert(path, profile, bag)
    with BagReader(bag) as made:
        duration_s = max(made.duration_s, 1e-9)
    rows = [[topic, f"{n}", f"{n / duration_s:.1f}", "", f"profile {profile}"] for topic, n in sorted(report.messages.items())]
    return Opened(str(bag), f"tables, read by the profile {profile}", rows, str(report).splitlines()[len(rows) :])


def _of_rinex(path: Path, bag: Path) -> Opened:
    """Observations with all ephemerides that lie beside them."""
    if holds(path) != "O":
        raise ConvertError(f"{path} holds ephemerides; open the observation file that they belong to.")
    beside = sorted(p for p in list(path.resolve().parent.iterdir())[:MOST_FILES] if is_rinex(p) and holds(p) == "N")
    if not beside:
        raise ConvertError(f"{path} is a RINEX observation file, and no file of ephemerides lies beside it; put one there.")
    report = convert_rinex(path, beside, bag)
    notes = [f"ephemerides: {', '.join(p.name for p in beside)}", *str(report).splitlines()[len(report.messages) :]]
    rows = [[topic, f"{n}", "", "", "pseudoranges, corrected"] for topic, n in sorted(report.messages.items())]
    return Opened(str(bag), "RINEX observations, GPS time made UTC", rows, notes)


def _stem(path: Path) -> str:
    return re.sub(r"[^\w.-]", "_", path.name.removesuffix(".gz")) + ".bag"


def _fingerprint(path: Path, options: Options, profile: str | None) -> str:
    """Of the content, of what was said about it, and of the version that reads it."""
    said = Path(profile).read_text(encoding="utf-8") if profile and Path(profile).is_file() else profile
    digest = hashlib.sha256(f"{__version__} {options} {said}".encode())
    for file in sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()[:10]


def _takes_files(folder: Path) -> bool:
    """Whether a folder may be written into; one that is marked read-only is left alone even by who could write there."""
    return os.access(folder, os.W_OK) and bool(folder.stat().st_mode & 0o222)


def _kept() -> Path:
    """Folder for recordings of logs that lie where nothing can be written."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lowcostnav" / "opened"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


