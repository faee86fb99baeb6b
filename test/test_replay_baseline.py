"""Baselines: verdicts by closed cases, files that are refused, and the way there and back."""

import pytest

from lowcostnav_ros.replay.baseline import BaselineError, Expectation, judge, load_baseline, lookup, write_baseline

SUMMARY = {
    "bag": {"sha256": "ab" * 32},
    "navigators": {
        "nav": {
            "fused": {"equals_recorded": True},
            "errors": {"flight": {"horizontal_m": {"rms": 100.0, "p95": 180.0}, "error_over_sigma": {"north_m": 0.9}}},
        }
    },
}
RMS = "errors.flight.horizontal_m.rms"
RATIO = "errors.flight.error_over_sigma.north_m"


@pytest.mark.parametrize(
    ("expectation", "verdict"),
    [
        (Expectation("nav", RMS, value=98.0, tolerance=5.0), "same"),
        (Expectation("nav", RMS, value=90.0, tolerance=5.0), "worse"),
        (Expectation("nav", RMS, value=110.0, tolerance=5.0), "better"),
        (Expectation("nav", RMS, limit=100.0), "same"),
        (Expectation("nav", RMS, limit=99.9), "worse"),
        (Expectation("nav", RATIO, value=1.3, tolerance=0.1, best=1.0), "better"),
        (Expectation("nav", RATIO, value=1.02, tolerance=0.05, best=1.0), "worse"),
        (Expectation("nav", RATIO, limit=0.2, best=1.0), "same"),
        (Expectation("nav", RATIO, limit=0.05, best=1.0), "worse"),
        (Expectation("nav", "fused.equals_recorded", value=True), "same"),
        (Expectation("nav", "fused.equals_recorded", value=False), "worse"),
        (Expectation("nav", "errors.flight.vertical_m.rms", value=1.0, tolerance=1.0), "worse"),
        (Expectation("gone", RMS, limit=1e9), "worse"),
    ],
)
def test_verdicts(expectation, verdict):
    assert judge([expectation], SUMMARY)[0].verdict == verdict


def test_a_written_baseline_is_met_by_what_it_was_written_from(tmp_path):
    path = tmp_path / "b.yaml"
    count = write_baseline(path, SUMMARY)
    identity, expectations = load_baseline(path)
    assert identity == SUMMARY["bag"]["sha256"]
    assert count == len(expectations) == 4
    assert {v.verdict for v in judge(expectations, SUMMARY)} == {"same"}


def test_tolerances_in_per_cent_are_of_the_value(tmp_path):
    path = tmp_path / "b.yaml"
    path.write_text(f"navigators:\n  nav:\n    {RMS}: {{value: 200, tolerance: 5%}}\n")
    assert load_baseline(path)[1][0].tolerance == pytest.approx(10.0)


def test_metrics_are_found_by_their_path_alone():
    assert lookup(SUMMARY, "nav", RMS) == 100.0
    assert lookup(SUMMARY, "nav", "errors.flight.horizontal_m") is None
    assert lookup(SUMMARY, "nav", "errors.nothing.here") is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("navigators: [1", "not valid YAML"),
        ("metrics: 1", "no 'navigators' section"),
        ("navigators: {nav: 3}", "must hold metrics"),
        (f"navigators: {{nav: {{{RMS}: 3}}}}", "either 'value'"),
        (f"navigators: {{nav: {{{RMS}: {{value: 1, limit: 2}}}}}}", "either 'value'"),
        (f"navigators: {{nav: {{{RMS}: {{value: 1, tolerence: 2}}}}}}", "did you mean 'tolerance'"),
        (f"navigators: {{nav: {{{RMS}: {{value: much}}}}}}", "must be numbers"),
        ("bag: 12\nnavigators: {}", "identity of a bag in quotes"),
    ],
)
def test_unusable_baselines_are_refused_in_one_sentence(tmp_path, text, says):
    path = tmp_path / "b.yaml"
    path.write_text(text)
    with pytest.raises(BaselineError, match=says):
        load_baseline(path)


def test_a_missing_baseline_is_refused(tmp_path):
    with pytest.raises(BaselineError, match="--write-baseline"):
        load_baseline(tmp_path / "none.yaml")
