"""Phrases that several tables and reports share."""

from collections.abc import Mapping


def counted(reasons: Mapping[str, int], between: str = " ") -> str:
    """Counts by reason, the commonest first: ``3 late, 1 wrong frame id``."""
    return ", ".join(f"{count}{between}{reason}" for reason, count in sorted(reasons.items(), key=lambda item: (-item[1], item[0])))
