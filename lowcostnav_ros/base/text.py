"""Phrases that several tables and reports share, and numbers read back from such."""

import math
from collections.abc import Mapping


def counted(reasons: Mapping[str, int], between: str = " ") -> str:
    """Counts by reason, the commonest first: ``3 late, 1 wrong frame id``."""
    return ", ".join(f"{count}{between}{reason}" for reason, count in sorted(reasons.items(), key=lambda item: (-item[1], item[0])))


def numeric(values: Mapping[str, str], name: str) -> float | None:
    """One of the values of a row of diagnostics as a number, None where it is missing or none."""
    try:
        value = float(values[name])
    except (KeyError, ValueError):
        return None
    return value if math.isfinite(value) else None
