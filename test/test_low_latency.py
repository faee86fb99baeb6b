"""The low-latency outputs are as honest as the fused ones, in turns, aerobatics and with inertial samples lost."""

import sys
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.trajectory import StartSettings, TruthSettings, build

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
low_latency = pytest.importorskip("low_latency")

TURNS = """
truth:
  mission: ["straight duration_s=15", "turn by_deg=120 bank_deg=45", "turn by_deg=-120 bank_deg=45", "straight duration_s=3"]
  wind: {north_mps: -4.0, east_mps: 6.0, turbulence_sigma_mps: 0.5}
"""


@pytest.mark.parametrize(("flight", "drop"), [("turns", 0.3), ("aerobatics", 0.0)])
def test_outputs_are_inside_their_sigmas(flight, drop, monkeypatch):
    monkeypatch.setitem(low_latency.FLIGHTS, "turns", TURNS)
    short = low_latency.FLIGHTS["aerobatics"].replace("aerobatics,", "aerobatics, duration_s: 80.0,")
    monkeypatch.setitem(low_latency.FLIGHTS, "aerobatics", short)
    ratios = low_latency.outputs(flight, 2, drop=drop)
    for name in low_latency.NAMES:
        found = low_latency.summary([ratios[name]])
        for part in low_latency.PARTS:
            if part in found:  # three components at once, strongly correlated over so short a flight
                assert found[part]["beyond_3_sigma"] < 0.04, (name, part, found[part])
                assert found[part]["beyond_6_sigma"] < 0.005, (name, part, found[part])


def test_the_aerobatic_flight_loops_rolls_and_pulls_five_g():
    truth = build(TruthSettings(kind="aerobatics", start=StartSettings(height_m=1500.0, airspeed_mps=80.0))).table()
    load = -truth.specific_force_b[:, 2] / 9.80665
    assert load.max() > 4.8 and load.min() < -0.8
    up = 1.0 - 2.0 * (truth.q_nb[:, 1] ** 2 + truth.q_nb[:, 2] ** 2)  # of the body z axis: -1 inverted
    assert np.mean(up < -0.9) > 0.05
    assert np.abs(truth.specific_force_b[:, 1]).max() < 0.5  # coordinated
    assert np.degrees(np.abs(truth.angular_rate_b)).max() > 100.0
    assert np.ptp(truth.height) < 400.0
