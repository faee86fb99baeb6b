"""An output: what a navigator says, in a protocol that instruments and tablets read, to a port."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from diagnostic_msgs.msg import DiagnosticArray

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.formats.cockpit import Cockpit, CockpitLimits, Picture
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import ERROR, OK, WARN, Status
from lowcostnav_ros.ros.port import Port, open_destination, parse_destination
from lowcostnav_ros.ros.port_node import PortNode


class Encoder(Protocol):
    """Turns pictures into the messages of a protocol."""

    def frames(self, picture: Picture, is_second: bool) -> list[bytes]:
        """Return the messages, each to be sent on its own; ``is_second`` where those are due that are sent once a second."""


def destination_setting(usual: str) -> Any:
    """Declare where an output goes; a subclass of :class:`OutputSettings` may have another default."""
    return setting(usual, "udp:HOST:PORT, tcp:HOST:PORT, a serial port, or file:PATH that is appended to.")


@dataclass(frozen=True)
class OutputSettings:
    """What is shown, and where it goes."""

    destination: str = destination_setting("udp:127.0.0.1:4000")
    baud: int = setting(38_400, "Rate of a serial port.", minimum=1200, maximum=4_000_000)
    navigator: str = setting("nav", "Whose solution: the supervisor's (nav), or the name of a navigator.")
    rate_hz: float = setting(5.0, "How often it is sent.", unit="Hz", minimum=0.2, maximum=50.0)
    limits: CockpitLimits = group(CockpitLimits)

    def __post_init__(self) -> None:
        parse_destination(self.destination)
        if not self.navigator.replace("_", "").isalnum():
            raise SettingsError(f"navigator: '{self.navigator}' must be the name of a navigator, such as ins_gps.")


class OutputNode(PortNode):
    """Base of the outputs; a subclass gives :meth:`make_encoder` and, in ``@executable``, its name and settings."""

    name: ClassVar[str]
    Settings: ClassVar[type[OutputSettings]] = OutputSettings
    further: ClassVar[tuple[str, ...]] = ()
    """What it shows beside the navigator's solution; with these, the protection level."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(self.name, [self.Settings()], **kwargs)
        self.settings: Any = self.parameters.settings[0]
        self.encoder = self.make_encoder()
        self.cockpit = Cockpit(self.settings.limits)
        self._sent, self._shown = 0, self.cockpit.picture(time.monotonic())
        room = self.settings.navigator
        for source in (f"{room}/odometry", f"{room}/health", *self.further):
            self.listen(source, self._take, required=source not in self.further)
        if self.further:
            self.create_subscription(DiagnosticArray, "/diagnostics", self._protection, qos.sensor_subscription())
        self._begin("output")

    def make_encoder(self) -> Encoder:
        """Return the encoder of the protocol."""
        raise NotImplementedError

    def rows(self) -> Iterable[Status]:
        """Add what is shown and where it goes to the rows of every node."""
        yield from super().rows()
        if not hasattr(self, "_shown"):
            return
        shown = self._shown
        values = {"destination": self.settings.destination, "sent": str(self._sent), "opened": str(self._opened)}
        given = {"position": shown.lat, "height": shown.height, "velocity": shown.vel_n, "attitude": shown.roll, "heading": shown.heading}
        values |= {name: "no" if value is None else "yes" for name, value in given.items()}
        if shown.radius_95_m is not None:
            values["radius_95_m"] = f"{shown.radius_95_m:.1f}"
        words = "dead reckoning shown" if shown.is_degraded else "position shown"
        if shown.lat is None:
            words = f"position not shown: {shown.reason}"
        level = ERROR if self._trouble else WARN if shown.lat is None or shown.is_degraded else OK
        yield Status(f"{self.get_name()}: output", level, self._trouble or words, values)

    def _take(self, measurement: Measurement) -> None:
        self.cockpit.take(measurement, time.monotonic())

    def _protection(self, message: DiagnosticArray) -> None:
        """Take the protection levels from the row of the navigator's satellite tests."""
        for status in message.status:
            if status.name == f"{self.settings.navigator}: integrity":
                values = {entry.key: entry.value for entry in status.values}
                is_sound = values.get("verdict") in ("healthy", "excluded") and not values.get("alarm")
                hpl_m, vpl_m = (_number(values.get(name)) if is_sound else None for name in ("hpl_m", "vpl_m"))
                self.cockpit.protect(hpl_m, vpl_m, time.monotonic())

    def _open(self) -> Port:
        return open_destination(self.settings.destination, self.settings.baud)

    def _use(self, port: Port) -> None:
        period_s, due_s, second = 1.0 / self.settings.rate_hz, time.monotonic(), -1
        while self.running():
            now_s = time.monotonic()
            self._shown = self.cockpit.picture(now_s)
            for frame in self.encoder.frames(self._shown, int(now_s) != second):
                port.write(frame)
                self._sent += 1
            second = int(now_s)
            self._say("", f"{self.settings.destination} takes what is sent")
            due_s = max(due_s + period_s, now_s)
            self._stopping.wait(due_s - time.monotonic())


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if value >= 0.0 else None
