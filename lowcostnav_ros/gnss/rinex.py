"""RINEX files, versions 2 and 3: the header, and the numbers both kinds of file are made of.

References
----------
W. Gurtner, RINEX 2.10 and 2.11; W. Gurtner and L. Estey, RINEX 3.00 to 3.05.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from lowcostnav_ros.base.documents import number_in
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.ionosphere import Klobuchar

LABEL = slice(60, 80)


@dataclass(slots=True)
class Header:
    """The fields of a header that matter here; ``lines`` keeps every other line by label."""

    version: float
    kind: str
    lines: dict[str, list[str]] = field(default_factory=dict)

    def first(self, label: str) -> str | None:
        """First line of a label, or None."""
        return self.lines.get(label, [None])[0]

    def leap_seconds(self) -> int | None:
        """GPS - UTC as the file announces it, s, or None."""
        announced = number((self.first("LEAP SECONDS") or "")[0:6])
        return int(announced) if math.isfinite(announced) else None

    def klobuchar(self) -> Klobuchar | None:
        """Coefficients of the GPS ionosphere model, or None when the header has none or not all of them."""
        three = {line[0:4]: line for line in self.lines.get("IONOSPHERIC CORR", [])}
        pairs = ((self.first("ION ALPHA"), self.first("ION BETA"), 2), (three.get("GPSA"), three.get("GPSB"), 5))
        for alpha, beta, start in pairs:
            if alpha and beta:
                rows: list[Any] = [tuple(number(line[start + 12 * k : start + 12 + 12 * k]) for k in range(4)) for line in (alpha, beta)]
                return Klobuchar(*rows) if all(math.isfinite(v) for row in rows for v in row) else None
        return None


def number(text: str) -> float:
    """Number of a fixed-width field, with D or E exponents; NaN when the field is blank or no number."""
    return number_in(text.replace("D", "E").replace("d", "e"))


def read_header(lines: list[str], kind: str) -> tuple[Header, int]:
    """Read a header.

    Parameters
    ----------
    lines : list of str
        All lines of the file.
    kind : {"O", "N"}
        Observation or navigation file.

    Returns
    -------
    header : Header
    first : int
        Index of the first line after it.

    Raises
    ------
    GnssError
        For another version or kind of file, or a header without an end.
    """
    if not lines or "RINEX VERSION" not in lines[0][LABEL]:
        raise GnssError("The first line has no RINEX version; give a RINEX 2 or 3 file, uncompressed.")
    version, found = number(lines[0][0:9]), lines[0][20:21].upper()
    if not 2.0 <= version < 4.0:
        raise GnssError(f"RINEX version {lines[0][0:9].strip() or 'missing'} is not read; convert the file to version 2.11 or 3.")
    if found != kind:
        wanted = {"O": "an observation", "N": "a GPS navigation"}[kind]
        raise GnssError(f"The file is of kind '{found}', where {wanted} file ('{kind}') is needed; give the other file.")
    header = Header(version, found)
    for index, line in enumerate(lines[1:], start=1):
        label = line[LABEL].strip()
        if label == "END OF HEADER":
            return header, index + 1
        header.lines.setdefault(label, []).append(line)
    raise GnssError("The header has no END OF HEADER; the file is cut off, get it again.")
