"""A driver: bytes of a port through a parser onto the standard topics, at times of this computer's clock."""

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from lowcostnav_ros.base.measurements import Attitude, Measurement
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.formats.clock_fit import ClockFit
from lowcostnav_ros.formats.parser import ARRIVAL, Parser, shifted
from lowcostnav_ros.formats.records import CheckedRecords
from lowcostnav_ros.ros.input_monitor import ERROR, OK, WARN, Status
from lowcostnav_ros.ros.port import BAUDS, Port, open_port, parse_source
from lowcostnav_ros.ros.port_node import PortNode
from lowcostnav_ros.ros.publishing import Output

READ_S = 0.2
TRY_S = 2.0
"""How long a baud rate is listened to before the next is tried."""


@dataclass(frozen=True)
class ClockSettings:
    """Where the time of a message comes from."""

    source: str = setting(
        "computer",
        "computer: the device's times mapped onto this computer's clock, by a fit to the times of arrival; device: the device's own UTC.",
        choices=("computer", "device"),
    )
    latency_s: float = setting(0.0, "Shortest delay from the measurement to its arrival, taken off.", unit="s", minimum=0.0, maximum=2.0)


def source_setting(usual: str) -> Any:
    """Declare where a driver's bytes come from; a subclass of :class:`PortSettings` may have another default."""
    return setting(usual, "Serial port (best by /dev/serial/by-id/...), file:PATH, tcp:HOST:PORT or udp:PORT.")


@dataclass(frozen=True)
class PortSettings:
    """A port and the time of what comes from it."""

    source: str = source_setting("/dev/ttyUSB0")
    baud: int = setting(0, "Serial rate; 0 finds it.", minimum=0, maximum=4_000_000)
    silent_after_s: float = setting(3.0, "A port without a byte for longer is reported.", unit="s", minimum=0.5, maximum=600.0)
    file_pace: float = setting(1.0, "A file is read at this multiple of its own time; 0: at once.", minimum=0.0, maximum=1000.0)
    instance: int = setting(1, "Number of this device among its kind: 2 publishes gps2/fix in place of gps/fix.", minimum=1, maximum=9)
    clock: ClockSettings = group(ClockSettings)

    def __post_init__(self) -> None:
        parse_source(self.source)


class DriverNode(PortNode):
    """Base of the drivers; a subclass gives :meth:`make_parser` and, in ``@executable``, its name and settings."""

    name: ClassVar[str]
    Settings: ClassVar[type[PortSettings]] = PortSettings

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(self.name, [self.Settings()], **kwargs)
        self.settings: Any = self.parameters.settings[0]
        self.parser = self.make_parser()
        self._is_file = self.settings.source.startswith("file:")
        if self._is_file and self.parser.clock == ARRIVAL:
            self.destroy_node()
            raise SettingsError(f"{self.name}: its protocol carries no time, so a file cannot be timed; give a port or a socket.")
        self._checked, self._fit = CheckedRecords(), ClockFit()
        self._bytes, self._turn, self._bauds = 0, 0, [self.settings.baud] if self.settings.baud else list(BAUDS)
        self._baud = self._bauds[0]
        self._began: tuple[int, float] | None = None
        self._begin("port")

    def make_parser(self) -> Parser:
        """Return the parser of the protocol."""
        raise NotImplementedError

    def published(self, measurement: Measurement) -> Iterable[Measurement]:
        """Return what is published of a measurement; its own attitude only where ``attitude`` asks for it, as imu/data too."""
        if not isinstance(measurement, Attitude) or not hasattr(self.settings, "attitude"):
            yield measurement
        elif self.settings.attitude:
            yield from (measurement, replace(measurement, source="imu/data"))

    def rows(self) -> Iterable[Status]:
        """Add the state of the port and of the protocol to the rows of every node."""
        yield from super().rows()
        framer, account = self.parser.framer, self.parser.account
        level = ERROR if self._trouble else WARN if not sum(framer.frames.values()) else OK
        values = {"source": self.settings.source, "baud": str(self._baud), "bytes": str(self._bytes), "opened": str(self._opened)}
        values |= {"frames": counted(framer.frames), "broken": counted(framer.broken), "skipped_bytes": str(framer.skipped)}
        values |= {"refused": counted({**account.refused, **self._checked.refused()}), "remarks": " ".join(account.remarks[-3:])}
        values |= {"drift_ppm": f"{self._fit.drift_ppm:.1f}", "clock_steps": str(self._fit.steps)}
        yield Status(f"{self.get_name()}: port", level, self._trouble or self._state, values)

    def _open(self) -> Port:
        self._baud = self._bauds[self._turn % len(self._bauds)]
        return open_port(self.settings.source, self._baud)

    def _use(self, port: Port) -> None:
        if self.parser.greeting:
            port.write(self.parser.greeting)
        self._turn += not self._listen(port, len(self._bauds) > 1 and self.settings.source.startswith(("/", "serial:")))

    def _listen(self, port: Port, is_searching: bool) -> bool:
        """Read until the port is gone; return False where no frame came at this rate."""
        opened_s = last_byte_s = time.monotonic()
        before = sum(self.parser.framer.frames.values())
        while self.running():
            data = port.read(READ_S)
            received_ns = self.get_clock().now().nanoseconds
            if data is None:
                self._publish(self.parser.close(), received_ns)
                self._say("", "the whole file was read")
                while self.running():
                    self._stopping.wait(READ_S)
                return True
            now = time.monotonic()
            last_byte_s = now if data else last_byte_s
            self._bytes += len(data)
            self.parser.arrived_ns = 0 if self._is_file else received_ns
            self._publish(self.parser.feed(data), received_ns)
            found = sum(self.parser.framer.frames.values()) > before
            if is_searching and not found and now - opened_s > TRY_S:
                self._say(f"{self.settings.source} gives {'no known message' if self._bytes else 'no bytes'} at {self._baud} baud")
                return False
            if now - last_byte_s > self.settings.silent_after_s:
                self._say(f"{self.settings.source} is open, but no bytes have come for {now - last_byte_s:.0f} s; check the wiring")
            elif found:
                self._say("", f"{self.settings.source} open{f' at {self._baud} baud' if self._baud else ''}, messages come")
            elif self._bytes and now - opened_s > TRY_S:
                rate = f" at {self._baud} baud (0 finds the rate)" if self.settings.baud else ""
                self._say(f"{self.settings.source} gives no known message{rate}; check what the device sends")
        return True

    def _publish(self, measurements: Iterable[Measurement], received_ns: int) -> None:
        """Publish what came at once: the later this process is, the less each message costs; those of a file wait for their time."""
        timed = (self._timed(measurement, received_ns) for measurement in measurements)
        due = (one for moved in timed if moved is not None for one in self.published(moved))
        for together in ((one,) for one in due) if self._is_file else (tuple(due),):
            for _, topic, _, cdr in self._checked.of(*together) if together else ():
                self._output(topic).send(cdr)

    def _timed(self, measurement: Measurement, received_ns: int) -> Measurement | None:
        """Return the measurement at its time by the clock that is asked for, None where that is not known yet."""
        if self._is_file:
            received_ns = self._paced(measurement.stamp_ns)
        offset_ns: int | None = 0
        if self.parser.clock == ARRIVAL:
            pass
        elif self.settings.clock.source == "device":
            offset_ns = self.parser.utc_offset_ns
            if offset_ns is None:
                self.parser.account.refused["message before the device knows UTC"] += 1
                return None
        else:
            offset_ns = self._fit.map(measurement.stamp_ns, received_ns) - measurement.stamp_ns
        offset_ns -= round(1e9 * self.settings.clock.latency_s)
        return shifted(measurement, offset_ns) if offset_ns else measurement

    def _paced(self, stamp_ns: int) -> int:
        """Wait until a measurement of a file is due; return the time at which it would have come."""
        pace = self.settings.file_pace
        now_ns = self.get_clock().now().nanoseconds
        if self._began is None or stamp_ns < self._began[0]:
            self._began = stamp_ns, now_ns
        due_ns = self._began[1] + (stamp_ns - self._began[0]) / (pace or 1.0)
        if pace:
            self._stopping.wait(max(due_ns - now_ns, 0.0) * 1e-9)
        return round(self._began[1] + (stamp_ns - self._began[0]))

    def _output(self, topic: str) -> Output:
        first, slash, rest = topic.partition("/")
        return self.output(f"{first}{self.settings.instance}{slash}{rest}" if self.settings.instance > 1 else topic)
