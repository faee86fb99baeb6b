"""The one door for a log of any known format: what it is, and its conversion, or one sentence that says what is known instead."""

from collections.abc import Mapping
from pathlib import Path

from lowcostnav_ros.convert.profile import ConvertError
from lowcostnav_ros.convert.recognise import FORMATS, Options, convert_log, head_of, recognise
from lowcostnav_ros.convert.rinex_files import is_rinex
from lowcostnav_ros.convert.ros_bags import convert_bag, is_ros_1
from lowcostnav_ros.convert.standard import Summary

OTHERS = {
    b"\xaa\x44\x12": "NovAtel binary",
    b"$@": "Septentrio SBF",
    b"\xa0\xa2": "SiRF binary",
    b"\x10\x8f": "Trimble TSIP",
    b"CRINEX": "Hatanaka-compressed RINEX",
    b"MATLAB": "a Matlab file",
    b"PK\x03\x04": "a zip archive",
    b"SQLite format 3": "a packed database of ROS 2, to be unpacked beside its metadata.yaml",
}
"""Formats that are met and not read, by what they begin with or hold early."""


def _other(head: bytes) -> str | None:
    """The name of a format that is not read; lines of comment before it do not count."""
    while head.startswith(b"#") and b"\n" in head:
        head = head.partition(b"\n")[2]
    if head[:1] == b"\xd3" and head[1:2] < b"\x04":
        return "RTCM 3"
    if head[:1] == b"\x10" and b"\x10\x03\x10" in head:
        return "Garmin binary or Trimble TSIP"
    return next((name for mark, name in OTHERS.items() if mark in head[:512]), None)


def is_bag(path: Path) -> bool:
    """Whether a path is a bag of ROS 1 or ROS 2."""
    return is_ros_1(path) or path.suffix in (".mcap", ".db3") or (path / "metadata.yaml").is_file()


def convert_any(path: Path, out_bag: str | Path, options: Options | None = None, maps: Mapping[str, str] | None = None) -> Summary | None:
    """Convert a log of any known format; return None for a table, which a profile describes.

    Raises
    ------
    ConvertError, FormatError, BagError
        Each with one sentence that says what to do.
    """
    options = options or Options()
    if is_bag(path):
        return convert_bag(path, out_bag, maps, options.mounting_deg)
    if not path.is_file():
        return None
    form = recognise(path)
    if form is not None:
        return convert_log(path, form, out_bag, options)
    if is_rinex(path):
        raise ConvertError(f"{path} is a RINEX file; name the file of its ephemerides with --navigation.")
    head = head_of(path)[:4096]
    other = _other(head)
    known = ", ".join(one.name for one in FORMATS)
    if other is not None:
        raise ConvertError(f"{path} looks like {other}, which is not read; known are {known}, bags of ROS 1 and 2, RINEX and tables.")
    if b"\0" in head:
        raise ConvertError(f"{path} is of no known format; known are {known}, bags of ROS 1 and 2, RINEX and tables.")
    return None
