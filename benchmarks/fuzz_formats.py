"""Mutated byte streams through every parser: no exception, nothing accepted that cannot be, back in step within a frame; prints JSON.

    python benchmarks/fuzz_formats.py               # 10 000 streams for each parser
    python benchmarks/fuzz_formats.py --streams 500 --only ubx --seed 2

Half of the streams are mutated on the wire (bytes changed, lost, added, repeated), half inside the frames, whose check sums are then made
right again: what a receiver with a fault would send.
"""

import argparse
import os
import struct
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
from common import run

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.convert.profile import load_profile
from lowcostnav_ros.convert.stream import TableParser
from lowcostnav_ros.formats import arinc429, crossbow, dme, mavlink, netfix, nmea, ubx
from lowcostnav_ros.formats.mavlink_messages import CHECK_BYTES
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.formats.records import CheckedRecords

TOGETHER = 50
"""Streams whose measurements are checked at once."""
TAIL = 3
"""Good copies of the first frame after each stream: all but the first must be found again."""


def sentence(body: str) -> bytes:
    """An NMEA sentence with its check sum."""
    return f"${body}*{nmea.checksum(body.encode()):02X}\r\n".encode()


def nmea_frames() -> list[bytes]:
    """Two seconds of a receiver."""
    lines = []
    for k in range(2):
        lines += [
            f"GPRMC,12000{k}.00,A,3741.6000,N,12149.2000,W,95.0,273.4,01082{5},,,A",
            f"GPGGA,12000{k}.00,3741.6000,N,12149.2000,W,1,09,0.9,500.0,M,-28.0,M,,",
            f"GPGST,12000{k}.00,1.1,1.2,1.0,30.0,1.1,1.2,2.0",
            "GPGSA,A,3,01,02,03,04,05,06,07,08,,,,,1.8,0.9,1.5",
            f"GPZDA,12000{k}.00,01,08,2025,00,00",
            "PGRMZ,1640,f,3",
        ]
    return [sentence(line) for line in lines]


def ubx_frames() -> list[bytes]:
    """NAV-PVT, NAV-COV, RXM-RAWX and RXM-SFRBX."""
    frames = []
    for k in range(2):
        tow = 302_400_000 + 1000 * k
        pvt = (tow, 2025, 8, 1, 12, 0, k, 7, 20, -400, 3, 1, 0, 12, -1_218_200_000, 376_933_000, 472_000, 500_000, 1500, 2400,
               -2000, 48_000, 10, 48_040, 9_240_000, 300, 100_000, 150)  # fmt: skip
        frames.append(ubx.frame_of(0x01, 0x07, ubx._PVT.pack(*pvt).ljust(92, b"\0")))
        frames.append(ubx.frame_of(0x01, 0x36, struct.pack("<IBBB9x12f", tow, 0, 1, 1, *([1.0, 0.1, 0.0, 1.0, 0.0, 4.0] * 2))))
        raw = np.zeros(6, ubx._SIGNAL)
        raw["pseudorange"], raw["doppler"], raw["sat_id"], raw["cn0"], raw["status"] = 2.2e7, 1200.0, np.arange(1, 7), 42, 1
        frames.append(ubx.frame_of(0x02, 0x15, struct.pack("<dHbBBB2x", 302_400.0 + k, 2377, 18, 6, 1, 1) + raw.tobytes()))
        frames.append(ubx.frame_of(0x02, 0x13, bytes((0, 5, 0, 0, 10, 0, 2, 0)) + struct.pack("<10I", *([0x22C0_0000 + (k << 8)] * 10))))
    return frames


def mavlink_frame(number: int, payload: bytes, sequence: int = 0, version: int = 2, system: int = 1) -> bytes:
    """A frame of component 1."""
    if version == 1:
        body = bytes((len(payload), sequence, system, 1, number)) + payload
    else:
        body = bytes((len(payload), 0, 0, sequence, system, 1)) + number.to_bytes(3, "little") + payload
    check = mavlink.check_sum(body + bytes((CHECK_BYTES[number],)))
    return (b"\xfe" if version == 1 else b"\xfd") + body + check.to_bytes(2, "little")


def mavlink_frames() -> list[bytes]:
    """Every message that is read, in both versions."""
    frames = []
    for k in range(2):
        boot = 10_000 + 100 * k
        place = 376_933_000, -1_218_200_000, 500_000
        gps = struct.pack("<QiiiHHHHBBiIII", 1000 * boot, *place, 90, 140, 4900, 27_340, 3, 12, 472_000, 1200, 1900, 200)
        high = struct.pack("<Q13fH", 1000 * boot, 0.1, 0.2, -9.8, 0.01, 0.0, 0.02, 0.22, 0.05, 0.42, 954.6, 14.5, 500.0, 20.0, 0x1FFF)
        messages = [
            (0, struct.pack("<IBBBBB", 0, 1, 3, 81, 4, 3)),
            (1, struct.pack("<IIIHHhHHHHHHb", 16, 16, 16, 0, 12_000, 0, 0, 0, 0, 0, 0, 0, 50)),
            (2, struct.pack("<QI", 1_754_049_600_000_000 + 1000 * boot, boot)),
            (27, struct.pack("<Q9h", 1000 * boot, 10, 20, -1000, 10, 0, 20, 220, 50, 420)),
            (29, struct.pack("<Iffh", boot, 954.6, 14.5, 2000)),
            (30, struct.pack("<I6f", boot, 0.1, 0.05, 1.2, 0.01, 0.0, 0.02)),
            (33, struct.pack("<IiiiihhhH", boot, 376_933_000, -1_218_200_000, 500_000, 500_000, 100, 4900, 10, 27_340)),
            (74, struct.pack("<ffffhH", 50.0, 49.0, 500.0, 0.1, 273, 60)),
            (295, struct.pack("<ffhBB", 50.0, 12.0, 2000, 0, 2)), (129, struct.pack("<I9h", boot + 60, 10, 20, -1000, 10, 0, 20, 0, 0, 0)),
            (24, gps), (105, high), (26, struct.pack("<I9h", boot + 50, 10, 20, -1000, 10, 0, 20, 220, 50, 420)),
        ]  # fmt: skip
        frames += [mavlink_frame(number, payload, k, 1 if number < 100 and number != 24 and k else 2) for number, payload in messages]
    return frames


def crossbow_frame(counts: dict[str, int], packet: str = "angle") -> bytes:
    """A packet of counts; words that are not named are zero."""
    names = crossbow.LAYOUTS[packet]
    words = struct.pack(f">{len(names)}h", *(counts.get(name, 0) for name in names))
    return crossbow.HEADER + words + bytes([sum(words) & 0xFF])


def crossbow_frames() -> list[bytes]:
    """A unit at rest, 62 packets a second."""
    still = {"roll": 350, "pitch": -50, "heading": 18_400, "p": 15, "q": -51, "r": -6, "x": 40, "y": 364, "z": 10_990}
    still |= {"mx": 4000, "mz": 7000}
    turn = [(20_000 - 20_253 * k) % 65_536 for k in range(12)]
    return [crossbow_frame({**still, "time": count - 65_536 if count > 32_767 else count}) for count in turn]


def arinc_frames() -> list[bytes]:
    """Both label sets and a DME, two rounds."""
    values = {
        0o370: 472.0, 0o247: 20.0, 0o136: 30.0, 0o110: 0.65787, 0o120: 1e-6, 0o111: -2.12616, 0o121: 2e-6, 0o165: 2.0, 0o166: 40.0,
        0o174: -30.0, 0o327: 0.01, 0o326: -0.02, 0o330: 0.03, 0o331: 0.2, 0o332: -0.3, 0o333: -9.8, 0o325: 0.1, 0o324: 0.05, 0o320: 1.8,
        0o035: 16.8, 0o201: 43_429.4,
    }  # fmt: skip
    return [arinc429.frame_of(arinc429.encoded(label, value)) for _ in range(2) for label, value in values.items()]


def dme_frames() -> list[bytes]:
    """Sentences of two stations."""
    return [sentence(body) for body in ("PLDME,OAK,23.45,A", "PLDME,SJC,7.02,A,0.05", "PLDME,OAK,,V", "PLDME,OAK,23.46,A")]


def netfix_frames() -> list[bytes]:
    """Values of a gateway."""
    values = (("AIRPRESS", 95_460.0), ("DIFFAIRPRESS", 1400.0), ("OAT", 14.5), ("IAS", 95.1), ("LAT", 37.6933), ("LONG", -121.82),
              ("TALT", 1640.0), ("LAT", 37.6934), ("LONG", -121.82), ("GS", 95.0), ("TRACK", 273.4), ("TAS", 101.2))  # fmt: skip
    return [*(f"{key};{value};00000\n".encode() for key, value in values), b"@sOAT\n"]


def table_frames() -> list[bytes]:
    """Rows of an IMU."""
    return [f"{1000 + 10 * k},0.02,-0.11,9.81,0.001,-0.002,0.000\n".encode() for k in range(12)]


def again_sound(frame: bytes) -> bytes:
    """The frame with a right check sum, where its protocol has one."""
    if frame[:2] == arinc429.SYNC:
        word = int.from_bytes(frame[3:7], "little") & 0x7FFF_FFFF
        return arinc429.frame_of(word | (0 if arinc429.parity_is_odd(word) else 1 << 31), frame[2])
    if frame[:1] == crossbow.HEADER:
        return frame[:-1] + bytes([sum(frame[1:-1]) & 0xFF])
    if frame[-1:] == b"\n" and frame[:1] != b"$":
        return frame
    if frame[:2] == b"\xb5\x62":
        return frame[:-2] + ubx.checksum(frame[2:-2])
    if frame[:1] == b"$":
        body = frame[1:].rpartition(b"*")[0]
        return b"$" + body + f"*{nmea.checksum(body):02X}\r\n".encode()
    one = frame[:1] == b"\xfe"
    number = frame[5] if one else int.from_bytes(frame[7:10], "little")
    body = frame[1:-2]
    return frame[:1] + body + mavlink.check_sum(body + bytes((CHECK_BYTES.get(number, 0),))).to_bytes(2, "little")


HEADS = {b"\xb5": 6, b"$": 6, b"\xfe": 6, b"\xfd": 10, b"\xff": 1, b"\xa4": 4}
"""Bytes that say which message follows: left alone where the content is mutated."""


def mutated(frames: list[bytes], rng: np.random.Generator, is_sound: bool) -> bytes:
    """A stream with one to eight faults."""
    if is_sound:
        frames = list(frames)
        for _ in range(rng.integers(1, 9)):
            k = int(rng.integers(len(frames)))
            frame, head = bytearray(frames[k]), HEADS.get(frames[k][:1], 0)
            is_text = frame[-1:] == b"\n"
            end = len(frame) - (5 if frame[:1] == b"$" else 1 if is_text or head < 5 else 2)
            for _ in range(rng.integers(1, 9)):
                at = int(rng.integers(head, end))
                text = b"0123456789.,-+eENWMnaif;"
                frame[at] = text[rng.integers(len(text))] if is_text else rng.choice([0, 0x7F, 0x80, 0xFF, rng.integers(256)])
            frames[k] = again_sound(bytes(frame))
        return b"".join(frames)
    stream = bytearray(b"".join(frames))
    for _ in range(rng.integers(1, 9)):
        at, size = int(rng.integers(max(len(stream) - 1, 1))), int(rng.integers(1, 40))
        match rng.integers(5):
            case 0:
                stream[at : at + 1] = rng.bytes(1)
            case 1:
                del stream[at : at + size]
            case 2:
                stream[at:at] = rng.bytes(size)
            case 3:
                stream[at:at] = stream[at : at + size]
            case _:
                del stream[at:]
                stream += rng.bytes(size)
    return bytes(stream)


PARSERS: dict[str, tuple[Callable[[], Parser], Callable[[], list[bytes]]]] = {
    "nmea": (nmea.NmeaParser, nmea_frames),
    "ubx": (ubx.UbloxParser, ubx_frames),
    "mavlink": (mavlink.MavlinkParser, mavlink_frames),
    "crossbow": (lambda: crossbow.CrossbowParser(crossbow.CrossbowUnit()), crossbow_frames),
    "arinc": (lambda: arinc429.ArincParser({11_680: "OAK"}), arinc_frames),
    "dme": (dme.DmeParser, dme_frames),
    "netfix": (netfix.NetfixParser, netfix_frames),
    "table": (lambda: TableParser(load_profile("imu_stream")), table_frames),
}


def pieces(stream: bytes, rng: np.random.Generator) -> Iterator[bytes]:
    """The stream in pieces as a port gives it."""
    at = 0
    while at < len(stream):
        size = int(rng.integers(1, 200))
        yield stream[at : at + size]
        at += size


def fuzz(name: str, streams: int, seed: int = 1) -> dict[str, object]:
    """Feed a parser; return what went wrong, empty lists where nothing did."""
    make, frames_of = PARSERS[name]
    rng, frames, checked = np.random.default_rng(seed), frames_of(), CheckedRecords()
    raised: list[str] = []
    waiting: list[Measurement] = []
    lost, measurements, began, began_ns = 0, 0, time.process_time(), 1_754_049_600 * 10**9
    for k in range(streams):
        parser = make()
        stream = mutated(frames, rng, is_sound=bool(k % 2))
        try:
            for piece in pieces(stream, rng):
                parser.arrived_ns = began_ns = began_ns + 10**7
                waiting += parser.feed(piece)
            before = sum(parser.framer.frames.values())
            waiting += [*parser.feed(frames[0] * TAIL), *parser.close()]
            lost += sum(parser.framer.frames.values()) - before < TAIL - 1
            if k % TOGETHER == TOGETHER - 1 or k == streams - 1:
                measurements += len(checked.of(*waiting))
                waiting.clear()
        except Exception as error:
            if os.environ.get("FUZZ_RAISE"):
                raise
            raised.append(f"{type(error).__name__}: {error}")
    elapsed = time.process_time() - began
    return {
        "streams": streams, "measurements": measurements, "raised": sorted(set(raised)), "out_of_step": lost,
        "refused": checked.refused(),
        "streams_per_cpu_s": round(streams / elapsed, 1),
    }  # fmt: skip


def measure(arguments: argparse.Namespace) -> dict[str, object]:
    """Fuzz every parser."""
    found = {}
    for name in PARSERS:
        if arguments.only in ("", name):
            found[name] = fuzz(name, 200 if arguments.quick else arguments.streams, arguments.seed)
            print(name, found[name], file=sys.stderr, flush=True)
    return found


if __name__ == "__main__":
    run(__doc__ or "", measure, streams={"type": int, "default": 10_000}, only={"default": ""}, seed={"type": int, "default": 1})
