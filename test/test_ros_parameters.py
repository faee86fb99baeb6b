"""Settings as ROS parameters: declared, described, checked, refused with the reason."""

from dataclasses import dataclass

import pytest

pytest.importorskip("rclpy")

from rclpy.parameter import Parameter

from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.ros.node_base import NodeBase


@dataclass(frozen=True)
class Gate:
    probability: float = setting(0.999, "Share of good innovations let through.", minimum=0.5, maximum=0.9999, live=True)


@dataclass(frozen=True)
class Example:
    rate_hz: float = setting(50.0, "Rate.", unit="Hz", minimum=1.0, maximum=400.0)
    low: float = setting(0.0, "Lower limit.", live=True)
    high: float = setting(1.0, "Upper limit.", live=True)
    scheme: str = setting("one", "Scheme.", choices=("one", "two"))
    times_s: list[float] = setting([], "Times.", unit="s")
    sigma: float | list = setting(0.1, "Sigma.", minimum=0.0, per_axis=True)
    gate: Gate = group(Gate)

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise SettingsError("'low' must not be above 'high'.")


class ExampleNode(NodeBase):
    def __init__(self, **kwargs) -> None:
        self.seen = []
        super().__init__("example", [Example()], **kwargs)

    def on_settings(self, settings) -> None:
        self.seen.append(settings[0])


def test_description_begins_with_the_unit_and_ranges_are_declared(ros):
    node = ros.make(ExampleNode)
    rate = node.describe_parameter("rate_hz")
    assert rate.description == "[Hz] Rate." and rate.read_only
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (1.0, 400.0)
    assert node.describe_parameter("scheme").additional_constraints == "one of one, two"
    assert not node.describe_parameter("gate.probability").read_only


def test_values_from_outside_reach_the_settings_and_whole_numbers_pass_for_numbers(ros):
    node = ros.make(ExampleNode, rate_hz=100, gate__probability=0.99, times_s=[1.0, 2.0])
    settings = node.parameters.settings[0]
    assert (settings.rate_hz, settings.gate.probability, settings.times_s) == (100.0, 0.99, [1.0, 2.0])
    assert node.get_parameter("rate_hz").value == 100.0


def test_one_number_or_three(ros):
    assert ros.make(ExampleNode).parameters.settings[0].sigma == 0.1
    assert ros.make(ExampleNode, sigma=0.3).parameters.settings[0].sigma == 0.3
    node = ros.make(ExampleNode, sigma=[0.1, 0.2, 0.3])
    assert node.parameters.settings[0].sigma == [0.1, 0.2, 0.3] == list(node.get_parameter("sigma").value)
    with pytest.raises(SettingsError, match="one number or three"):
        ros.make(ExampleNode, sigma=[0.1, 0.2])


def test_an_empty_list_in_a_file_is_a_value(ros, tmp_path):
    file = tmp_path / "example.yaml"
    file.write_text("/**:\n  ros__parameters:\n    times_s: []\n    rate_hz: 20\n")
    node = ros.add(ExampleNode(context=ros.context, cli_args=["--ros-args", "--params-file", str(file)]))
    assert node.parameters.settings[0].times_s == [] and node.parameters.settings[0].rate_hz == 20.0
    file.write_text("/**:\n  ros__parameters:\n    time_s: []\n")
    with pytest.raises(SettingsError, match="did you mean 'times_s'"):
        ExampleNode(context=ros.context, cli_args=["--ros-args", "--params-file", str(file)])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"rate_hx": 100.0}, "did you mean 'rate_hz'"),
        ({"probability": 0.9}, "did you mean 'gate.probability'"),
        ({"rate_hz": 500.0}, "at least 1 and at most 400 Hz, got 500"),
        ({"rate_hz": "fast"}, "must be a number Hz"),
        ({"low": 2.0}, "'low' must not be above 'high'"),
    ],
)
def test_what_cannot_be_used_is_refused_at_the_start(ros, given, sentence):
    with pytest.raises(SettingsError, match=sentence):
        ros.make(ExampleNode, **given)


def test_a_live_change_is_taken_and_one_that_does_not_fit_is_refused_with_the_reason(ros):
    node = ros.make(ExampleNode)
    assert node.set_parameters([Parameter("high", value=3.0)])[0].successful
    assert node.seen[-1].high == 3.0
    refused = node.set_parameters([Parameter("low", value=9.0)])[0]
    assert not refused.successful and "'low' must not be above 'high'" in refused.reason
    assert node.get_parameter("low").value == 0.0 and len(node.seen) == 1
    out_of_range = node.set_parameters([Parameter("gate.probability", value=0.2)])[0]
    assert not out_of_range.successful and "range" in out_of_range.reason
    read_only = node.set_parameters([Parameter("rate_hz", value=20.0)])[0]
    assert not read_only.successful and "read-only" in read_only.reason


def test_two_settings_of_one_name_are_refused(ros):
    class Twice(NodeBase):
        def __init__(self, **kwargs) -> None:
            super().__init__("twice", [Example(), Example()], **kwargs)

    with pytest.raises(SettingsError, match="declared twice"):
        ros.make(Twice)
