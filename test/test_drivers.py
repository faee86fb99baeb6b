"""Drivers over Fast DDS: a capture through a pseudo-terminal comes out on the topics; what goes wrong at a port is said."""

import os
import tty

import pytest
from fuzz_formats import again_sound, mavlink_frames, nmea_frames, ubx_frames

pytest.importorskip("rclpy")
pytest.importorskip("serial")

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.messages.decode import Decoder
from lowcostnav_ros.messages.topics import spec
from lowcostnav_ros.nodes.mavlink_driver import MavlinkDriver
from lowcostnav_ros.nodes.nmea_driver import NmeaDriver
from lowcostnav_ros.nodes.ublox_driver import UbloxDriver
from lowcostnav_ros.ros.port import PortError, _why, open_port, parse_source
from lowcostnav_ros.ros.publishing import message_class


class Terminal:
    """A pseudo-terminal under a name of its own, as udev gives a device."""

    def __init__(self, path):
        self.path = path
        self.plug()

    def plug(self):
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.slave = slave
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))

    def unplug(self):
        os.close(self.master)
        os.close(self.slave)
        self.path.unlink()

    def write(self, data):
        os.write(self.master, data)


@pytest.fixture
def terminal(tmp_path):
    one = Terminal(tmp_path / "device")
    yield one
    one.unplug()


def heard_on(ros, *topics):
    """Measurements by topic, as a navigator would decode them."""
    out, decoder = {name: [] for name in topics}, Decoder()
    for name in topics:
        kind = spec(name)
        take = lambda raw, name=name, kind=kind: out[name].append(decoder.decode(name, kind.msgtype, raw))  # noqa: E731
        ros.probe.create_subscription(message_class(kind.msgtype), name, take, 50, raw=True)
    return out


def state(node):
    return next(row for row in node.rows() if row.name.endswith(": port"))


@pytest.mark.parametrize(
    ("make", "frames", "topics"),
    [
        (NmeaDriver, nmea_frames(), ("gps/fix", "gps/vel", "air/static_pressure")),
        (UbloxDriver, ubx_frames(), ("gps/fix", "gps/vel")),
        (MavlinkDriver, mavlink_frames(), ("imu/data_raw", "imu/mag", "air/static_pressure", "air/velocity", "gps/fix")),
    ],
)
def test_a_capture_through_a_terminal_comes_out_on_the_topics(ros, terminal, make, frames, topics):
    heard = heard_on(ros, *topics)
    node = ros.make(make, source=str(terminal.path), baud=115_200)
    assert ros.spin_until(lambda: node._opened == 1)
    ros.spin_until(lambda: all(ros.probe.count_publishers(name) for name in topics), 0.2)
    now_ns = node.get_clock().now().nanoseconds
    assert ros.spin_until(lambda: terminal.write(b"\x00noise\xb5" + b"".join(frames)) or ros.spin_once() or all(heard.values()), 20.0)
    assert ros.spin_until(lambda: state(node).level == 0 and "messages come" in state(node).message)
    assert int(state(node).values["skipped_bytes"]) > 0
    assert abs(heard[topics[0]][-1].stamp_ns - now_ns) < 20 * 10**9  # of this computer's clock, whatever the capture says


def test_a_device_that_is_unplugged_is_said_and_taken_up_again(ros, terminal):
    heard = heard_on(ros, "gps/fix")
    node = ros.make(NmeaDriver, source=str(terminal.path), baud=9600, instance=1)
    assert ros.spin_until(lambda: terminal.write(b"".join(nmea_frames())) or ros.spin_once() or heard["gps/fix"], 20.0)
    terminal.unplug()
    assert ros.spin_until(lambda: state(node).level == 2 and ("gone" in state(node).message or "exist" in state(node).message))
    before = len(heard["gps/fix"])
    terminal.plug()
    later = [frame.replace(b"12000", b"12010") for frame in nmea_frames()]
    later = b"".join(map(again_sound, later))
    assert ros.spin_until(lambda: terminal.write(later) or ros.spin_once() or len(heard["gps/fix"]) > before, 20.0)
    assert ros.spin_until(lambda: state(node).level == 0) and int(state(node).values["opened"]) == 2


def test_a_file_and_a_second_receiver(ros, tmp_path):
    (tmp_path / "capture.ubx").write_bytes(b"".join(ubx_frames()))
    heard = heard_on(ros, "gps2/fix")
    node = ros.make(UbloxDriver, source=f"file:{tmp_path / 'capture.ubx'}", file_pace=0.0, clock__source="device", instance=2)
    assert ros.spin_until(lambda: state(node).message == "the whole file was read")
    assert "gps2/fix" in node.outputs and node.outputs["gps2/fix"].count == 2 and heard is not None


def test_a_port_that_cannot_be_opened_says_what_to_do(tmp_path):
    with pytest.raises(PortError, match="does not exist; plug the device in"):
        open_port(str(tmp_path / "none"), 9600)
    denied = _why(str(tmp_path), PermissionError(13, "Permission denied"))
    assert "sudo usermod -aG " in denied and "log in again" in denied
    assert "in use by another program" in _why("/dev/x", OSError(16, "Device or resource busy"))
    with pytest.raises(PortError, match="cannot be opened"):
        open_port("tcp:127.0.0.1:1", 0)
    for wrong in ("ttyUSB0", "tcp:host", "udp:x", "file:", "http://a"):
        with pytest.raises(SettingsError, match="must be a serial port"):
            parse_source(wrong)


def test_a_port_that_is_taken(terminal):
    first = open_port(str(terminal.path), 9600)
    with pytest.raises(PortError, match="in use by another program"):
        open_port(str(terminal.path), 9600)
    first.close()
