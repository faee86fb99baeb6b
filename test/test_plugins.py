"""What a plugin defines is found by its name wherever the package's own is; what only needs a name imports no compiler."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lowcostnav_ros.graph.executables import EXECUTABLES, needs_compiler

ROOT = Path(__file__).resolve().parent.parent
PLUGIN = '''
"""A second receiver, and a navigator that believes it."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.sensors.registry import simulator


@dataclass(frozen=True)
class SecondSettings:
    """Settings of the second receiver."""

    seed: int = setting(1, "Seed.", minimum=0)
    rate_hz: float = setting(2.0, "Output rate.", unit="Hz", minimum=0.1, maximum=10.0)


@simulator("second", Settings=SecondSettings, truth=("truth/odometry",), topics=("gps/fix",))
class Second:
    def __init__(self, settings):
        self.settings = settings

    def simulate(self, truth):
        return []


@executable("listener", inputs=("gps/fix",), compiled=False)
class Listener:
    pass


def define():
    from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
    from lowcostnav_ros.base.settings import group

    @dataclass(frozen=True)
    class BelieverSettings:
        """Settings of the believer."""

        horizon: HorizonSettings = group(HorizonSettings)

    @navigator
    class Believer(Navigator):
        name = "believer"
        Settings = BelieverSettings
        colour = "#123456"
        modes = {"doubting": ("#654321", "without faith")}
        inputs = {"gps/fix": True}

        def _fuse(self, item):
            pass

        def _predict(self):
            return None

        def _restart(self):
            pass

        def _sigmas(self):
            return {}


define()
'''


@pytest.fixture
def plugged(tmp_path):
    """Run Python code in a process that has the plugin; return what it prints."""
    (tmp_path / "second_receiver.py").write_text(PLUGIN)
    environment = {**os.environ, "LOWCOSTNAV_PLUGINS": "second_receiver", "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}

    def run(*command: str) -> subprocess.CompletedProcess:
        return subprocess.run([sys.executable, *command], env=environment, capture_output=True, text=True, cwd=tmp_path)

    return run


def test_executables_of_a_plugin_have_parameter_files_and_are_valid_in_a_graph(plugged):
    told = plugged("-m", "lowcostnav_ros.cli", "parameters", "second_simulator")
    assert "# Output rate [Hz; 0.1 to 10]\n    rate_hz: 2.0" in told.stdout, told.stderr
    assert "horizon:" in plugged("-m", "lowcostnav_ros.cli", "parameters", "believer").stdout
    code = (
        "import json; from lowcostnav_ros.graph import description, wiring\n"
        "nodes = ['truth_source', 'second_simulator', 'listener', 'believer', 'recorder']\n"
        "graph = description.parse_graph({'scenario': 'livermore', 'nodes': nodes}, 'x')\n"
        "print(json.dumps([wiring.expected_subscribers(graph), wiring.shared_parameters(graph, graph.nodes[1])['scenario'],"
        " sorted(wiring.flown_settings(graph)), wiring.recorded_topics()]))"
    )
    told = plugged("-c", code)
    expected, scenario, flown, recorded = json.loads(told.stdout)
    assert "truth/odometry:2" in expected and "gps/fix:3" in expected  # the recorder, the listener and the believer
    assert scenario == "livermore" and flown == ["believer"] and "believer/odometry_fused" in recorded


def test_a_scenario_has_a_section_for_the_simulator_of_a_plugin_and_reports_its_colours(plugged):
    code = (
        "from lowcostnav_ros.simulation.scenario import scenario_from_text\n"
        "from lowcostnav_ros.simulation.equipment import build\n"
        "from lowcostnav_ros.report.flight.figures import colour_of\n"
        "from lowcostnav_ros.navigators.registry import known_modes\n"
        "scenario = scenario_from_text('{seed: 4, sensors: [imu, second], second: {rate_hz: 5.0}}')\n"
        "print(scenario.second, type(build('second', scenario.second)).__name__, colour_of('believer', ['believer']),"
        " known_modes()['doubting'])"
    )
    told = plugged("-c", code)
    assert told.stdout == "SecondSettings(seed=4, rate_hz=5.0) Second #123456 ('#654321', 'without faith')\n", told.stderr


def test_the_simulator_of_a_plugin_runs_as_a_node(plugged):
    pytest.importorskip("rclpy")
    told = plugged("-m", "lowcostnav_ros.cli", "run", "second_simulator", "--ros-args", "-p", "rate_hz:=900.0")
    assert told.returncode == 2 and "second_simulator: 'rate_hz' must be at least 0.1 and at most 10 Hz" in told.stderr


def test_a_name_that_is_taken_and_a_plugin_that_is_not_there_are_refused(plugged, tmp_path):
    (tmp_path / "second_receiver.py").write_text(PLUGIN.replace('"second"', '"gps"'))
    told = plugged("-m", "lowcostnav_ros.cli", "parameters", "gps_simulator")
    assert told.returncode == 2 and "Two modules define the sensor 'gps'" in told.stderr
    (tmp_path / "second_receiver.py").write_text("import nothing_of_this_name")
    told = plugged("-m", "lowcostnav_ros.cli", "parameters", "gps_simulator")
    assert told.returncode == 2 and "cannot be imported" in told.stderr and "Traceback" not in told.stderr


@pytest.mark.parametrize(
    ("text", "fault", "place"),
    [
        ("x = 1\ny = not_defined\n", "NameError: name 'not_defined' is not defined", "second_receiver.py line 2"),
        ("def f(:\n", "SyntaxError: ", "second_receiver.py, line 1"),
    ],
)
def test_a_plugin_that_fails_is_named_with_the_line_to_correct(plugged, tmp_path, text, fault, place):
    (tmp_path / "second_receiver.py").write_text(text)
    told = plugged("-m", "lowcostnav_ros.cli", "parameters", "gps_simulator")
    assert told.returncode == 2 and "The plugin 'second_receiver'" in told.stderr and "Traceback" not in told.stderr
    assert fault in told.stderr and place in told.stderr


def test_names_labels_and_light_nodes_need_no_compiler():
    pytest.importorskip("rclpy")
    light = [name for name in EXECUTABLES.own() if not needs_compiler(name)]
    others = {"monitor", "player", "recorder", "air_data_computer", "page", "display", "foxglove"}
    others |= {f"{name}_driver" for name in ("nmea", "mavlink", "crossbow", "arinc", "dme", "csv", "netfix")}
    others |= {f"{name}_output" for name in ("gdl90", "nmea", "xplane", "netfix")}
    assert {name for name in light if not name.endswith("_simulator")} == others
    code = (
        "import os, sys\n"
        "os.environ['LOWCOSTNAV_KERNELS'] = 'interpreted'\n"
        "from lowcostnav_ros.catalogue.navigator_topics import topics_of\n"
        "from lowcostnav_ros.graph.wiring import recorded_topics\n"
        "from lowcostnav_ros.nodes import dispatch\n"
        "assert 'nav/odometry' in topics_of('supervisor') and topics_of('ahrs')[0] == 'imu/data' and recorded_topics()\n"
        f"for name in {light}: dispatch.maker(name)\n"
        "assert 'numba' not in sys.modules and 'lowcostnav_ros.navigators.base' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
