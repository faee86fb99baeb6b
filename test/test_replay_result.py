"""The typed result of a replay: the layout of its file, there and back."""

import json

import pytest
from replay_fakes import FakeAhrs, FakeSettings, FixFollower, flight

from lowcostnav_ros.base.plain import plain, typed
from lowcostnav_ros.replay.result import ErrorSummary, NavigatorErrors, ReplayResult
from lowcostnav_ros.replay.session import replay_stream
from lowcostnav_ros.replay.withhold import parse_withhold


@pytest.fixture(scope="module")
def result():
    navigators = {"follower": FixFollower(FakeSettings(north_bias_m=3.0)), "ahrs": FakeAhrs(FakeSettings())}
    return replay_stream(flight(30), navigators, (parse_withhold("gps/fix@10-22"),))


def test_a_file_comes_back_as_it_was(result):
    text = json.dumps(result.to_mapping())
    again = ReplayResult.from_mapping(json.loads(text))
    assert again == result and json.dumps(again.to_mapping()) == text


def test_a_stream_has_no_recording_and_no_verdicts(result):
    assert result.recording is None and not {"bag", "truth", "left_out", "inputs", "verdicts"} & result.to_mapping().keys()


@pytest.mark.parametrize("errors", [None, ErrorSummary(3)])
def test_errors_are_the_flight_or_the_withheld_fixes(errors):
    for against_truth, key, other in ((True, "flight", "withheld_gps"), (False, "withheld_gps", "flight")):
        found = NavigatorErrors(whole=errors, against_truth=against_truth)
        mapping = plain(found)
        assert list(mapping)[:3] == ["reference", key, "without_gps"] and other not in mapping
        assert typed(NavigatorErrors, mapping) == found and getattr(found, key) == errors and getattr(found, other) is None
        assert [part for part, _ in found.parts()] == ([key] if errors else [])


def test_what_was_not_compared_is_left_out():
    assert plain(ErrorSummary(1)) == {"samples": 1, "error_over_sigma": {}, "nees_horizontal": None}


@pytest.mark.parametrize("values", [{}, [], {"navigators": {"n": 3}}, None])
def test_what_is_no_result_is_refused(values):
    with pytest.raises(ValueError, match="ReplayResult|NavigatorResult"):
        ReplayResult.from_mapping(values)
