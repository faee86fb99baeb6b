"""The package as pip and colcon see it: every executable has a wrapper, an entry point and a module, the metadata is valid."""

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from lowcostnav_ros.graph.wiring import EXECUTABLES

ROOT = Path(__file__).resolve().parent.parent


def setup_constant(name: str):
    for node in ast.parse((ROOT / "setup.py").read_text()).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == name:
            return ast.literal_eval(node.value)
    raise AssertionError(name)


def test_every_executable_has_module_entry_point_and_wrapper():
    assert sorted(setup_constant("NODES")) == sorted(EXECUTABLES)
    assert sorted(p.name for p in (ROOT / "scripts").iterdir()) == sorted(EXECUTABLES)
    for name in EXECUTABLES:
        wrapper = ROOT / "scripts" / name
        assert os.access(wrapper, os.X_OK) and f"from lowcostnav_ros.nodes.{name} import main" in wrapper.read_text()
        module = (ROOT / "lowcostnav_ros" / "nodes" / f"{name}.py").read_text()
        assert 'if __name__ == "__main__":\n    sys.exit(main())' in module


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


def test_the_installed_files_hold_every_configuration():
    listing = (
        "import setuptools, json; seen = {}; setuptools.setup = lambda **k: seen.update(k); "
        "exec(open('setup.py').read()); print(json.dumps(seen['data_files']))"
    )
    out = subprocess.run([sys.executable, "-c", listing], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    installed = {f for _, files in json.loads(out) for f in files}
    shipped = {str(p.relative_to(ROOT)) for p in (ROOT / "config").rglob("*") if p.suffix in (".yaml", ".csv")}
    assert shipped <= installed and "resource/lowcostnav_ros" in installed and "launch/lowcostnav.launch.py" in installed


def test_the_launch_file_says_what_to_use_where_ros2_launch_is_missing():
    if importlib.util.find_spec("launch_ros") is not None:
        pytest.skip("ros2 launch is installed")
    spec = importlib.util.spec_from_file_location("launch_file", ROOT / "launch" / "lowcostnav.launch.py")
    with pytest.raises(ImportError, match="lowcostnav up"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


def test_pinned_versions_are_those_of_the_ros_extra():
    pinned = set(re.findall(r"^(ros-[\w-]+==[\d.]+)", (ROOT / "requirements.txt").read_text(), re.M))
    assert pinned == set(re.findall(r'"(ros-[\w-]+==[\d.]+)"', (ROOT / "setup.py").read_text())) and len(pinned) == 3
