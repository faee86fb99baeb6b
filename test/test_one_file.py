"""A thing is described once, where it is defined: this file alone describes a radar altimeter and a navigator that uses it.

A message kind, its simulator, an aid and a navigator.  Named as a plugin it gets, and nothing else is edited: settings and parameter file,
ROS parameters, decoder, nodes, a place in a graph, a live run over Fast DDS that a replay repeats to the bit, diagnostics, a colour.
"""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids.gps import GPS
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.views import Place
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages.kind import BODY_FRAMES, TOPICS, TopicSpec, describe
from lowcostnav_ros.navigators.inertial import IMU, InertialNavigator, InertialSettings
from lowcostnav_ros.navigators.registry import NAVIGATORS, navigator
from lowcostnav_ros.sensors.registry import SIMULATORS, simulator
from lowcostnav_ros.sensors.sampling import SampleClock

# the message --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class RadarHeight(Measurement):
    """Height ``height_m`` above flat ground, ``variance`` m^2."""

    height_m: float
    variance: float


def decode(message, received):
    received.frame(message.header.frame_id)
    checks.finite((message.range,), "height")
    if not 0.0 <= message.range <= 2000.0:
        raise checks.Refusal("radar height implausible", f"{message.range:g} m")
    return RadarHeight(*received.head, message.range, received.variance(message.variance, "height"))


describe(
    __name__,
    TopicSpec("radar_altimeter/height", topics.RANGE, "Height above the ground.", "base_link", "m"),
    measurement=RadarHeight,
    decode=decode,
    encode=lambda m: parts.TYPES[topics.RANGE](
        parts.header(m.stamp_ns, "base_link"), 1, 0.0, 0.0, 2000.0, float(m.height_m), float(m.variance)
    ),
    frames=BODY_FRAMES,
    variances=(1.0,),
    sample=lambda at: RadarHeight(*at.head, 400.0, 1.0),
    sensed=True,
)

# its simulator ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RadarAltimeterSimulatorSettings:
    """A radar altimeter over flat ground."""

    seed: int = setting(1, "Seed.", minimum=0)
    rate_hz: float = setting(2.0, "Output rate.", unit="Hz", minimum=0.1, maximum=50.0)
    ground_m: float = setting(100.0, "Height of the ground.", unit="m")
    noise_m: float = setting(0.5, "White noise.", unit="m", minimum=0.0, maximum=10.0)


@simulator(
    "radar_altimeter", Settings=RadarAltimeterSimulatorSettings, truth=("truth/odometry",), topics=("radar_altimeter/height",)
)
class RadarAltimeterSimulator:
    def __init__(self, settings):
        self.settings, self.clock = settings, SampleClock(settings.rate_hz)
        self.rng = np.random.default_rng(settings.seed)

    def simulate(self, truth):
        own, rows = self.settings, self.clock.rows(truth.stamps_ns)
        heights = truth.height[rows] - own.ground_m + own.noise_m * self.rng.standard_normal(len(rows))
        source = "radar_altimeter/height"
        return [RadarHeight(int(truth.stamps_ns[r]), source, float(h), own.noise_m**2) for r, h in zip(rows, heights, strict=True)]


# an aid -------------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RadarAltimeterSettings(SensorSettings):
    """Radar height above flat ground."""

    ground_m: float = setting(100.0, "Height of the ground above the ellipsoid.", unit="m")
    period_s: float = setting(1.0, "Use at most one measurement in this time.", unit="s", minimum=0.0)
    gate: GateSettings = group(GateSettings)


class RadarHeightAid(Aid):
    """Height above the ground, m: y = h_radar + ground - h, H = -1 on down."""

    name, labels = "radar_height", ("height_m",)
    measurement, topic, views = RadarHeight, "radar_altimeter/height", (Place,)

    def innovation(self, measurement, host):
        H = np.zeros((1, host.layout.size))
        H[0, 2] = -1.0
        y = host.core.height_residual(measurement.height_m + self.settings.ground_m, 0.0)
        return Innovation(np.array([y]), H, np.array([[measurement.variance]]), np.array([measurement.height_m]))


RADAR_ALTIMETER = AIDS.register(
    "radar_altimeter", Sensor("radar_altimeter", RadarAltimeterSettings, each(RadarHeightAid)), __name__
)

# and a navigator that uses it -----------------------------------------------------------------------------------------------------


@navigator
class RadarNavigator(InertialNavigator):
    """GPS, an IMU and a radar altimeter."""

    name = "radar_navigator"
    colour = "#123abc"
    OwnSettings = InertialSettings
    sensors = (GPS, RADAR_ALTIMETER)
    needs = ("gps",)
    required = (IMU, "gps/fix", "gps/vel")


PLUGIN = Path(__file__).stem
if os.environ.get("LOWCOSTNAV_PLUGINS") != PLUGIN:  # other tests count what the package has of its own
    for registry in (TOPICS, SIMULATORS, AIDS, NAVIGATORS):
        registry.forget(__name__)

# what comes with it ---------------------------------------------------------------------------------------------------------------

ROOT = Path(__file__).resolve().parent.parent
GRAPH = {
    "scenario": "livermore",
    "lossless": True,
    "nodes": [
        {"executable": "truth_source", "parameters": {"kind": "segments", "name": "straight", "duration_s": 10.0}},
        "imu_simulator",
        "gps_simulator",
        {"executable": "radar_altimeter_simulator", "parameters": {"rate_hz": 5.0}},
        {"executable": "radar_navigator", "parameters": {"horizon.lag_s": 2.0, "radar_altimeter.period_s": 0.5}},
        "recorder",
    ],
}


@pytest.fixture
def plugged(monkeypatch):
    """Environment of processes that have this file as a plugin."""
    monkeypatch.setenv("LOWCOSTNAV_PLUGINS", PLUGIN)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'test'}")


def lowcostnav(*arguments):
    return subprocess.run([sys.executable, "-m", "lowcostnav_ros.cli", *arguments], capture_output=True, text=True)


def test_parameter_files_with_units(plugged):
    told = lowcostnav("parameters", "radar_navigator")
    assert "# Height of the ground above the ellipsoid [m" in told.stdout, told.stderr
    values = yaml.safe_load(told.stdout)["/**"]["ros__parameters"]
    assert values["radar_altimeter"]["ground_m"] == 100.0 and values["aids"] == ["gps", "radar_altimeter"]
    assert "# White noise [m; 0 to 10]" in lowcostnav("parameters", "radar_altimeter_simulator").stdout


def test_an_unknown_parameter_is_refused_by_the_node_with_the_nearest(plugged):
    pytest.importorskip("rclpy")
    told = lowcostnav("run", "radar_navigator", "--ros-args", "-p", "radar_altimeter.grund_m:=90.0")
    assert told.returncode == 2 and "did you mean 'radar_altimeter.ground_m'" in told.stderr


def test_any_other_navigator_takes_the_aid_by_configuration(plugged):
    code = (
        "from lowcostnav_ros.base.settings import from_mapping\n"
        "from lowcostnav_ros.navigators.ins_gps import InsGps\n"
        "ins = InsGps(from_mapping(InsGps.Settings, {'aids': ['gps', 'baro', 'radar_altimeter']}))\n"
        "print(ins.aid('radar_height').labels, 'radar_altimeter/height' in ins.inputs)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert told.stdout == "('height_m',) True\n", told.stderr


FLY = """
import json, sys
from pathlib import Path
from lowcostnav_ros.graph.description import parse_graph
from lowcostnav_ros.graph.runner import GraphRunner
out = Path(sys.argv[1])
with GraphRunner(parse_graph(json.loads(sys.argv[2]), "one_file"), out=out, log_dir=out / "log") as runner:
    finished = runner.wait_until_finished(120.0)
print(json.dumps([finished, list(map(str, runner.events)), runner.counts(), runner.rows]))
"""


@pytest.mark.timeout(240)
def test_live_over_fast_dds_replayed_to_the_bit_with_diagnostics_and_a_report(plugged, tmp_path):
    pytest.importorskip("rclpy")
    flown = subprocess.run([sys.executable, "-c", FLY, str(tmp_path), json.dumps(GRAPH)], capture_output=True, text=True)
    assert flown.returncode == 0, flown.stderr
    finished, events, counts, rows = json.loads(flown.stdout)
    counts = counts["radar_altimeter/height"]
    assert finished and not events
    assert counts["sent"] == counts["radar_navigator"] >= 50
    assert rows["radar_navigator: aid radar_height"]["values"]["fused"] != "0"
    assert rows["radar_navigator: navigator"]["values"]["mode"] == "gps"
    result = lowcostnav("replay", str(tmp_path / "recording"), "--json", str(tmp_path / "result.json"), "--out", str(tmp_path / "result"))
    assert result.returncode == 0, result.stderr
    found = json.loads((tmp_path / "result.json").read_text())["navigators"]["radar_navigator"]
    assert found["fused"]["equals_recorded"] and found["fused"]["count_equal"] > 30
    assert found["aids"]["radar_height"]["used"] >= 10 and found["inputs"]["radar_altimeter/height"]["received"] >= 50
    page = lowcostnav("report", str(tmp_path / "result"), "-o", str(tmp_path / "report.html"))
    assert page.returncode == 0 and "#123abc" in (tmp_path / "report.html").read_text(), page.stderr
