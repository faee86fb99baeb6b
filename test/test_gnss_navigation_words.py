"""Words of the navigation message there and back, and the total electron content, against the interface's own tables and constants."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.ionosphere import code_delay_m, electron_content, ionosphere_free_m
from lowcostnav_ros.gnss.navigation_words import PREAMBLE, decode_subframe, decode_word, encode_subframe, encode_word, find_subframes

TABLE = (  # bits of table 20-XIV: which of the last two bits before, and which data bits, sum to D25 ... D30
    (29, (1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23)),
    (30, (2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24)),
    (29, (1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22)),
    (30, (2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23)),
    (30, (1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24)),
    (29, (3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24)),
)
DATA = st.integers(0, (1 << 24) - 1)
SUBFRAMES = st.lists(DATA, min_size=9, max_size=9).map(lambda rest: [PREAMBLE << 16 | 0x1234, *rest])


@given(DATA, st.integers(0, 3))
def test_parity_is_that_of_the_table(data, before):
    d = {k: data >> (24 - k) & 1 for k in range(1, 25)}
    last = {29: before >> 1, 30: before & 1}
    sent = [d[k] ^ last[30] for k in range(1, 25)] + [(last[which] + sum(d[k] for k in bits)) % 2 for which, bits in TABLE]
    word = encode_word(data, before)
    assert word == int("".join(map(str, sent)), 2)
    assert decode_word(word, before) == data


@given(DATA, st.integers(0, 3), st.sets(st.integers(0, 29), min_size=1, max_size=3))
def test_up_to_three_wrong_bits_are_noticed(data, before, wrong):
    with pytest.raises(GnssError, match="parity"):
        decode_word(encode_word(data, before) ^ sum(1 << k for k in wrong), before)


@given(SUBFRAMES, st.integers(0, 3))
def test_a_subframe_there_and_back_can_be_read_alone(data, before):
    words = encode_subframe(data, before)
    assert words[1] & 3 == words[9] & 3 == 0
    back = decode_subframe(words, before)
    free = [3 if k in (1, 9) else 0 for k in range(10)]
    assert [b & ~f for b, f in zip(back, free, strict=True)] == [d & ~f for d, f in zip(data, free, strict=True)]


@pytest.mark.parametrize("turned", [0, 1])
def test_subframes_are_found_in_a_stream_of_either_polarity(turned):
    rng = np.random.default_rng(1)
    data = [[PREAMBLE << 16 | 5, *(int(x) for x in rng.integers(0, 1 << 24, 9))] for _ in range(3)]
    words, before = [], 0
    for one in data:
        words += encode_subframe(one, before)
        before = words[-1] & 3
    sent = [int(b) for word in words for b in f"{word:030b}"]
    stream = [int(b) for b in rng.integers(0, 2, 77)] + sent + [int(b) for b in rng.integers(0, 2, 40)]
    found = find_subframes([b ^ turned for b in stream])
    assert [at for at, _ in found if (at - 77) % 300 == 0][-2:] == [377, 677]  # of the first, the bits before are not its own
    assert found[-1][1][2:9] == data[-1][2:9]


def test_what_is_no_subframe_is_refused():
    with pytest.raises(GnssError, match="preamble"):
        encode_subframe([0] * 10)
    with pytest.raises(GnssError, match="has ten words"):
        decode_subframe([0] * 9)
    with pytest.raises(GnssError, match="preamble"):
        decode_subframe([encode_word(0)] * 10)


def test_electron_content_delays_the_code_by_the_physics_of_a_plasma():
    charge, mass, vacuum, l1, l2 = 1.602176634e-19, 9.1093837e-31, 8.8541878e-12, 1575.42e6, 1227.60e6
    physics = charge**2 / (8.0 * math.pi**2 * vacuum * mass)
    assert code_delay_m(1e16) == pytest.approx(physics * 1e16 / l1**2, rel=1e-3)
    assert code_delay_m(1e16) == pytest.approx(0.162, abs=5e-4)
    electrons, distance = np.array([5e16, 1e18]), 2.2e7
    one, two = (distance + code_delay_m(electrons, hz) for hz in (l1, l2))
    np.testing.assert_allclose(electron_content(one, two, l1, l2), electrons, rtol=1e-6)
    np.testing.assert_allclose(ionosphere_free_m(one, two, l1, l2), distance, atol=1e-6)
