"""Any log to a recording: the format is told by the first bytes of the file, whatever its name."""

import gzip
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from lowcostnav_ros.base.measurements import Attitude, Measurement
from lowcostnav_ros.convert.profile import ConvertError
from lowcostnav_ros.convert.standard import Found, Standard, Summary
from lowcostnav_ros.formats import dataflash, flight_tables, igc, ulog
from lowcostnav_ros.formats.log import NO_DATE_S, Log
from lowcostnav_ros.formats.mavlink import MavlinkParser
from lowcostnav_ros.formats.nmea import NmeaParser
from lowcostnav_ros.formats.parser import UTC, Parser, shifted
from lowcostnav_ros.formats.ubx import UbloxParser
from lowcostnav_ros.messages.bag_writer import new_bag

HEAD = 65_536
"""Bytes looked at to tell a format."""
CHUNK = 65_536
LEAST_IMU_HZ = 20.0
"""Inertial samples slower than this carry no navigator: an attitude in the log is of more use."""


@dataclass(frozen=True)
class Format:
    """A format: its name, whether the first bytes of a file are of it, and how it is read: as a log, or by the parser of a stream."""

    name: str
    fits: Callable[[bytes], bool]
    read: Callable[[Path], Log] | None = None
    parser: Callable[["Options"], Parser] | None = None


@dataclass(frozen=True)
class Options:
    """What a user may say about a log.

    Attributes
    ----------
    day : date, optional
        Of a log that holds times of day alone.
    mounting_deg : tuple of three floats, optional
        Roll, pitch, yaw from the axes of the inertial sensor to those of the body.
    """

    day: date | None = None
    mounting_deg: tuple[float, float, float] | None = None


def _frames(head: bytes, parser: Callable[[], Parser]) -> Counter:
    """Sound frames in the first bytes, by protocol."""
    framer = parser().framer
    for _ in framer.feed(head):
        pass
    return framer.frames


def _is_ubx(head: bytes) -> bool:
    return b"\xb5\x62" in head and _frames(head, UbloxParser)["UBX"] > 0


def _is_nmea(head: bytes) -> bool:
    return b"$" in head and _frames(head, NmeaParser)["NMEA"] > 0


def _is_mavlink(head: bytes) -> bool:
    return sum(_frames(head, MavlinkParser).values()) > 2


FORMATS = (
    Format("PX4 ULog", lambda head: head.startswith(ulog.MAGIC), ulog.read),
    Format("ArduPilot dataflash", lambda head: head.startswith((dataflash.MAGIC, dataflash.TEXT_MAGIC)), dataflash.read),
    Format("IGC flight recorder", igc.fits, igc.read),
    Format("recording of avionics or a simulator", lambda head: flight_tables.dialect_of(head) is not None, flight_tables.read),
    Format("u-blox", _is_ubx, parser=lambda _: UbloxParser()),
    Format("NMEA 0183", _is_nmea, parser=lambda options: NmeaParser(options.day)),
    Format("MAVLink", _is_mavlink, parser=lambda _: MavlinkParser()),
)


def head_of(path: Path) -> bytes:
    """The first bytes of a file, unpacked where it is packed."""
    return next(_chunks(path), b"")


def recognise(path: Path) -> Format | None:
    """Return the format of a file, None where it is of none; raises ConvertError for one that is empty or cannot be read."""
    head = head_of(path)
    if not head:
        raise ConvertError(f"{path} is empty; check that it was recorded.")
    return next((one for one in FORMATS if one.fits(head)), None)


def convert_log(path: Path, form: Format, out_bag: str | Path, options: Options | None = None) -> Summary:
    """Convert a log of a known format to a bag with the standard topics.

    Parameters
    ----------
    path : Path
    form : Format
        As :func:`recognise` tells it.
    out_bag : str or Path
        Bag to create.
    options : Options, optional

    Raises
    ------
    ConvertError, FormatError, BagError
        Each with one sentence that says what to do.
    """
    options = options or Options()
    with new_bag(out_bag) as bag:
        standard = Standard(bag, options.mounting_deg)
        log: Log | None = None
        if form.read is not None:
            log = form.read(path)
            if not log.series:
                raise ConvertError(f"{path}: {_nothing(form.name, log.account.refused, log.account.left_out)}")
            standard.put_series(log.series)
            account, time_base = log.account, log.time_base
        else:
            parser, time_base = _streamed(path, form, options, standard)
            account = parser.account
        standard.close()
        if not standard.found:
            raise ConvertError(f"{path}: {_nothing(form.name, {**account.refused, **standard.rejected()}, account.left_out)}")
        if remark := standard.mounting_remark():
            account.remark(remark)
        return Summary(log.format if log is not None else form.name, time_base, standard.found, account, standard.rejected())


def _nothing(name: str, refused: dict[str, int], left_out: dict[str, int]) -> str:
    what = ", ".join(f"{count} x {reason}" for reason, count in [*refused.items(), *left_out.items()][:6]) or "no message at all"
    return f"this {name} log holds nothing that a navigator could use ({what})."


def _streamed(path: Path, form: Format, options: Options, standard: Standard) -> tuple[Parser, str]:
    """Read a stream twice: first for its clock, its ephemerides and its rates, then for its measurements."""
    assert form.parser is not None
    survey, found = form.parser(options), dict[str, Found]()
    if isinstance(survey, UbloxParser):
        survey.is_locating = False
    for one in _measurements(path, survey):
        found.setdefault(one.source, Found()).add(one.stamp_ns)
    parser = form.parser(options)
    if isinstance(survey, UbloxParser) and isinstance(parser, UbloxParser):
        parser.use(survey.navigation)
    offset_ns, time_base = survey.utc_offset_ns, "UTC" if survey.clock == UTC else "UTC of the GPS receiver, by the device's own clock"
    if offset_ns is None:
        first = min((one.first_ns for one in found.values()), default=0)
        offset_ns = NO_DATE_S * 10**9 - first
        time_base = f"{survey.clock}; no date in the log, 2017-07-14 02:40:00 stands for its start"
    left_out = _left_out(found, survey)
    for one in _measurements(path, parser):
        for written in _renamed(one, offset_ns, left_out):
            standard.put(written)
    parser.account.remarks = list(dict.fromkeys([*survey.account.remarks, *parser.account.remarks]))
    return parser, time_base


def _left_out(found: dict[str, Found], survey: Parser) -> set[str]:
    """Sources that are not written: an attitude beside inertial samples, or inertial samples that are too slow."""
    inertial, attitude = found.get("imu/data_raw"), found.get("imu/data_fused")
    if attitude is None:
        return set()
    if inertial is None or inertial.hertz < LEAST_IMU_HZ:
        if inertial is not None:
            survey.account.remark(
                f"Inertial samples at {inertial.hertz:.1f} Hz are left out, {LEAST_IMU_HZ:.0f} Hz are needed: the attitude serves instead."
            )
        return {"imu/data_raw"}
    survey.account.remark("The device's own attitude is left out: the inertial samples it was made of are there.")
    return {"imu/data_fused"}


def _renamed(one: Measurement, offset_ns: int, left_out: set[str]) -> Iterator[Measurement]:
    """The measurement at its time in UTC, an attitude under both of its topics."""
    if one.source in left_out:
        return
    moved = shifted(one, offset_ns) if offset_ns else one
    yield moved
    if isinstance(moved, Attitude):
        yield replace(moved, source="imu/data")


def _measurements(path: Path, parser: Parser) -> Iterator[Measurement]:
    for chunk in _chunks(path):
        yield from parser.feed(chunk)
    yield from parser.close()


def _chunks(path: Path) -> Iterator[bytes]:
    try:
        with path.open("rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else path.open("rb") as file:
            while chunk := file.read(CHUNK):
                yield chunk
    except (OSError, EOFError, zlib.error) as error:
        raise ConvertError(f"{path} cannot be read to its end: {error}.") from error
