"""Some dozens of damaged files of every kind: a status, a sentence, no traceback, no hang (all of them: benchmarks/damaged_files.py)."""

import argparse
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from damaged_files import damage, make_kinds, measure, outcome, sound

from lowcostnav_ros.base.documents import parse_yaml, read_text, write_text, written_whole
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.graph.description import GraphError, parse_graph
from lowcostnav_ros.navigators.ins_gps import InsGps


@pytest.mark.timeout(400)
def test_damaged_files_are_used_or_refused_in_a_sentence():
    result = measure(argparse.Namespace(runs=40, quick=True, seed=11, only="", keep="", minutes=10.0))
    assert result["failures"] == []
    assert sum(n for kinds in result["kinds"].values() for n in kinds.values()) == 40


def test_the_benchmark_sees_what_it_is_for(tmp_path):
    def breaks(_path):
        raise KeyError("an error of nobody's")

    (tmp_path / "x").write_text("x")
    assert outcome(breaks, tmp_path / "x", tmp_path)[0] == "traceback"
    assert outcome(lambda _path: bytearray(1_500_000_000), tmp_path / "x", tmp_path)[0] == "memory"
    (tmp_path / "out").write_text("half")
    assert outcome(("convert", "nowhere", "-o", "{out}"), tmp_path / "x", tmp_path)[0] == "left behind"
    assert damage and make_kinds and sound


STRANGE = [
    ("5: 6", "the name 5 is no text"),
    ("a: &a [*a]", "holds itself"),
    ("[" * 1500, "not valid YAML|nested too deeply"),
    ("a: " + "[" * 1500 + "]" * 1500, "nested too deeply"),
    ("a: 2020-99-99", "cannot be read"),
    ("a: " + "9" * 5000, "cannot be read"),
    ("a: [", "not valid YAML at line 1"),
    ("\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9) if k else 'x'}]" for k in range(12)), "without end"),
]


@pytest.mark.parametrize(("text", "words"), STRANGE, ids=range(len(STRANGE)))
def test_strange_yaml_is_refused_in_a_sentence(text, words):
    with pytest.raises(SettingsError, match=words):
        parse_yaml(text, "a.yaml")


def test_text_of_another_encoding_is_refused_with_its_line(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"name: a\nvalue: \xe9\n")
    with pytest.raises(SettingsError, match="not UTF-8 text at line 2"):
        read_text(tmp_path / "a.yaml")
    (tmp_path / "b.yaml").write_bytes(b"\xef\xbb\xbfname: a\n")
    assert read_text(tmp_path / "b.yaml") == "name: a\n"


INT, FLOAT = "baro.period_s", "gps.period_s"


@pytest.mark.parametrize("value", [float("inf"), float("nan"), 10**400, -(10**400), "1", None, [1], {"a": 1}, True])
def test_strange_numbers_are_refused_by_name(value):
    for name in (INT, FLOAT):
        with pytest.raises(SettingsError, match=rf"'{name.replace('.', '[.]')}|unknown setting"):
            from_mapping(InsGps.Settings, {name: value})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"magnetic": {"declination_deg": [1.0, 2.0, 3.0]}}, "takes one number or none"),
        ({"magnetic": {"decimal_year": 2005.0}}, "No magnetic model covers"),
        ({"magnetic": {"decimal_year": 2031.0}}, "at most 2030"),
        ({"aids": 5}, "must list the names"),
        ({"aids": [["gps"]]}, "must list the names"),
    ],
)
def test_settings_that_no_navigator_can_fly_are_refused(values, words):
    with pytest.raises(SettingsError, match=words):
        from_mapping(InsGps.Settings, values)


@pytest.mark.parametrize(
    ("node", "words"),
    [
        ({"executable": "ins_gps", "config": 5}, "must name a file"),
        ({"executable": ["ins_gps"]}, "unknown executable"),
        ({"executable": "ins_gps", "name": "../x"}, "must be letters, digits and _"),
        ({"executable": "ins_gps", "respawn": "yes"}, "must be true or false"),
    ],
)
def test_nodes_of_a_graph_that_cannot_be_run(node, words):
    with pytest.raises(GraphError, match=words):
        parse_graph({"nodes": [node]}, "graph")


def test_a_file_is_written_whole_or_not_at_all(tmp_path):
    write_text(tmp_path / "a.txt", "old")
    with pytest.raises(RuntimeError), written_whole(tmp_path / "a.txt") as place:
        place.write_text("half")
        raise RuntimeError("interrupted")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    with pytest.raises(SettingsError, match="Cannot write"), written_whole(tmp_path / "no" / "a.txt"):
        pass


@pytest.mark.parametrize(
    "words",
    [
        ["replay", "nowhere", "--json", "no/such/file"],
        ["report", "nowhere", "-o", "no/such/file"],
        ["simulate", "turns", "-o", "no/such/bag"],
        ["magcal", "nowhere.csv", "-o", "no/such/file"],
        ["allan", "nowhere.csv", "-o", "README.md/x"],
    ],
)
def test_outputs_that_cannot_be_written_are_refused_before_the_work(words, capsys, monkeypatch):
    monkeypatch.chdir(Path(__file__).resolve().parents[1])
    assert main(words) == 2
    assert words[-1].split("/")[0] in capsys.readouterr().err
