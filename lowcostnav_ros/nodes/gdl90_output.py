"""A navigator to tablets: GDL 90 with attitude, to UDP port 4000."""

import re
from dataclasses import dataclass

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.formats.gdl90 import Gdl90
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.output_node import Encoder, OutputNode, OutputSettings


@dataclass(frozen=True)
class Gdl90Settings(OutputSettings):
    """What is shown, of which aircraft, and where it goes."""

    address: str = setting("", "ICAO 24-bit address of the aircraft, six hex digits; empty where it has none.")
    call_sign: str = setting("", "Call sign, at most eight letters and digits.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.address and not re.fullmatch("[0-9A-Fa-f]{6}", self.address):
            raise SettingsError(f"address: '{self.address}' must be six hex digits, such as A1B2C3.")
        if not re.fullmatch("[A-Z0-9]{0,8}", self.call_sign):
            raise SettingsError(f"call_sign: '{self.call_sign}' must be at most eight capital letters and digits.")


@executable("gdl90_output", Settings=Gdl90Settings, compiled=False)
class Gdl90Output(OutputNode):
    """Send GDL 90."""

    further = ("air/velocity", "air/static_pressure")

    def make_encoder(self) -> Encoder:
        """Messages of this aircraft."""
        return Gdl90(int(self.settings.address or "0", 16), self.settings.call_sign)
