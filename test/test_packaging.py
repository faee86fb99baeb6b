"""The package as pip and colcon see it: every executable is installed and finds itself by its name, the metadata is valid."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import types
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.executables import EXECUTABLES, settings_of

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> dict:
    """What setup.py hands to setuptools, in a copy of the files that it reads."""
    folder = tmp_path_factory.mktemp("package")
    for name in ("setup.py", "config", "launch", "resource", "package.xml"):
        (folder / name).symlink_to(ROOT / name)
    listing = (
        "import setuptools, json; seen = {}; setuptools.setup = lambda distclass, **k: seen.update(k); "
        "exec(open('setup.py').read()); print(json.dumps(seen))"
    )
    out = subprocess.run([sys.executable, "-c", listing], cwd=folder, capture_output=True, text=True, check=True).stdout
    return {"folder": folder, **json.loads(out)}


def test_every_executable_is_installed_where_ros2_run_looks_and_only_the_command_line_on_the_path(installed):
    own = [name for name in EXECUTABLES.own() if settings_of(name) is not None or name == "monitor"]
    files = [file for folder, files in installed["data_files"] if folder == "lib/lowcostnav_ros" for file in files]
    assert sorted(Path(file).name for file in files) == sorted(own) == sorted(EXECUTABLES.own())
    assert all(os.access(installed["folder"] / file, os.X_OK) for file in files)
    assert installed["entry_points"] == {"console_scripts": ["lowcostnav = lowcostnav_ros.cli.main:main"]}


def test_an_executable_knows_by_its_name_what_to_run(installed, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    (script,) = (file for _, files in installed["data_files"] for file in files if Path(file).name == "gps_simulator")
    (tmp_path / "radar_simulator").symlink_to(installed["folder"] / script)
    unknown = subprocess.run([sys.executable, tmp_path / "radar_simulator"], env=environment, capture_output=True, text=True)
    assert unknown.returncode == 2 and unknown.stderr.startswith("There is no executable 'radar_simulator' (did you mean")
    pytest.importorskip("rclpy")
    known = [sys.executable, installed["folder"] / script, "--ros-args", "-p", "rate_hz:=900.0"]
    refused = subprocess.run(known, env=environment, capture_output=True, text=True)
    assert refused.returncode == 2 and "gps_simulator: 'rate_hz' must be at least 0.1" in refused.stderr


def test_package_xml_is_valid_and_agrees_with_setup():
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert package.get("format") == "3" and package.findtext("name") == "lowcostnav_ros"
    assert package.findtext("export/build_type") == "ament_python"
    assert re.fullmatch(r"[^@\s]+@[\w-]+(\.[\w-]+)+", package.find("maintainer").get("email"))
    versions = {package.findtext("version"), re.search(r'version="([\d.]+)"', (ROOT / "setup.py").read_text()).group(1)}
    from lowcostnav_ros import __version__

    assert versions == {__version__}
    used = {m for f in (ROOT / "lowcostnav_ros").rglob("*.py") for m in re.findall(r"^\s*from (\w+_msgs|std_srvs)\.", f.read_text(), re.M)}
    assert used <= {element.text for element in package.findall("exec_depend")}


def test_the_installed_files_hold_every_configuration(installed):
    files = {f for _, files in installed["data_files"] for f in files}
    shipped = {str(p.relative_to(ROOT)) for p in (ROOT / "config").rglob("*") if p.suffix in (".yaml", ".csv", ".json", ".xml", ".service")}
    assert installed["package_data"] == {"lowcostnav_ros.report": ["*.css", "*.js"], "lowcostnav_ros.graph.page": ["assets/*"]}
    assert shipped <= files and "resource/lowcostnav_ros" in files and "launch/lowcostnav.launch.py" in files


def test_the_launch_file_says_what_to_use_where_ros2_launch_is_missing():
    if importlib.util.find_spec("launch_ros") is not None:
        pytest.skip("ros2 launch is installed")
    spec = importlib.util.spec_from_file_location("launch_file", ROOT / "launch" / "lowcostnav.launch.py")
    with pytest.raises(ImportError, match="lowcostnav up"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


def test_the_launch_file_starts_the_nodes_of_a_graph_with_its_arguments(monkeypatch):
    class Made:
        def __init__(self, *args, **kwargs):
            self.args, self.kwargs = args, kwargs

    class Context:
        launch_configurations = {}

    names = ("launch", "launch.actions", "launch_ros", "launch_ros.actions")
    modules = {name: types.ModuleType(name) for name in names}
    modules["launch"].LaunchDescription = modules["launch_ros.actions"].Node = Made
    for name in ("DeclareLaunchArgument", "OpaqueFunction", "SetEnvironmentVariable"):
        setattr(modules["launch.actions"], name, type(name, (Made,), {}))
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("launch_file", ROOT / "launch" / "lowcostnav.launch.py")
    launch_file = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(launch_file)
    (entries,) = launch_file.generate_launch_description().args
    defaults = {one.args[0]: one.kwargs["default_value"] for one in entries if "default_value" in one.kwargs}
    Context.launch_configurations = defaults | {"graph": "sensors_only", "namespace": "plane1", "page": "false", "params_file": "mine.yaml"}
    nodes = {node.kwargs["name"]: node.kwargs for node in launch_file._nodes(Context)}
    assert {node.name for node in load_graph("sensors_only").nodes} <= set(nodes) and "page" not in nodes
    gps = nodes["gps_simulator"]
    assert gps["namespace"] == "plane1" and gps["parameters"][-2:] == [{"use_sim_time": False}, "mine.yaml"]
    assert any(isinstance(one, dict) and one.get("scenario") == load_graph("sensors_only").scenario for one in gps["parameters"])
    Context.launch_configurations = defaults | {"graph": "sensors_only"}
    assert "page" in {node.kwargs["name"] for node in launch_file._nodes(Context)}


def test_pinned_versions_are_those_of_the_ros_extra():
    pinned = set(re.findall(r"^(ros-[\w-]+==[\d.]+)", (ROOT / "requirements.txt").read_text(), re.M))
    assert pinned == set(re.findall(r'"(ros-[\w-]+==[\d.]+)"', (ROOT / "setup.py").read_text())) and len(pinned) == 3


def test_the_citation_and_the_container_for_developers_agree_with_the_package():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert (citation["version"], citation["license"]) == (package.findtext("version"), package.findtext("license"))
    assert citation["authors"][0]["email"] == package.find("maintainer").get("email")
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())
    made = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.M)
    assert container["postCreateCommand"].removeprefix("make ") in made
