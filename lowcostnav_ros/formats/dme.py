"""DME distances from a small microcontroller beside the receiver: a sentence of the form of NMEA 0183, or ARINC 429 words.

    $PLDME,IDENT,NM,STATUS*hh        $PLDME,OAK,23.45,A*56

IDENT is that of the station table, NM the slant range in nautical miles, STATUS ``A`` for a range that is valid and ``V`` for none (the
receiver searches, or remembers).  A fifth cell, if any, is the 1-sigma in NM.  A range is stamped when its sentence came.
"""

import math
from collections.abc import Iterator, Sequence

from lowcostnav_ros.base.measurements import Measurement, SlantRange
from lowcostnav_ros.base.settings import SettingsError, shown
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.formats.arinc429 import ARINC, DME_SIGMA_M, ArincParser
from lowcostnav_ros.formats.framing import Framer
from lowcostnav_ros.formats.nmea import NMEA

NAME = "PLDME"
FARTHEST_NM = 400.0


def parse_stations(texts: Sequence[str]) -> dict[int, str]:
    """Return idents by frequency, in hundredths of a MHz, of texts such as ``OAK:116.80``; raises SettingsError."""
    stations = {}
    for text in texts:
        ident, _, frequency = text.partition(":")
        try:
            hundredths = round(100.0 * float(frequency))
        except (ValueError, OverflowError):
            hundredths = 0
        if not (ident.isalnum() and len(ident) <= 4 and 10_800 <= hundredths <= 13_595):
            raise SettingsError(f"dme_stations: {shown(text)} must be an ident and its frequency, 108 to 135.95 MHz, such as OAK:116.80.")
        stations[hundredths] = ident
    return stations


class DmeParser(ArincParser):
    """Both on one stream."""

    def __init__(self, stations: dict[int, str] | None = None) -> None:
        super().__init__(stations)
        self.framer = Framer((NMEA, ARINC))

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Turn a sentence or a word into a range."""
        if protocol != NMEA.name:
            yield from (one for one in super().take(protocol, frame) if isinstance(one, SlantRange))
            return
        name, *cells = frame[1:].rpartition(b"*")[0].decode("ascii").split(",")
        if name != NAME:
            self.account.left_out[f"sentence {name[:12]}"] += 1
        elif len(cells) not in (3, 4) or not (cells[0].isalnum() and len(cells[0]) <= 4):
            self.account.refused["PLDME of another form"] += 1
        elif cells[2] != "A":
            self.account.refused["no valid distance"] += 1
        else:
            yield from self._sentence(cells)

    def _sentence(self, cells: list[str]) -> Iterator[Measurement]:
        try:
            distance, sigma = float(cells[1]), float(cells[3]) if len(cells) > 3 and cells[3] else DME_SIGMA_M / NAUTICAL_MILE
        except ValueError:
            distance = sigma = math.nan
        if not (0.0 <= distance <= FARTHEST_NM and 0.001 <= sigma <= 10.0):
            self.account.refused["PLDME with a distance or sigma that is none"] += 1
        elif self.is_new(f"dme/range {cells[0]}" if len(self._newest) < 100 else "dme/range", self.arrived_ns):
            yield SlantRange(self.arrived_ns, "dme/range", cells[0], distance * NAUTICAL_MILE, (sigma * NAUTICAL_MILE) ** 2)
