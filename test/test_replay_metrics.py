"""Statistics of a replay against closed forms and against numpy on the whole data."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.base.plain import plain
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import eulers_to_quat, wrap
from lowcostnav_ros.replay.columns import NavColumns, blank_columns, concatenate, interpolate, position_difference_n
from lowcostnav_ros.replay.metrics import AXES, ErrorStatistics, errors_between
from lowcostnav_ros.replay.outages import GAP_NS, GpsGaps
from lowcostnav_ros.replay.sketch import MagnitudeStatistics

NS = 1_000_000_000


@given(st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=300), st.sampled_from([0.5, 0.95]))
def test_quantiles_are_right_to_half_a_per_cent(values, probability):
    statistics = MagnitudeStatistics()
    array = np.array(values)
    for part in np.array_split(array, 3):
        statistics.add(part, np.arange(len(part)))
    exact = np.sort(array)[max(1, math.ceil(probability * len(array))) - 1]
    assert statistics.quantile(probability) == pytest.approx(exact, rel=0.0051)
    assert statistics.rms == pytest.approx(math.sqrt(np.mean(array**2)), rel=1e-12)
    assert statistics.maximum == array.max()


def test_a_quantile_of_normal_errors_meets_the_closed_form():
    statistics = MagnitudeStatistics()
    statistics.add(np.random.default_rng(1).normal(0.0, 3.0, 200_000), np.arange(200_000))
    assert statistics.quantile(0.5) == pytest.approx(0.6745 * 3.0, rel=0.01)
    assert statistics.quantile(0.95) == pytest.approx(1.9600 * 3.0, rel=0.01)


def test_the_stamp_of_the_maximum_is_kept():
    statistics = MagnitudeStatistics()
    statistics.add(np.array([1.0, -7.0, 2.0]), np.array([10, 20, 30]))
    statistics.add(np.array([np.nan, 3.0]), np.array([40, 50]))
    assert (statistics.maximum, statistics.maximum_stamp_ns, statistics.count) == (7.0, 20, 4)


def _columns(stamps_s, lat, lon, heading=0.0, vel_e=0.0, sigma=2.0):
    n = len(stamps_s)
    full = np.broadcast_to
    return NavColumns(
        np.round(np.asarray(stamps_s) * NS).astype(np.int64),
        np.column_stack([full(lat, n), full(lon, n), np.full(n, 100.0)]).astype(float),
        np.column_stack([np.zeros(n), full(vel_e, n), np.zeros(n)]).astype(float),
        eulers_to_quat(np.column_stack([np.zeros(n), np.zeros(n), full(heading, n)]).astype(float)),
        np.full((n, 2), 1.0),
        np.tile(np.eye(3) * sigma**2, (n, 1, 1)), np.tile(np.eye(3), (n, 1, 1)),
        np.tile(np.eye(3) * math.radians(1.0) ** 2, (n, 1, 1)), np.tile(np.eye(2), (n, 1, 1)),
    )  # fmt: skip


def test_errors_of_a_known_offset_agree_with_the_exact_tangent_plane():
    lat, lon = math.radians(37.7), math.radians(-121.8)
    reference = _columns([0.0], lat, lon)
    frame = LocalFrame(lat, lon, 100.0)
    lat_1, lon_1, _ = (float(np.squeeze(v)) for v in frame.from_ned(np.array([[30.0, -40.0, 0.0]])))
    errors = errors_between(_columns([0.0], lat_1, lon_1, heading=math.radians(1.5), sigma=5.0), reference)
    assert errors.axis("north_m")[0] == pytest.approx(30.0, abs=1e-3)
    assert errors.axis("east_m")[0] == pytest.approx(-40.0, abs=1e-3)
    assert errors.axis("heading_deg")[0] == pytest.approx(1.5, abs=1e-9)
    assert errors.sigmas[0, AXES.index("north_m")] == 5.0
    assert errors.sigmas[0, AXES.index("heading_deg")] == pytest.approx(1.0)
    assert errors.nees_horizontal[0] == pytest.approx((30.0**2 + 40.0**2) / 25.0, rel=1e-4)


def test_heading_errors_are_taken_across_north():
    reference = _columns([0.0], 0.5, 0.5, heading=math.radians(359.0))
    errors = errors_between(_columns([0.0], 0.5, 0.5, heading=math.radians(2.0)), reference)
    assert errors.axis("heading_deg")[0] == pytest.approx(3.0, abs=1e-9)


def test_honest_sigmas_give_ratio_one_and_nees_two():
    rng = np.random.default_rng(3)
    n, sigma = 20_000, 12.0
    reference = _columns(np.arange(n) * 0.1, 0.6, 1.0, sigma=sigma)
    offset = rng.normal(0.0, sigma, (n, 2)) / 6.378e6
    estimate = _columns(np.arange(n) * 0.1, 0.6 + offset[:, 0], 1.0 + offset[:, 1] / math.cos(0.6), sigma=sigma)
    statistics = ErrorStatistics()
    for part in np.array_split(np.arange(n), 7):
        statistics.add(errors_between(estimate[part], reference[part]))
    ratios = statistics.error_over_sigma()
    assert ratios["north_m"] == pytest.approx(1.0, abs=0.02)
    assert ratios["east_m"] == pytest.approx(1.0, abs=0.02)
    assert statistics.nees_horizontal == pytest.approx(2.0, abs=0.05)
    assert statistics.result().horizontal_m.rms == pytest.approx(sigma * math.sqrt(2.0), rel=0.02)


def test_what_a_navigator_does_not_estimate_leaves_no_numbers():
    estimate = blank_columns(np.array([0]), vel_n=np.array([[1.0, 2.0, 3.0]]))
    statistics = ErrorStatistics()
    statistics.add(errors_between(estimate, _columns([0.0], 0.5, 0.5)))
    found = plain(statistics.result())
    assert "horizontal_m" not in found and "heading_deg" not in found
    assert found["velocity_mps"]["max"] == pytest.approx(math.sqrt(1.0 + 4.0 + 9.0))
    assert found["nees_horizontal"] is None


@given(st.floats(-20.0, 20.0))
def test_wrapping_keeps_the_direction_and_the_range(angle):
    found = float(wrap(np.array([angle]))[0])
    assert -math.pi < found <= math.pi
    assert abs(np.exp(1j * found) - np.exp(1j * angle)) < 1e-12


def test_interpolation_is_linear_across_the_date_line_and_north():
    lon = np.radians([179.999, -179.999])
    columns = _columns([0.0, 1.0], 0.1, lon, heading=np.radians([350.0, 10.0]), vel_e=np.array([10.0, 20.0]))
    middle = interpolate(columns, np.array([NS // 2]), NS)
    assert abs(math.degrees(middle.position[0, 1])) == pytest.approx(180.0, abs=1e-9)
    assert middle.vel_n[0, 1] == pytest.approx(15.0)
    heading = math.degrees(middle.euler[0, 2])
    assert min(heading, 360.0 - heading) == pytest.approx(0.0, abs=1e-9)


def test_interpolation_bridges_no_gap_and_does_not_extrapolate():
    columns = _columns([0.0, 1.0, 5.0], 0.1, 0.2)
    at = interpolate(columns, np.array([-1, NS // 2, 3 * NS, 6 * NS]), NS)
    assert np.isfinite(at.position[:, 0]).tolist() == [False, True, False, False]


def test_columns_join_and_cut_without_change():
    columns = _columns(np.arange(6.0), 0.1, np.linspace(0.2, 0.3, 6))
    joined = concatenate([columns[:2], columns[2:5], columns[5:]])
    assert np.array_equal(joined.position, columns.position) and np.array_equal(joined.stamps_ns, columns.stamps_ns)
    assert np.abs(position_difference_n(joined.position, columns.position)).max() == 0.0


def test_an_outage_begins_three_seconds_after_the_last_fix():
    gaps = GpsGaps()
    for second in (0, 1, 2, 12, 13):
        gaps.add(second * NS)
    stamps = np.array([1, 4, 5, 6, 11, 12, 13, 16, 17]) * NS
    starts = gaps.interval_starts(stamps)
    assert (starts >= 0).tolist() == [False, False, False, True, True, False, False, False, True]
    assert starts[3] == 2 * NS + GAP_NS
    gaps.close(20 * NS)
    assert gaps.intervals == [(5 * NS, 12 * NS), (16 * NS, 20 * NS)]


def test_before_the_first_fix_there_is_no_outage():
    assert (GpsGaps().interval_starts(np.array([0, NS])) == -1).all()
