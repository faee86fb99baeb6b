"""When a source publishes: after all expected subscribers are there, and no faster than its pace."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.node import Node

from lowcostnav_ros.base.settings import SettingsError, setting

SLACK_S = 0.001  # sleeping for less costs more than it orders


@dataclass(frozen=True)
class StartSettings:
    """What to wait for before the first message."""

    expected_subscribers: list[str] = setting([], "Listeners to wait for, as 'topic:count' (truth/imu:1); empty does not wait.")
    settle_s: float = setting(0.5, "Further wait until all connections are made.", unit="s", minimum=0.0, maximum=60.0)
    timeout_s: float = setting(30.0, "Longest wait; then it starts with a warning.", unit="s", minimum=0.0, maximum=3600.0)

    def __post_init__(self) -> None:
        parse_expected(self.expected_subscribers)


def parse_expected(entries: list[str]) -> dict[str, int]:
    """Turn ``['truth/imu:1']`` into ``{'truth/imu': 1}``; raises SettingsError naming the entry that is no 'topic:count'."""
    expected = {}
    for entry in entries:
        topic, _, count = entry.rpartition(":")
        if not topic or not count.isdigit():
            raise SettingsError(f"start.expected_subscribers: '{entry}' must read 'topic:count', for example 'truth/imu:1'.")
        expected[topic] = int(count)
    return expected


def missing_subscribers(node: Node, expected: dict[str, int]) -> list[str]:
    """Return what is still missing, as ``truth/imu (0 of 1)``."""
    counts = {topic: node.count_subscribers(topic) for topic in expected}
    return [f"{topic} ({counts[topic]} of {wanted})" for topic, wanted in expected.items() if counts[topic] < wanted]


def wait_for_subscribers(node: Node, settings: StartSettings, running: Callable[[], bool], report: Callable[[str], None]) -> None:
    """Block until the expected listeners are there and have settled, or the time is up, or ``running`` turns false."""
    expected = parse_expected(settings.expected_subscribers)
    deadline = time.monotonic() + settings.timeout_s
    missing = missing_subscribers(node, expected)
    while missing and running() and time.monotonic() < deadline:
        report(f"waiting for listeners: {', '.join(missing)}")
        time.sleep(0.05)
        missing = missing_subscribers(node, expected)
    if missing and running():
        node.get_logger().warning(f"Starting without {', '.join(missing)}: not there within {settings.timeout_s:g} s.")
    settled = time.monotonic() + settings.settle_s
    while running() and time.monotonic() < settled:
        time.sleep(0.02)


class Pacer:
    """Hold simulated time to wall time times a factor.

    When the source has been held up (a slow listener, lossless), the lost time is not caught up in a burst: time resumes from there.

    Parameters
    ----------
    factor : float
        Simulated seconds per second; 0 runs as fast as the listeners allow.
    """

    LONGEST_LAG_S = 0.5

    def __init__(self, factor: float) -> None:
        self.factor = factor
        self._origin: tuple[int, float] | None = None
        self.late_s = 0.0

    def wait(self, stamp_ns: int) -> None:
        """Sleep until ``stamp_ns`` is due."""
        now = time.monotonic()
        if self.factor <= 0.0:
            return
        if self._origin is None:
            self._origin = (stamp_ns, now)
        due = self._origin[1] + (stamp_ns - self._origin[0]) * 1e-9 / self.factor
        if due - now > SLACK_S:
            time.sleep(due - now)
        elif now - due > self.LONGEST_LAG_S:
            self.late_s += now - due
            self._origin = (stamp_ns, now)
