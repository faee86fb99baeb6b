"""DME channels and the VHF frequencies they are paired with (ICAO Annex 10, volume I, table A)."""

import math

_BANDS = ((1, 16, 134.40), (17, 59, 108.00), (60, 69, 133.30), (70, 126, 112.30))
"""First channel, last channel, frequency of the first X channel in MHz; channels step by 0.1 MHz, Y lies 0.05 MHz above X."""


def channel_of(frequency_mhz: float) -> str:
    """Return the channel, such as ``86X``, paired with a VHF frequency.

    Raises
    ------
    ValueError
        When no channel is paired with it.
    """
    steps = round(frequency_mhz * 20.0) if math.isfinite(frequency_mhz) else 0
    for first, last, base in _BANDS:
        number, y = divmod(steps - round(base * 20.0), 2)
        if 0 <= number <= last - first and abs(steps / 20.0 - frequency_mhz) < 0.005:
            return f"{first + number}{'Y' if y else 'X'}"
    raise ValueError(f"No DME channel is paired with {frequency_mhz:g} MHz; give a frequency from 108.00 to 117.95 MHz.")


def frequency_mhz(channel: str) -> float:
    """Return the VHF frequency, MHz, paired with a channel such as ``86X``."""
    number = int(channel[:-1]) if channel[:-1].isdigit() else 0
    for first, last, base in _BANDS:
        if first <= number <= last and channel[-1] in "XY":
            return round(base + 0.1 * (number - first) + (0.05 if channel[-1] == "Y" else 0.0), 2)
    raise ValueError(f"DME channel '{channel}' must be 1 to 126 followed by X or Y.")
