"""Cells of a station table: what cannot be right is refused in a sentence."""


class StationError(ValueError):
    """A station table that cannot be flown on; the message names station and remedy."""


def number(cells: dict[str, str], column: str, low: float, high: float, where: str) -> float:
    """Return the number of a cell.

    Raises
    ------
    StationError
        When it is none, or not within its bounds; the message begins with ``where``.
    """
    try:
        value = float(cells[column])
    except ValueError:
        raise StationError(f"{where}: {column} '{cells[column]}' must be a number.") from None
    if not low <= value <= high:  # also refuses NaN
        raise StationError(f"{where}: {column} of {value:g} must lie between {low:g} and {high:g}.")
    return value
