"""RINEX files on disk, plain or gzip, as observations and ephemerides; a refusal begins with the name of the file."""

import gzip
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.rinex_nav import Navigation, joined, parse_navigation
from lowcostnav_ros.gnss.rinex_obs import Observations, parse_observations

T = TypeVar("T")


def read_observations(path: str | Path) -> Observations:
    """Read an observation file.

    Raises
    ------
    GnssError
        For a file that cannot be used; the sentence begins with its name.
    OSError
        For one that cannot be read.
    """
    return _parsed(path, parse_observations)


def read_navigation(paths: Sequence[str | Path]) -> Navigation:
    """Read one navigation file or more, such as one for each system; raises as :func:`read_observations` does."""
    return joined([_parsed(path, parse_navigation) for path in paths])


def is_rinex(path: str | Path) -> bool:
    """Whether a file begins as a RINEX file does."""
    try:
        return Path(path).is_file() and "RINEX VERSION" in _text(Path(path)).partition("\n")[0]
    except GnssError:
        return False


def holds(path: str | Path) -> str:
    """What a RINEX file holds by its header: ``O`` observations, ``N`` ephemerides of a system that is used, else empty."""
    first = _text(Path(path)).partition("\n")[0].ljust(60).upper()
    if first[20] == "N" and first[40] in " GEM":
        return "N"
    return "O" if first[20] == "O" else ""


def _parsed(path: str | Path, parse: Callable[[str], T]) -> T:
    text = _text(Path(path))
    try:
        return parse(text)
    except GnssError as error:
        raise GnssError(f"{path}: {error}") from error


def _text(path: Path) -> str:
    raw = path.read_bytes()
    if raw[:2] == b"\x1f\x8b":
        try:
            raw = gzip.decompress(raw)
        except (OSError, EOFError, zlib.error) as error:
            raise GnssError(f"{path}: the compressed file is damaged ({error}); get it again.") from error
    return raw.decode("ascii", errors="replace")
