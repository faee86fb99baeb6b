"""What a reader of a recorded log returns: columns by topic in SI and NED/FRD, and an account of what it found."""

import gzip
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.units import STANDARD_GRAVITY
from lowcostnav_ros.formats.parser import Account

AUTOPILOT = "autopilot"
"""Name of the recorder's own solution among the navigators: its odometry is what replays are compared with."""
ATTITUDE_SIGMA = np.radians([1.0, 1.0, 5.0])
"""Of an autopilot's attitude about north, east and down, rad: what a heading by a small compass is worth."""
ATTITUDE_STEP_NS, LONGEST_BRIDGE_NS = 5 * 10**8, 6 * 10**9
"""Interval of an attitude made of headings, and the longest between two of them."""
NO_DATE_S = 1_500_000_000
"""Start of a log without a date, s of UTC."""


class FormatError(ValueError):
    """A log that cannot be used; the message is one sentence that says what to do."""


def rising(stamps_ns: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Which rows (n,) of those ``kept`` (n,) have a stamp beyond all before them."""
    out = kept.copy()
    out[kept] = np.diff(np.maximum.accumulate(stamps_ns[kept]), prepend=-1) > 0
    return out


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One topic of a log.

    Attributes
    ----------
    topic : str
        As the kind of a message names it; :data:`AUTOPILOT` for the recorder's own solution (lat, lon, height, velocity, quaternion).
    stamps_ns : ndarray of int64, shape (n,)
    fields : dict of field to ndarray, shape (n,) or (n, k)
        Fields of that kind (``Kind.fields``).
    """

    topic: str
    stamps_ns: np.ndarray
    fields: dict[str, np.ndarray]


@dataclass(slots=True)
class Log:
    """What was read of a log: ``time_base`` says in words what the stamps are."""

    format: str
    series: list[Series] = field(default_factory=list)
    account: Account = field(default_factory=Account)
    time_base: str = "UTC"

    def add(self, topic: str, stamps_ns: np.ndarray, origin: str, **fields: Any) -> None:
        """Add the rows of a topic whose stamps rise and whose fields are finite; a constant stands for all rows."""
        n = len(stamps_ns)
        if not n:
            return
        columns = {name: np.broadcast_to(values, (n, *np.shape(values)[-1:])) if np.ndim(values) == 1 and len(values) != n else values
                   for name, values in fields.items()}  # fmt: skip
        columns = {name: np.full(n, values) if np.ndim(values) == 0 else np.asarray(values, float) for name, values in columns.items()}
        good = np.ones(n, bool)
        for values in columns.values():
            good &= np.isfinite(values.reshape(n, -1)).all(axis=1)
        kept = rising(stamps_ns, good)
        for phrase, count in (("a value is not finite", n - good.sum()), ("time does not increase", good.sum() - kept.sum())):
            if count:
                self.account.refused[f"{topic}: {phrase}"] += int(count)
        if kept.any():
            self.series.append(Series(topic, stamps_ns[kept], {name: values[kept] for name, values in columns.items()}))
            self.account.origins[topic] = origin

    def add_attitude(self, stamps_ns: np.ndarray, origin: str, q_nb: np.ndarray, rate: np.ndarray | None, sigma: np.ndarray) -> None:
        """Add an attitude (n, 4) in the place of the attitude reference's, its rate by differences where None is given."""
        rate = attitude_rates(q_nb, stamps_ns) if rate is None else rate
        for topic in ("imu/data", "imu/data_fused"):
            self.add(topic, stamps_ns, origin, quaternion=q_nb, rate=rate, force=level_force(q_nb), sigma=sigma)

    def has(self, topic: str) -> bool:
        """Whether a topic was found."""
        return any(one.topic == topic for one in self.series)

    def shift(self, offset_ns: int) -> None:
        """Move all stamps."""
        self.series = [Series(one.topic, one.stamps_ns + offset_ns, one.fields) for one in self.series]


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file, unpacked where it is gzip; raises FormatError."""
    try:
        raw = path.read_bytes()
        return gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"{path} cannot be read to its end: {error}.") from error


def date_log(log: Log, device_ns: np.ndarray, utc_ns: np.ndarray) -> None:
    """Move a log from the device's clock to UTC, by pairs of both: the smallest difference, since what delays a time only adds to it.

    Half a second is allowed between them; pairs further from the median are those of a receiver that did not know the time yet.
    """
    if not len(device_ns):
        log.shift(NO_DATE_S * 10**9)
        log.time_base = "time since the start of the device; no date in the log, 2017-07-14 02:40:00 stands for its start"
        return
    offsets = utc_ns - device_ns
    median = int(np.median(offsets))
    near = offsets[np.abs(offsets - median) < 5 * 10**8]
    offset = int(near.max()) if len(near) else median
    if len(offsets) - len(near):
        log.account.remark(f"{len(offsets) - len(near)} times of the receiver are more than 0.5 s off the others and are not used.")
    log.shift(offset)
    log.time_base = "UTC of the GPS receiver, by the device's own clock"


def own_solution(stamp_ns: int, row: dict[str, Any]) -> NavSolution:
    """Return the recorder's own solution of a row of its columns; its sigmas are nominal, since no recorder states them all."""
    eye = np.eye(3)
    attitude = row.get("quaternion")
    return NavSolution(
        stamp_ns, AUTOPILOT, float(row["lat"]), float(row["lon"]), float(row["height"]), row["velocity"], attitude,
        cov_pos=9.0 * eye, cov_vel=0.25 * eye, cov_att=None if attitude is None else 1e-3 * eye,
    )  # fmt: skip


def stacked(columns: dict[str, np.ndarray], *names: str) -> np.ndarray:
    """Some columns as one, shape (n, len(names))."""
    return np.stack([columns[name].astype(float) for name in names], axis=1)


def level_force(q_nb: np.ndarray) -> np.ndarray:
    """Specific force of unaccelerated flight at attitudes (n, 4), m/s^2, shape (n, 3): stands in where a log has an attitude alone."""
    w, x, y, z = q_nb.T
    down_b = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z], axis=1)
    return -STANDARD_GRAVITY * down_b

def attitude_rates(q_nb: np.ndarray, stamps_ns: np.ndarray) -> np.ndarray:
    """Angular rates by differences of an attitude, rad/s, shape (n, 3)."""
    if len(q_nb) < 2:
        return np.zeros((len(q_nb), 3))
    w, v = q_nb[:-1, :1], q_nb[:-1, 1:]
    w2, v2 = q_nb[1:, :1], q_nb[1:, 1:]
    scalar = w * w2 + np.sum(v * v2, axis=1, keepdims=True)
    vector = w * v2 - w2 * v - np.cross(v, v2)
    rate = 2.0 * np.sign(scalar) * vector / np.maximum(np.diff(stamps_ns) * 1e-9, 1e-3)[:, None]
    return np.vstack([rate[:1], rate])


def heading_attitude(log: Log, stamps_ns: np.ndarray, heading: np.ndarray, speed: np.ndarray, origin: str) -> None:
    """Add the attitude of coordinated flight, twice a second: heading as recorded, the bank its change needs, no pitch.

    Parameters
    ----------
    log : Log
    stamps_ns : ndarray of int64, shape (n,)
    heading : ndarray, shape (n,)
        Rad from true north.
    speed : ndarray, shape (n,)
        True airspeed, m/s.
    origin : str
    """
    if len(stamps_ns) < 3:
        return
    even = np.arange(stamps_ns[0], stamps_ns[-1] + 1, ATTITUDE_STEP_NS)
    heading, speed = np.interp(even, stamps_ns, np.unwrap(heading)), np.interp(even, stamps_ns, np.nan_to_num(speed))
    bridged = np.searchsorted(stamps_ns, even, side="right").clip(1, len(stamps_ns) - 1)
    near = np.diff(stamps_ns)[bridged - 1] <= LONGEST_BRIDGE_NS  # over a longer hole nothing is known of the turn
    turn = np.clip(np.gradient(heading) / (1e-9 * ATTITUDE_STEP_NS), -0.6, 0.6)
    stamps_ns, heading, speed, turn = even[near], heading[near], speed[near], turn[near]
    bank = np.arctan(np.nan_to_num(speed) * turn / STANDARD_GRAVITY)
    half, roll = 0.5 * heading, 0.5 * bank
    (ch, sh), (cr, sr) = ((np.cos(angle), np.sin(angle)) for angle in (half, roll))
    q_nb = np.stack([ch * cr, ch * sr, sh * sr, sh * cr], axis=1)
    rate = np.stack([np.zeros(len(turn)), turn * np.sin(bank), turn * np.cos(bank)], axis=1)
    log.add_attitude(stamps_ns, origin, q_nb, rate, np.radians([8.0, 8.0, 8.0]))
