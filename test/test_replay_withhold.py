"""Withholding: the form, the rule of the two clocks, the cut of inertial blocks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.base.measurements import GpsVelocity, ImuBlock
from lowcostnav_ros.replay.withhold import Withhold, WithholdError, check_sources, parse_withhold, resolve, split

NS = 1_000_000_000
EPOCH = 1_780_000_000


def test_sources_and_window_are_read():
    assert parse_withhold(" /gps/fix, gps/vel@290-350.5 ") == Withhold(("gps/fix", "gps/vel"), 290.0, 350.5)
    assert parse_withhold("dme/range") == Withhold(("dme/range",))


BAD_FORMS = ["", "@1-2", "gps/fix@", "gps/fix@5", "gps/fix@a-b", "gps/fix,,gps/vel@1-2", "gps/fix@1-2-3", "gps/fix@-5-2"]


@pytest.mark.parametrize("text", BAD_FORMS)
def test_other_forms_are_refused_with_an_example(text):
    with pytest.raises(WithholdError, match=r"gps/fix,gps/vel@290-350"):
        parse_withhold(text)


def test_an_empty_window_is_refused():
    with pytest.raises(WithholdError, match="must end after it starts"):
        parse_withhold("gps/fix@350-290")


def test_an_unknown_source_is_refused_with_the_nearest():
    with pytest.raises(WithholdError, match="did you mean 'gps/fix'"):
        check_sources([Withhold(("gps/fxi",))], ["gps/fix", "imu/data_raw"])


def test_windows_before_the_first_stamp_count_from_the_start():
    window = resolve(parse_withhold("gps/fix@290-350"), EPOCH * NS)
    assert (window.start_ns, window.end_ns) == ((EPOCH + 290) * NS, (EPOCH + 350) * NS)
    assert "from the start" in window.text


def test_windows_from_the_first_stamp_on_are_stamps():
    window = resolve(parse_withhold(f"gps/fix@{EPOCH + 290}-{EPOCH + 350}"), EPOCH * NS)
    assert (window.start_ns, window.end_ns) == ((EPOCH + 290) * NS, (EPOCH + 350) * NS)
    assert "as stamps" in window.text


def test_a_bag_that_starts_at_zero_means_the_same_by_either_reading():
    window = resolve(parse_withhold("gps/fix@0-60"), 0)
    assert (window.start_ns, window.end_ns) == (0, 60 * NS)


def test_without_a_window_all_flight_is_withheld():
    window = resolve(parse_withhold("gps/vel"), 5 * NS)
    measurement = GpsVelocity(7 * NS, "gps/vel", np.zeros(3), np.eye(3))
    assert split(measurement, [window]) == (None, measurement)


@given(st.floats(0.0, 40.0), st.floats(0.01, 40.0))
def test_inertial_blocks_are_cut_by_sample_and_nothing_is_lost(start, length):
    stamps = np.arange(0, 40 * NS, NS // 4)
    block = ImuBlock.of("imu/data_raw", stamps, np.arange(3 * len(stamps), dtype=float).reshape(-1, 3), np.zeros((len(stamps), 3)))
    window = resolve(Withhold(("imu/data_raw",), start, start + length), 0)
    given_, held = split(block, [window])
    expected = (stamps >= window.start_ns) & (stamps < window.end_ns)
    assert np.array_equal(held.stamps_ns if held else np.empty(0), stamps[expected])
    assert np.array_equal(given_.specific_force_b if given_ else np.empty((0, 3)), block.specific_force_b[~expected])


def test_a_window_without_an_end_lasts_for_the_rest_of_the_flight():
    withhold = parse_withhold("gps/fix,gps/vel@290-")
    assert (withhold.start_s, withhold.end_s, withhold.text) == (290.0, None, "gps/fix,gps/vel@290-")
    window = resolve(withhold, EPOCH * NS)
    assert window.start_ns == (EPOCH + 290) * NS
    assert window.holds("gps/vel", (EPOCH + 10**6) * NS) and not window.holds("gps/vel", (EPOCH + 289) * NS)
    assert "withheld from 290 s on, read as seconds from the start" in window.text
    assert "read as stamps" in resolve(parse_withhold(f"gps/fix@{EPOCH + 290}-"), EPOCH * NS).text
