"""The files that are written from the code say what the code declares: config/<executable>.yaml (``make config``)."""

from pathlib import Path

import pytest

from lowcostnav_ros.catalogue.config_files import read_parameters
from lowcostnav_ros.graph.executables import EXECUTABLES, NODES, parameter_file

CONFIG = Path(__file__).resolve().parent.parent / "config"
FILES = sorted(path.stem for path in CONFIG.glob("*.yaml"))


def test_every_executable_but_the_monitor_has_a_parameter_file():
    assert sorted(set(EXECUTABLES.own()) - {"monitor"}) == FILES


@pytest.mark.parametrize("name", FILES)
def test_a_parameter_file_is_what_the_code_declares(name):
    if name in NODES:
        pytest.importorskip("rclpy")
    assert (CONFIG / f"{name}.yaml").read_text(encoding="utf-8") == parameter_file(name), "run make config"


def test_a_value_that_is_shipped_and_is_not_the_default_is_in_the_file():
    from lowcostnav_ros.graph.executables import settings_of

    assert settings_of("dead_reckoning")().dme.stations_file == ""
    assert read_parameters(CONFIG / "dead_reckoning.yaml")["dme.stations_file"] == "dme_stations_bay_area.csv"
