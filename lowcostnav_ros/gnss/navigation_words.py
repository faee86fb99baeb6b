"""Words of the GPS L1 navigation message: 24 bits of data and 6 of parity, ten to a subframe of 300 bits, framed both ways.

The parity of a word reaches back to the last two bits of the word before it, and the last of those turns the data bits over.  Every
subframe begins with a telemetry word and a hand-over word; the parity of the latter, and of the last word, is made to end in two zeros by
its two free bits, so that a subframe can be read without the one before it.

References
----------
IS-GPS-200, 20.3.3 to 20.3.5, table 20-XIV; Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: section 2.2.
"""

from collections.abc import Sequence

from lowcostnav_ros.gnss import GnssError

PREAMBLE = 0b10001011
WORDS, WORD_BITS, SUBFRAME_BITS = 10, 30, 300
_MASKS = (0xEC7CD2, 0x763E69, 0xBB1F34, 0x5D8F9A, 0xAEC7CD, 0x2DEA27)
"""Data bits, the first the most significant, that each of the six parity bits sums (table 20-XIV)."""
_BEFORE = (1, 0, 1, 0, 0, 1)
"""Whether a parity bit starts from the last bit of the word before (0) or from the last but one (1): D29*, D30*, D29*, D30*, D30*, D29*."""


def encode_word(data: int, before: int = 0) -> int:
    """Return the 30 bits sent for 24 bits of ``data`` after a word that ended in the two bits ``before``."""
    parity = _parity(data, before)
    return (data ^ (0xFFFFFF if before & 1 else 0)) << 6 | parity


def decode_word(word: int, before: int = 0) -> int:
    """Return the 24 data bits of a 30-bit ``word``.

    Raises
    ------
    GnssError
        When the parity does not fit.
    """
    data = word >> 6 ^ (0xFFFFFF if before & 1 else 0)
    if _parity(data, before) != word & 0x3F:
        raise GnssError("The parity of a navigation word does not fit; drop the subframe.")
    return data


def encode_subframe(data: Sequence[int], before: int = 0) -> list[int]:
    """Frame ten words of 24 bits of data (the telemetry and hand-over words first) for sending.

    Bits 23 and 24 of words 2 and 10 are chosen so that their parity ends in zeros, whatever stands there.

    Raises
    ------
    GnssError
        For other than ten words, more than 24 bits, or a first word without the preamble.
    """
    if len(data) != WORDS or any(not 0 <= word < 1 << 24 for word in data) or data[0] >> 16 != PREAMBLE:
        raise GnssError("A subframe is ten words of 24 bits, the first of which begins with the preamble 10001011.")
    words: list[int] = []
    for k, word in enumerate(data):
        choices = [word & ~3 | free for free in range(4)] if k in (1, WORDS - 1) else [word]
        sent = [encode_word(choice, before) for choice in choices]
        words.append(next((w for w in sent if not w & 3), sent[0]))
        before = words[-1] & 3
    return words


def decode_subframe(words: Sequence[int], before: int = 0) -> list[int]:
    """Return the 24 data bits of each of ten 30-bit words; the other way of :func:`encode_subframe`.

    Raises
    ------
    GnssError
        For other than ten words, a parity that does not fit, or no preamble.
    """
    if len(words) != WORDS:
        raise GnssError(f"A subframe has ten words, got {len(words)}.")
    data = []
    for word in words:
        data.append(decode_word(word, before))
        before = word & 3
    if data[0] >> 16 != PREAMBLE:
        raise GnssError("The first word of the subframe does not begin with the preamble.")
    return data


def find_subframes(bits: Sequence[int]) -> list[tuple[int, list[int]]]:
    """Find subframes in a stream of bits, either way up, as (index of the first bit, data words): preamble, and parity of all ten words.

    A stream begins nowhere in particular and a receiver's carrier may be half a cycle off, which turns every bit over.
    """
    found, at = [], 0
    while at + SUBFRAME_BITS <= len(bits):
        words = [_number(bits[k : k + WORD_BITS]) for k in range(at, at + SUBFRAME_BITS, WORD_BITS)]
        before = _number(bits[at - 2 : at]) if at >= 2 else 0
        for turned in (0, (1 << WORD_BITS) - 1):
            try:
                found.append((at, decode_subframe([word ^ turned for word in words], before ^ (turned & 3) if at >= 2 else 0)))
            except GnssError:
                continue
            at += SUBFRAME_BITS - 1
            break
        at += 1
    return found


def _parity(data: int, before: int) -> int:
    out = 0
    for mask, which in zip(_MASKS, _BEFORE, strict=True):
        out = out << 1 | ((data & mask).bit_count() + (before >> which)) & 1
    return out


def _number(bits: Sequence[int]) -> int:
    out = 0
    for bit in bits:
        out = out << 1 | bit
    return out
