"""Record topics into a bag, in order of arrival."""

import shutil
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import Any

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.graph.wiring import recorded_topics
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, BagError, BagWriter
from lowcostnav_ros.messages.frames import TF_STATIC, TF_TYPE
from lowcostnav_ros.messages.rules import FURTHER, parse_further
from lowcostnav_ros.ros.flow import header_stamp_ns
from lowcostnav_ros.ros.input_monitor import ERROR, OK, InputMonitor, Status
from lowcostnav_ros.ros.node_base import NodeBase
from lowcostnav_ros.ros.static_frames import QOS, TOPIC, tf_class

FLUSH_S = 1.0  # a killed recorder loses what came since
SYNC_S = 3.0  # longest wait for the disk at the end


@dataclass(frozen=True)
class RecorderSettings:
    """Settings of the recorder."""

    path: str = setting("", "Directory of the recording; it must not exist.  Empty names it after the time of day.")
    numbered: bool = setting(False, "When the directory exists, write to <path>_2, <path>_3, ... instead of refusing.")
    storage: str = setting("mcap", "Format of the bag file.", choices=("mcap", "sqlite3"))
    settings_folder: str = setting("", "Folder of navigator settings to put into the recording, for a replay with the same; empty: none.")
    topics: list[str] = setting([], "Topics to record; empty records every sensor, truth and navigator topic except truth/imu.")
    further: list[str] = setting([], FURTHER)


@executable("recorder", kind="recorder", Settings=RecorderSettings, compiled=False)
class Recorder(NodeBase):
    """Write what arrives; the bag is closed, index and all, when the node ends, and readable to the last second when it is killed.

    The time in the bag is the stamp of the message, made to increase strictly, so that the bag keeps the order of arrival and its length is
    flight time whatever the pace of the simulation.
    """

    poll_period_s = 0.02

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("recorder", [RecorderSettings()], **kwargs)
        settings: RecorderSettings = self.parameters.settings[0]
        self.path = Path(settings.path or f"recording_{self.get_clock().now().nanoseconds // 10**9}")
        if settings.numbered:
            self.path = free_path(self.path)
        self.trouble, self._last_ns, self._flush_at = "", 0, 0.0
        self._syncer: Thread | None = None
        self._flushed, self._closing = Event(), False
        self._early: deque[tuple[topics.TopicSpec, bytes]] = deque(maxlen=1000)
        try:
            self.decoder.rules.kinds.update(parse_further(settings.further))
            names = dict.fromkeys([*(settings.topics or recorded_topics()), *self.decoder.rules.kinds])
            specs = [topics.spec(name, self.decoder.rules) for name in names]
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = BagWriter(self.path, settings.storage)
            if settings.settings_folder:
                shutil.copytree(settings.settings_folder, self.path / SETTINGS_FOLDER)
        except (BagError, ValueError, OSError) as error:
            self.destroy_node()
            raise SettingsError(f"recorder: {error}") from error
        self._syncer = Thread(target=self._sync, name="sync", daemon=True)
        self._syncer.start()
        for spec in specs:
            self.listen_raw(spec.name, partial(self._write, spec))
        frames = tf_class()
        if frames is not None:
            self.msgtypes[TF_STATIC] = TF_TYPE
            self.subscribe(frames, TOPIC, partial(self._keep, topics.TopicSpec(TF_STATIC, TF_TYPE, ""), 0), QOS)

    def _write(self, spec: topics.TopicSpec, monitor: InputMonitor, raw: bytes) -> None:
        stamp_ns = header_stamp_ns(raw)
        monitor.stamped(stamp_ns)
        # diagnostics are stamped by each node's own clock, which a simulated flight need not share
        self._keep(spec, 0 if spec.msgtype == topics.DIAGNOSTICS else stamp_ns, raw)

    def _keep(self, spec: topics.TopicSpec, stamp_ns: int, raw: bytes) -> None:
        """Write a message at its stamp; one without a stamp of flight (0) waits for the first that has one."""
        if not stamp_ns and not self._last_ns:
            self._early.append((spec, raw))
            return
        self._last_ns = max(stamp_ns, self._last_ns + 1)
        while self._early:
            self._put(*self._early.popleft())
            self._last_ns += 1
        self._put(spec, raw)

    def poll(self) -> int:
        """Write what has come; once a second all of it leaves this process."""
        count = super().poll()
        now = time.monotonic()
        if now >= self._flush_at:
            self._flush_at = now + FLUSH_S
            self._guarded(self._writer.flush)
            self._flushed.set()
        return count

    def _put(self, spec: topics.TopicSpec, raw: bytes) -> None:
        self._guarded(self._writer.write, spec.name, self.msgtypes[spec.name], self._last_ns, raw)

    def _guarded(self, write: Callable, *arguments: Any) -> None:
        try:
            write(*arguments)
        except OSError as error:  # a full disk must be seen on the ground, not in the air
            self.trouble = f"cannot write to {self.path}: {error.strerror or error}"
            self.exit_status = Exit.WORSE

    def _sync(self) -> None:
        """Wait for the disk after every flush, off the way of the messages: a power cut then costs no more than a kill."""
        while self._flushed.wait() and not self._closing:
            self._flushed.clear()
            self._guarded(self._writer.sync)

    def rows(self) -> Iterable[Status]:
        """One row per topic that has come, a timeout is no fault of the recorder; and one of the recording."""
        self._check_publishers()
        for monitor in self.inputs.values():
            if monitor.count:
                row = monitor.status(self.get_name())
                yield row._replace(level=OK)
        count = sum(monitor.count for monitor in self.inputs.values())
        values = {"path": str(self.path), "count": str(count), "lost": str(self._writer.lost if hasattr(self, "_writer") else 0)}
        message = self.trouble or f"{count} messages in {self.path}"
        yield Status(f"{self.get_name()}: recording", ERROR if self.trouble else OK, message, values)

    def destroy_node(self) -> None:
        """Close the bag, then the node."""
        if self._syncer is not None:
            self.poll()
            self._closing = True
            self._flushed.set()
            self._syncer.join(SYNC_S)
            self._guarded(self._writer.close)
            if self.trouble:
                self.get_logger().error(self.trouble)
        super().destroy_node()


def free_path(path: Path) -> Path:
    """Return ``path``, or the first of ``<path>_2``, ``<path>_3``, ... that does not exist."""
    taken, number = path, 1
    while taken.exists():
        number += 1
        taken = path.with_name(f"{path.name}_{number}")
    return taken
