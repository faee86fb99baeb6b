"""Crossbow DMU and AHRS400 packets: rates, specific force, magnetic field, and the unit's own attitude.

A packet is the byte FF, 16-bit words, big endian, and the sum of the words' bytes; which packet a unit sends is a matter of its mode, and
nothing in it says which, nor with what ranges it was made: both are settings.  Eight bits of sum let one false packet in 256 through, so
a packet counts only where two have come before it without a byte between.  The accelerometers read +1 g on the axis that points down: minus
the specific force.  Time is a 16-bit counter that falls by one each 0.79 us and comes round after 52 ms; units send faster than that.

References
----------
Crossbow, AHRS400 Series User's Manual, sections on data packet format and scaling; DMU User's Manual.
Njenga (2008), Implementation of a low cost MEMS inertial navigation solution, Embry-Riddle: Table 3 (sign of the accelerometers).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.units import DEGREE, GAUSS, STANDARD_GRAVITY
from lowcostnav_ros.formats.framing import MORE, Framer, Protocol
from lowcostnav_ros.formats.parser import BOOT, Parser
from lowcostnav_ros.physics.rotation import euler_to_quat

HEADER = b"\xff"
TICK_NS, TURN = 790, 1 << 16
"""Length of a count of the timer, ns, and counts after which it comes round."""
TURN_NS, STAYS = TURN * TICK_NS, 20
"""Time of a turn, and packets that must be late by one before it is counted."""
WORD = 2**15
MARGIN = 1.5
"""A full word is one and a half times the range."""
MAGNETIC_RANGE_GAUSS = 1.25
SIGMA_T, TILT_SIGMA, HEADING_SIGMA = 0.5e-6, 2.0 * DEGREE, 4.0 * DEGREE
LOOK = 500
"""Packets over which gravity must show."""
CONFIRMED = 2
"""Packets in a row before the one that is used."""
LAYOUTS = {
    "angle": ("roll", "pitch", "heading", "p", "q", "r", "x", "y", "z", "mx", "my", "mz", "temperature", "time"),
    "scaled": ("p", "q", "r", "x", "y", "z", "mx", "my", "mz", "temperature", "time"),
    "vertical_gyro": ("roll", "pitch", "p", "q", "r", "x", "y", "z", "temperature", "time"),
    "six_axis": ("p", "q", "r", "x", "y", "z", "temperature", "time"),
}
"""Words of a packet by mode: AHRS400 in angle and in scaled mode, VG in angle mode, DMU-6X in scaled mode."""
COMMANDS = {"angle": b"aC", "scaled": b"cC", "vertical_gyro": b"aC", "six_axis": b"cC"}
"""What puts a unit into the mode, then makes it send continuously."""


@dataclass(frozen=True)
class CrossbowUnit:
    """What a unit's data sheet says: its mode, and the ranges on its label, deg/s and g."""

    packet: str = "angle"
    rate_range_dps: float = 100.0
    accel_range_g: float = 2.0


class CrossbowParser(Parser):
    """Packets of one unit; true north where ``declination``, rad, is that of the place."""

    clock: ClassVar[str] = BOOT

    def __init__(self, unit: CrossbowUnit, declination: float = 0.0, is_started: bool = True) -> None:
        words = LAYOUTS[unit.packet]
        size = len(HEADER) + 2 * len(words) + 1
        super().__init__()
        length = lambda buffer, start: size if len(buffer) - start >= size else MORE  # noqa: E731
        self.framer: Framer = Framer((Protocol("Crossbow", HEADER, length, _is_sound),))
        self.greeting = COMMANDS[unit.packet] if is_started else b""
        self._unit, self._words, self._declination = unit, words, declination
        self._row, self._skipped = 0, 0
        self._timer: int | None = None
        self._least_ns: int | None = None
        self._now_ns, self._behind, self._looked, self._sum = TURN_NS, 0, 0, 0.0

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Turn a packet into measurements, once the two before it were packets too."""
        is_next = self.framer.skipped == self._skipped
        self._row, self._skipped = (self._row + 1 if is_next else 1), self.framer.skipped
        counts = dict(zip(self._words, np.frombuffer(frame, ">i2", len(self._words), 1).tolist(), strict=True))
        stamp_ns = self._stamp_ns(counts["time"] & 0xFFFF)
        if self._row <= CONFIRMED:
            self.account.refused["Crossbow packet that has none before it to confirm it"] += 1
        elif self.is_new("imu/data_raw", stamp_ns):
            yield from self._measured(counts, stamp_ns)

    def _stamp_ns(self, timer: int) -> int:
        """Time since before the first packet: the counts since the last one; where arrivals stay a turn later, packets were lost for it."""
        counts = 0 if self._timer is None else (self._timer - timer) % TURN
        self._timer = timer
        self._now_ns += counts * TICK_NS
        if self.arrived_ns:
            late_ns = self.arrived_ns - self._now_ns
            leak = counts * TICK_NS // 1000  # no two clocks drift apart by more than a thousandth
            self._least_ns = late_ns if self._least_ns is None else min(late_ns, self._least_ns + leak)
            turns = round((late_ns - self._least_ns) / TURN_NS)
            self._behind = self._behind + 1 if turns else 0
            if self._behind >= STAYS:  # a packet that was held up does not stay late
                self._now_ns, self._behind = self._now_ns + turns * TURN_NS, 0
        return self._now_ns

    def _look(self, force: float) -> None:
        """Say once where the first packets do not show gravity: then the range is that of another unit."""
        self._looked, self._sum = self._looked + 1, self._sum + force
        mean_g = self._sum / self._looked / STANDARD_GRAVITY
        if self._looked == LOOK and not abs(mean_g - 1.0) < 0.2:
            self.account.remark(f"The accelerometers show {mean_g:.2f} g: is {self._unit.accel_range_g:g} g the range on the label?")

    def _measured(self, counts: dict[str, int], stamp_ns: int) -> Iterator[Measurement]:
        unit = self._unit
        rate = np.array([counts[axis] for axis in "pqr"]) * (MARGIN * unit.rate_range_dps * DEGREE / WORD)
        force = np.array([counts[axis] for axis in "xyz"]) * (-MARGIN * unit.accel_range_g * STANDARD_GRAVITY / WORD)
        label = f"Crossbow counts at {unit.rate_range_dps:g} deg/s and {unit.accel_range_g:g} g, +1 g down"
        self.account.origins.setdefault("imu/data_raw", label)
        self._look(float(np.linalg.norm(force)))
        yield ImuBlock.of("imu/data_raw", np.array([stamp_ns]), force[np.newaxis], rate[np.newaxis])
        if "mx" in counts:
            field = np.array([counts[f"m{axis}"] for axis in "xyz"]) * (MARGIN * MAGNETIC_RANGE_GAUSS * GAUSS / WORD)
            yield MagneticField(stamp_ns, "imu/mag", field, SIGMA_T**2 * np.eye(3))
        if "heading" in counts:
            roll, pitch, heading = (counts[angle] * math.pi / WORD for angle in ("roll", "pitch", "heading"))
            if abs(pitch) > 0.5 * math.pi:
                self.account.refused["pitch beyond 90 degrees"] += 1
                return
            q_nb = euler_to_quat(roll, pitch, heading + self._declination)
            cov = np.diag([TILT_SIGMA**2, TILT_SIGMA**2, HEADING_SIGMA**2])
            yield Attitude(stamp_ns, "imu/data_fused", q_nb, cov, rate, force)


def _is_sound(frame: bytes) -> bool:
    return sum(frame[1:-1]) & 0xFF == frame[-1]
