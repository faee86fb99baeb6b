"""The report: numbers in figures against closed forms, a page that needs nothing else."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from replay_fakes import REGISTRY, FakeAhrs, FakeSettings, FixFollower, flight, write_bag, write_config

from lowcostnav_ros.cli.main import main
from lowcostnav_ros.replay.digest import Comparison
from lowcostnav_ros.replay.result import ErrorSummary, NavigatorErrors, NavigatorResult, Size
from lowcostnav_ros.replay.session import replay_stream
from lowcostnav_ros.replay.withhold import parse_withhold
from lowcostnav_ros.replay.words import distance, error_over_sigma, sentence
from lowcostnav_ros.report import svg
from lowcostnav_ros.report.chart import BOTTOM, LEFT, LEVELS, RIGHT, TOP, UNITS, Band, Curve, Frame, TimeAxis, time_chart
from lowcostnav_ros.report.decimate import straightened, thin, thin_envelope
from lowcostnav_ros.report.flight.page import page_of
from lowcostnav_ros.report.flight.result_folder import read_result, read_table
from lowcostnav_ros.report.flight.timeline import mode_spans
from lowcostnav_ros.report.map_chart import Track, map_chart


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import json

    out = tmp_path_factory.mktemp("result")
    navigators = {"follower": FixFollower(FakeSettings(north_bias_m=3.0)), "ahrs": FakeAhrs(FakeSettings())}
    result = replay_stream(flight(30), navigators, (parse_withhold("gps/fix@10-22"),), out=out)
    (out / "summary.json").write_text(json.dumps(result.to_mapping()))
    return out


@given(st.integers(2, 6000), st.integers(0, 2**31))
def test_thinning_keeps_extremes_ends_of_buckets_and_order(n, seed):
    y = np.random.default_rng(seed).normal(size=n)
    x = np.arange(n, dtype=float)
    tx, ty = thin(x, y, 200)
    assert len(tx) <= max(n if n <= 400 else 0, 400)
    assert (ty.min(), ty.max()) == (y.min(), y.max())
    assert np.all(np.diff(tx) > 0) and set(zip(tx, ty, strict=True)) <= set(zip(x, y, strict=True))


def test_thinning_keeps_gaps_and_envelopes_never_shrink():
    x, y = np.arange(5000.0), np.sin(np.arange(5000.0) / 50.0) + 2.0
    y[2500:2600] = np.nan
    tx, ty = thin(x, y, 100)
    assert np.isnan(ty[(tx >= 2500) & (tx < 2600)]).any()
    ex, ey = thin_envelope(x, np.abs(np.nan_to_num(y)), 100)
    assert ey.max() == np.abs(np.nan_to_num(y)).max() and len(ex) <= 100


def _points(data):
    """Absolute points of a path in relative steps, decoded the long way round."""
    points, x, y = [], 0, 0
    for move, rest in re.findall(r"M([-\d ]+)(?:l([-\d ]*))?", data):
        x, y = (int(v) for v in re.findall(r"-?\d+", move))
        points.append((x, y))
        steps = [int(v) for v in re.findall(r"-?\d+", rest or "")]
        for dx, dy in zip(steps[::2], steps[1::2], strict=True):
            x, y = x + dx, y + dy
            points.append((x, y))
    return points


@given(st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=1, max_size=60))
def test_paths_decode_to_the_points_they_were_made_of(points):
    x, y = np.array(points).T
    decoded = _points(svg.path_data(x, y))
    expected = list(zip(np.round(x).astype(int).tolist(), np.round(y).astype(int).tolist(), strict=True))
    assert decoded == [p for k, p in enumerate(expected) if k == 0 or p != expected[k - 1]]


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.integers(3, 10))
def test_ticks_are_round_and_inside(low, span, count):
    high = low + span
    ticks = svg.nice_ticks(low, high, count)
    steps = np.diff(ticks)
    assert all(low - 1e-6 * span <= t <= high + 1e-6 * span for t in ticks) and len(ticks) <= count + 2
    if len(ticks) > 1:
        mantissa = steps[0] / 10.0 ** np.floor(np.log10(steps[0]) + 1e-9)
        assert min(abs(mantissa - m) for m in (1, 2, 5, 10)) < 1e-3


def test_tick_labels_have_the_decimals_their_spacing_needs():
    assert svg.tick_label(-20.0, (-20.0, 0.0)) == "\N{MINUS SIGN}20"
    assert svg.tick_label(0.02, (0.0, 0.02, 0.04)) == "0.02"


def _plot(root):
    """The inside of a drawing, which the page's script stretches."""
    return next(e for e in root.iter("svg") if e.get("class") == "plot")


def test_a_chart_places_its_corners_where_the_frame_says():
    axis = TimeAxis(100.0, 200.0, [(120.0, 150.0)])
    frame = Frame(axis, 960, 150, -1.0, 1.0)
    assert (frame.pixel_x(100.0), frame.pixel_x(200.0)) == (LEFT, 960 - RIGHT)
    assert (frame.y(-1.0), frame.y(1.0)) == (LEVELS, 0)
    drawn = time_chart("Error [m]", axis, [Curve(np.array([100.0, 200.0]), np.array([-1.0, 1.0]), "#000")], limits=(-1.0, 1.0))
    root = ET.fromstring(drawn)
    plot = _plot(root)
    box = {"x": LEFT, "y": TOP, "width": 960 - LEFT - RIGHT, "height": 150 - TOP - BOTTOM}
    assert {key: float(plot.get(key)) for key in box} == box and plot.get("viewBox") == f"0 0 {UNITS} {LEVELS}"
    (curve,) = plot.findall("path")
    assert _points(curve.get("d")) == [(0, LEVELS), (UNITS, 0)]
    shaded = next(r for r in plot.findall("rect") if r.get("class") == "outage")
    assert (float(shaded.get("x")), float(shaded.get("width"))) == (0.2 * UNITS, 0.3 * UNITS)
    assert (root.get("data-low"), root.get("data-high"), root.get("data-unit")) == ("-1", "1", "m")


def test_bands_are_one_and_two_sigma():
    axis = TimeAxis(0.0, 10.0)
    t, one = np.array([0.0, 10.0]), np.ones(2)
    band = _plot(ET.fromstring(time_chart("e", axis, [Band(t, one, "#00f")], limits=(-4.0, 4.0)))).find("g")
    rows = [y for _, y in _points(band.find("path").get("d"))]
    assert (min(rows), max(rows)) == (LEVELS * 3 // 8, LEVELS // 2)  # from one sigma down to zero
    middle = [[float(v) for v in use.get("transform")[7:-1].split()] for use in band.findall("use")]
    assert sorted(k * min(rows) + shift for _, _, _, k, _, shift in middle) == [LEVELS * f / 8 for f in (2, 5, 6)]
    about = _plot(ET.fromstring(time_chart("e", axis, [Band(t, one, "#00f", 1.0 + one)], limits=(-4.0, 4.0)))).find("g")
    spans = [[y for _, y in _points(path.get("d"))] for path in about.findall("path")]
    assert [(max(s), min(s)) for s in spans] == [(LEVELS // 2, 0), (LEVELS * 3 // 8, LEVELS // 8)]


@given(st.integers(3, 400), st.integers(0, 2**31), st.floats(0.5, 20.0))
def test_straightening_stays_within_what_it_may(n, seed, most):
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.integers(1, 5, n)).astype(float), np.round(np.cumsum(rng.normal(0.0, 3.0, n)))
    y[rng.random(n) < 0.05] = np.nan
    kept_x, kept_y = straightened(x, y, most)
    assert (kept_x[0], kept_x[-1]) == (x[0], x[-1]) and np.isnan(kept_y).sum() == np.isnan(y).sum()
    known = np.isfinite(y)
    assert np.all(np.abs(np.interp(x, kept_x, kept_y) - y)[known] <= most + 1e-9)
    stepped = straightened(np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 0.0, 9.0, 9.0]))
    assert stepped[1].tolist() == [0.0, 0.0, 9.0, 9.0]


def test_a_map_shows_the_airport_and_the_coast_that_are_there():
    drawn = map_chart([Track(np.array([37.5, 37.8]), np.array([-122.6, -122.0]), "#000", "way")])
    assert "KSFO" in drawn and "San Francisco" in drawn and 'class="coast"' in drawn
    assert 'class="coast"' not in map_chart([Track(np.array([48.0, 48.1]), np.array([11.0, 11.1]), "#000", "inland")])


def test_nothing_to_draw_is_an_empty_string():
    assert time_chart("e", TimeAxis(0.0, 1.0), [Curve(np.array([0.0]), np.array([np.nan]), "#000")]) == ""
    assert map_chart([Track(np.array([np.nan]), np.array([np.nan]), "#000", "x")]) == ""


def test_the_map_has_the_same_scale_both_ways_and_north_up():
    side = 1852.0 * 4 / 6.371e6
    lat = np.degrees(np.array([0.6, 0.6 + side, 0.6 + side, 0.6]))
    lon = np.degrees(np.array([1.0, 1.0, 1.0 + side / np.cos(0.6), 1.0 + side / np.cos(0.6)]))
    root = ET.fromstring(f'<div>{map_chart([Track(lat, lon, "#123456", "square")])}</div>')
    (path,) = [p for p in root.iter("path") if p.get("stroke") == "#123456"]
    (x0, y0), (x1, y1), (x2, y2), _ = _points(path.get("d"))
    assert y1 < y0 and x2 > x1
    assert (x2 - x1) / (y0 - y1) == pytest.approx(1.0, abs=0.01)
    labels = [t.text for t in root.iter("text")]
    assert "N" in labels and any("[NM]" in t for t in labels)


def test_mode_spans_join_runs():
    spans = mode_spans(np.array([0.0, 1.0, 2.0, 3.0]), np.array(["gps", "gps", "coasting", "coasting"]))
    assert spans == [(0.0, 2.0, "gps"), (2.0, 3.0, "coasting")]


def test_a_mode_does_not_last_through_a_silence():
    t_s = np.array([0.0, 1.0, 2.0, 60.0, 61.0])
    assert mode_spans(t_s, np.array(["gps"] * 5)) == [(0.0, 2.0, "gps"), (60.0, 61.0, "gps")]


def test_the_sentence_says_when_there_was_less_than_a_gps_position():
    errors = NavigatorErrors(whole=part_of(9.0, 4.0, 1.0))
    navigator = NavigatorResult(Comparison().result(), 9, "gps", "", errors=errors, mode_seconds={"gps": 300.0, "sparse": 280.4})
    assert sentence("n", navigator, 0.0).startswith("n: 280 s with fewer than four satellites or transmitters, worst 9.0 m")
    navigator = replace(navigator, mode_seconds={"gps": 20.0, "no solution": 40.0})
    assert sentence("n", navigator, 0.0).startswith("n: 40 s without a solution,")
    assert sentence("n", replace(navigator, mode_seconds={"gps": 20.0}), 0.0).startswith("n: GPS all flight,")


def part_of(largest, p95, ratio):
    return ErrorSummary(9, Size(p95, p95, p95, largest, 0.0), error_over_sigma={"north_m": ratio, "east_m": ratio})


class _Checker(HTMLParser):
    """Fails on unbalanced tags and collects every address a browser would fetch."""

    VOID = {"meta", "line", "path", "rect", "circle", "ellipse", "polygon", "input"}

    def __init__(self):
        super().__init__()
        self.open, self.fetched = [], []

    def handle_starttag(self, tag, attributes):
        self.fetched += [v for k, v in attributes if k in ("src", "href", "xlink:href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.fetched += [v for k, v in attributes if k in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_the_page_stands_alone_and_says_what_was_found(folder):
    page = page_of(read_result(folder), "Flight <7>")
    checker = _Checker()
    checker.feed(page)
    assert checker.open == [] and all(address.startswith("#") for address in checker.fetched)
    assert "@import" not in page and "Flight &lt;7&gt;" in page and len(page) < 3_000_000
    assert re.search(r"</b>: 10 s without GPS, worst \d+ m, 95 % within \d+ m, sigma too small", page)
    assert "NaN" not in re.sub("<script>.*?</script>", "", page, flags=re.DOTALL) and ">nan<" not in page
    for heading in ("Map", "Modes and refused measurements", "Errors", "follower: errors in their sigmas", "Attitude", "Settings"):
        assert f"<h2>{heading}</h2>" in page or f"<summary>{heading}</summary>" in page


def test_every_figure_is_well_formed_and_decimated(folder):
    page = page_of(read_result(folder))
    figures = re.findall(r'<svg class="(?:chart|map).*?</svg>.*?</svg>', page, re.S)
    assert len(figures) > 10
    for figure in figures:
        for path in _plot(ET.fromstring(figure)).iter("path"):
            assert len(_points(path.get("d"))) < 4000 or path.get("class")


def test_a_bag_is_reported_on_by_way_of_a_replay(capsys, tmp_path):
    bag, config = write_bag(tmp_path / "flight", flight(8)), write_config(tmp_path)
    page = tmp_path / "r.html"
    assert main(["report", str(bag), "-o", str(page), "--config", str(config), "--navigators", "follower"], REGISTRY) == 0
    assert "sha256" in page.read_text() and "r.html" in capsys.readouterr().out


def test_a_folder_without_results_is_refused(capsys, tmp_path):
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "r.html")], REGISTRY) == 2
    (tmp_path / "summary.json").write_text("{}")
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "r.html")], REGISTRY) == 2
    assert "no readable summary.json" in capsys.readouterr().err


def test_blank_cells_come_back_as_nan(folder):
    columns = read_table(folder / "ahrs.csv")
    assert np.isnan(columns["lat_deg"]).all() and np.isfinite(columns["roll_deg"]).all()
    assert set(columns["mode"].tolist()) == {"gps"}


def test_every_navigator_has_the_columns_of_its_own_files(folder):
    result = read_result(folder)
    assert len(result.navigators) > 1
    for name, navigator in result.navigators.items():
        own = read_table(folder / f"{name}.csv")
        assert np.array_equal(navigator.solutions["heading_deg"], own["heading_deg"], equal_nan=True)
        assert np.array_equal(navigator.errors["t_s"], read_table(folder / f"{name}_errors.csv")["t_s"])


@pytest.mark.parametrize(
    ("metres", "said"), [(3.14, "3.1 m"), (412.4, "412 m"), (1999.0, "1999 m"), (3704.0, "3.7 km (2.0 NM)")]
)
def test_distances_are_said_as_a_pilot_would(metres, said):
    assert distance(metres) == said


def test_sentences_call_sigmas_by_what_they_are():
    def navigator(ratio):
        part = part_of(412.0, 380.0, ratio)
        return NavigatorResult(Comparison().result(), 9, "coasting", "", errors=NavigatorErrors("truth", part, part))

    assert sentence("dead_reckoning", navigator(0.9), 340.0) == (
        "dead_reckoning: 340 s without GPS, worst 412 m, 95 % within 380 m, sigma honest (error/sigma 0.9)."
    )
    assert "sigma too small" in sentence("x", navigator(3.0), 1.0) and "sigma cautious" in sentence("x", navigator(0.2), 1.0)
    assert error_over_sigma({"north_m": 3.0, "east_m": 4.0}) == pytest.approx(np.sqrt(12.5))
