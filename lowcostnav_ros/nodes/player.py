"""Play a recording onto the topics it was made from, with /clock."""

from dataclasses import dataclass
from typing import Any

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagError
from lowcostnav_ros.messages.rules import FURTHER, parse_further
from lowcostnav_ros.messages.topics import CLOCK, DIAGNOSTICS, TopicSpec, kind_of
from lowcostnav_ros.ros.publishing import Output
from lowcostnav_ros.ros.source_node import SourceNode

NOT_PLAYED = (CLOCK, DIAGNOSTICS)  # a new clock is made; recorded diagnostics would be taken for those of running nodes


@dataclass(frozen=True)
class PlayerSettings:
    """Settings of the player."""

    path: str = setting("", "Bag to play: a directory with metadata.yaml, or an .mcap or .db3 file.")
    topics: list[str] = setting([], "Topics to play; empty plays the sensors only, or everything when there are none.")
    further: list[str] = setting([], FURTHER)
    begin_s: float = setting(0.0, "Begin this long after the start of the recording.", unit="s", minimum=0.0)


@executable("player", kind="source", Settings=PlayerSettings, compiled=False)
class Player(SourceNode):
    """Publish the bytes of a bag in recorded order at ``real_time_factor`` times its pace."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("player", [PlayerSettings()], **kwargs)

    def make_outputs(self) -> None:
        """Open the bag and make one publisher per topic."""
        self._settings: PlayerSettings = self.parameters.settings[0]
        try:
            self.decoder.rules.kinds.update(parse_further(self._settings.further))
            self._bag = BagReader(self._settings.path)
            names = self._settings.topics or self._sensors()
            self._bag_outputs: dict[str, Output] = {name: self.output_of(name) for name in names}
        except BagError as error:
            raise SettingsError(f"player: {error}") from error

    def output_of(self, name: str) -> Output:
        """Return the publisher of a topic of the bag, of whatever type it was recorded with."""
        if name not in self._bag.types:
            raise BagError(f"{self._settings.path} has no topic '{name}'; it has {', '.join(sorted(self._bag.types))}.")
        own = kind_of(name, self.decoder.rules) or TopicSpec(name, self._bag.types[name], "")
        return self.outputs.setdefault(name, Output(self, own, name, self.node_settings.qos.lossless))

    def publish_all(self) -> None:
        """Play."""
        begin_ns = self._bag.start_ns + round(1e9 * self._settings.begin_s)
        with self._bag as bag:
            for name, stamp_ns, raw in bag.stream(list(self._bag_outputs)):
                if stamp_ns < begin_ns and not name.endswith("/origin"):
                    continue
                if not self.at(max(stamp_ns, begin_ns)):
                    return
                self._bag_outputs[name].send(bytes(raw))

    def _sensors(self) -> list[str]:
        """Topics a navigator would compute itself are not played against it."""
        playable = [name for name, kind in self._bag.types.items() if kind not in NOT_PLAYED]
        sensors = [name for name in playable if (kind := kind_of(name, self.decoder.rules)) is not None and kind.sensed]
        return sensors or playable
