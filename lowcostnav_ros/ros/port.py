"""Where a driver's bytes come from and an output's go to: a serial port, a file, TCP or UDP; what goes wrong is one sentence that says what
to do.
"""

import contextlib
import errno
import grp
import os
import select
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from lowcostnav_ros.base.settings import SettingsError

BAUDS = (115_200, 9_600, 38_400, 57_600, 230_400, 460_800, 921_600)
"""Rates that are tried where none is configured, the commonest first."""
CHUNK = 4096
WRITE_S = 0.5
"""How long the other side may take to take what is sent."""


class PortError(Exception):
    """Why a port gives no bytes; the message is one sentence."""


class Port(Protocol):
    """An open source of bytes."""

    def read(self, timeout_s: float) -> bytes | None:
        """Return what has come, empty after the time, None at the end of a file; raises PortError when the source is gone."""

    def write(self, data: bytes) -> None:
        """Send bytes to the other side; raises PortError where it does not take them."""

    def close(self) -> None:
        """Close it."""


def parse_source(text: str) -> tuple[str, str]:
    """Return (kind, place) of ``/dev/ttyUSB0``, ``file:PATH``, ``tcp:HOST:PORT`` or ``udp:PORT``; raises SettingsError."""
    kind, colon, place = text.partition(":")
    if text.startswith("/"):
        return "serial", text
    if kind == "file" and place:
        return kind, place
    if (kind == "udp" and place.isdigit()) or (kind == "tcp" and place.rpartition(":")[2].isdigit() and place.rpartition(":")[0]):
        return kind, place
    if kind == "serial" and place:
        return kind, place
    raise SettingsError(f"source: '{text}' must be a serial port such as /dev/ttyUSB0, file:PATH, tcp:HOST:PORT or udp:PORT.")


def parse_destination(text: str) -> tuple[str, str]:
    """Return (kind, place) of where an output goes, as :func:`parse_source`, but ``udp:HOST:PORT``; raises SettingsError."""
    kind, _, place = text.partition(":")
    if kind == "udp" and ":" not in place:
        raise SettingsError(f"destination: '{text}' needs a host, udp:HOST:PORT; udp:127.0.0.1:4000 is this computer.")
    try:
        return parse_source(text.replace("udp:", "tcp:", 1)) if kind != "udp" else ("udp", parse_source(f"tcp:{place}")[1])
    except SettingsError:
        known = "a serial port such as /dev/ttyUSB0, file:PATH, tcp:HOST:PORT or udp:HOST:PORT"
        raise SettingsError(f"destination: '{text}' must be {known}.") from None


def open_destination(destination: str, baud: int) -> Port:
    """Open what an output writes to; raises PortError."""
    kind, place = parse_destination(destination)
    if kind == "serial":
        return SerialPort(place, baud)
    if kind == "file":
        return FilePort(place, "ab")
    return SocketPort(place, socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM, is_sender=True)


def open_port(source: str, baud: int) -> Port:
    """Open a source; raises PortError."""
    kind, place = parse_source(source)
    opener: dict[str, Callable[[], Port]] = {
        "serial": lambda: SerialPort(place, baud),
        "file": lambda: FilePort(place),
        "tcp": lambda: SocketPort(place, socket.SOCK_STREAM),
        "udp": lambda: SocketPort(f"0.0.0.0:{place}", socket.SOCK_DGRAM),
    }
    return opener[kind]()


class SerialPort:
    """A serial port, held alone."""

    def __init__(self, path: str, baud: int) -> None:
        self._path = path
        try:
            import serial
        except ImportError:
            raise PortError("A serial port needs pyserial; install it with the extra 'drivers' of this package.") from None
        try:
            self._serial = serial.Serial(path, baud, timeout=0, write_timeout=WRITE_S, exclusive=True)
        except (OSError, ValueError) as error:
            raise PortError(_why(path, error)) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has come."""
        try:
            if not select.select([self._serial.fileno()], [], [], timeout_s)[0]:
                if not os.path.exists(self._path):
                    raise PortError(f"{self._path} is gone; plug it in again.")
                return b""
            data = os.read(self._serial.fileno(), CHUNK)
        except (OSError, ValueError, TypeError) as error:
            raise PortError(f"{self._path} is gone ({error}); plug it in again.") from error
        if not data:
            raise PortError(f"{self._path} is gone; plug it in again.")
        return data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._serial.write(data)
        except OSError as error:  # a SerialTimeoutException is one
            raise PortError(f"{self._path} does not take what is sent ({error}); check the wiring and the baud rate.") from error

    def close(self) -> None:
        """Close it."""
        with contextlib.suppress(OSError):  # unplugged
            self._serial.close()


def _why(path: str, error: BaseException) -> str:
    """Why a serial port cannot be opened."""
    known = (errno.ENOENT, errno.EACCES, errno.EBUSY)
    number = getattr(error, "errno", None) or next((n for n in known if f"[Errno {n}]" in str(error)), None)
    if number == errno.ENOENT:
        near = sorted(str(p) for p in Path("/dev").glob("tty[AU][CS][MB]*"))
        return f"{path} does not exist; plug the device in" + (f", or use one of {', '.join(near)}." if near else ".")
    if number == errno.EACCES:
        try:
            group = grp.getgrgid(os.stat(path).st_gid).gr_name
        except (OSError, KeyError):
            group = "dialout"
        return f"{path} may not be opened: permission denied; join its group with 'sudo usermod -aG {group} $USER' and log in again."
    if number in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error).lower():
        return f"{path} is in use by another program; end it, or give this driver another port."
    return f"{path} cannot be opened: {error}."


class FilePort:
    """A capture on disk, or a file that an output appends to."""

    def __init__(self, path: str, mode: str = "rb") -> None:
        self._path = path
        try:
            self._file = Path(path).open(mode)  # noqa: SIM115 - closed by the driver
        except OSError as error:
            raise PortError(f"{path} cannot be opened: {error.strerror}; check the path.") from error

    def read(self, timeout_s: float) -> bytes | None:
        """Return the next bytes."""
        return self._file.read(CHUNK) or None

    def write(self, data: bytes) -> None:
        """Append bytes; what is asked of a capture goes nowhere."""
        if not self._file.writable():
            return
        try:
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            raise PortError(f"{self._path} cannot be written: {error.strerror}; make room or choose another place.") from error

    def close(self) -> None:
        """Close it."""
        self._file.close()


class SocketPort:
    """A TCP server to connect to, a UDP port to listen on or, of a sender, to send to."""

    def __init__(self, place: str, kind: socket.SocketKind, is_sender: bool = False) -> None:
        host, _, port = place.rpartition(":")
        self._place = f"{'tcp' if kind == socket.SOCK_STREAM else 'udp'}:{place}"
        self._socket = socket.socket(socket.AF_INET, kind)
        try:
            if is_sender or kind == socket.SOCK_STREAM:
                self._socket.settimeout(2.0)
                self._socket.connect((host, int(port)))
                self._socket.settimeout(WRITE_S)
            else:
                self._socket.bind((host, int(port)))
        except (OSError, OverflowError) as error:
            self._socket.close()
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortError(f"{self._place} is in use by another program; end it, or choose another port.") from error
            raise PortError(f"{self._place} cannot be opened: {error}; check host and port.") from error
        self._is_stream = kind == socket.SOCK_STREAM

    def read(self, timeout_s: float) -> bytes:
        """Return what has come."""
        try:
            if not select.select([self._socket], [], [], timeout_s)[0]:
                return b""
            data = self._socket.recv(65_536)
        except OSError as error:
            raise PortError(f"{self._place} is gone: {error}.") from error
        if not data and self._is_stream:
            raise PortError(f"{self._place} was closed by the other side.")
        return data

    def write(self, data: bytes) -> None:
        """Send bytes; a datagram that nobody takes is lost, as datagrams are."""
        try:
            self._socket.sendall(data)
        except ConnectionRefusedError:
            if self._is_stream:
                raise PortError(f"{self._place} is gone.") from None
        except OSError as error:
            raise PortError(f"{self._place} does not take what is sent: {error}.") from error

    def close(self) -> None:
        """Close it."""
        self._socket.close()
