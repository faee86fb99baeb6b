"""Parameter files: what is written reads back, what is wrong is named, and where the files are looked for."""

import dataclasses

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.base.settings import SettingsError, declared, group, setting
from lowcostnav_ros.catalogue.config_files import config_dir, find_config, load_settings, read_parameters, yaml_of


@dataclasses.dataclass(frozen=True)
class Gate:
    probability: float = setting(0.999, "Probability inside which an innovation is used.", minimum=0.5, maximum=1.0)
    tiny: float = setting(1e-5, "A small length.", unit="m")


@dataclasses.dataclass(frozen=True)
class Node:
    """Settings of a node in a test."""

    rate_hz: float = setting(50.0, "Output rate.", unit="Hz", minimum=1.0, live=True)
    name: str = setting("", "A name: with a colon # and a hash.")
    kind: str = setting("on", "Text that YAML 1.1 would take for a truth value.", choices=("on", "off"))
    enabled: bool = setting(True, "On or off.")
    arm: list = setting([0.0, 1.0, -2e-7], "Lever arm.", unit="m")
    gate: Gate = group(Gate)
    count: int = setting(3, "How many, " + "and many words that make the line long, " * 6)


def test_written_file_reads_back_and_says_everything(tmp_path):
    text = yaml_of(Node, "node_under_test")
    path = tmp_path / "node.yaml"
    path.write_text(text)
    assert load_settings(Node, path) == Node()
    assert set(read_parameters(path)) == {d.name for d in declared(Node)}
    assert "# Output rate [Hz; 1 to inf; may change while running]" in text
    assert "one of on, off" in text
    assert max(map(len, text.splitlines())) < 140
    assert yaml.safe_load(text)["node_under_test"]["ros__parameters"]["gate"]["tiny"] == 1e-5


@given(st.floats(allow_nan=False, allow_infinity=False), st.text(st.characters(codec="ascii", exclude_categories=["C"])))
def test_any_default_reads_back(number, text):
    @dataclasses.dataclass(frozen=True)
    class Some:
        number_of: float = setting(number, "A number.")
        text_of: str = setting(text, "A text.")

    back = yaml.safe_load(yaml_of(Some))["/**"]["ros__parameters"]
    assert back == {"number_of": number, "text_of": text}
    assert isinstance(back["number_of"], float)


def test_own_section_overlays_the_wildcard(tmp_path):
    path = tmp_path / "two.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {rate_hz: 10.0, count: 4, use_sim_time: true}\n"
        "/uav1/a:\n  ros__parameters: {gate: {probability: 0.9}, count: 5}\nb:\n  ros__parameters: {count: 6}\n"
    )
    node = load_settings(Node, path, "/uav1/a")
    assert (node.rate_hz, node.count, node.gate.probability) == (10.0, 5, 0.9)
    assert load_settings(Node, path, "/uav2/b").count == 6
    assert load_settings(Node, path, "c").count == 4


def refusal(tmp_path, text, node=None):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError) as caught:
        load_settings(Node, path, node)
    assert "bad.yaml" in str(caught.value)
    return str(caught.value)


def test_refusals_name_the_file_and_the_remedy(tmp_path):
    head = "/**:\n  ros__parameters:\n    "
    assert "did you mean 'rate_hz'" in refusal(tmp_path, head + "rate_hx: 3.0\n")
    assert "at least 1 Hz" in refusal(tmp_path, head + "rate_hz: 0.1\n")
    assert "did you mean 'gate.probability'" in refusal(tmp_path, head + "probability: 0.9\n")
    assert "not a parameter file" in refusal(tmp_path, "rate_hz: 3.0\n")
    assert "not a parameter file" in refusal(tmp_path, "- 1\n")
    assert "not valid YAML at line 3" in refusal(tmp_path, "/**:\n  ros__parameters: [1, 2\n")
    assert "must hold names and values" in refusal(tmp_path, "/**:\n  ros__parameters: 3\n")
    assert "several nodes" in refusal(tmp_path, "a: {ros__parameters: {}}\nb: {ros__parameters: {}}\n")
    assert "no parameters for 'c'" in refusal(tmp_path, "a: {ros__parameters: {}}\n", "c")
    with pytest.raises(SettingsError, match="does not exist"):
        load_settings(Node, tmp_path / "none.yaml")


def test_config_folder_prefers_the_installed_share(tmp_path, monkeypatch):
    share = tmp_path / "share" / "lowcostnav_ros" / "config"
    share.mkdir(parents=True)
    (share / "here.yaml").write_text("")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert config_dir() == share
    assert find_config("here") == share / "here.yaml"
    with pytest.raises(SettingsError, match=r"there does not exist.*\(here\)"):
        find_config("there")
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    assert (config_dir() / "convert").is_dir()
