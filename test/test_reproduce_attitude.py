"""The attitude results: registered, with the expected verdict in a quick run, and drawn."""

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from lowcostnav_ros.reproduce import registry
from lowcostnav_ros.reproduce.gebre.attitude_switch import FIBRE_OPTIC, VIBRATING, fly, turning_flight
from lowcostnav_ros.studies.attitude_filters import HEADING_SWITCH, OPEN_LOOP, RATE_SWITCH

matplotlib.use("agg")
ALL = [f"GR{k}" for k in range(23, 33)]


def test_all_are_registered_once():
    known = {entry.id: entry for entry in registry.all_results()}
    assert set(ALL) <= set(known)
    assert all(known[name].study == "gebre" and known[name].tolerance for name in ALL)


@pytest.mark.parametrize("name", ["GR24", "GR25", "GR27", "GR28", "GR29", "GR30"])
def test_quick_run_reproduces_and_draws(name):
    (entry,) = registry.selected([name])
    outcome = entry.function(registry.Context(quick=True))
    assert outcome.verdict == (registry.DIFFERS if name == "GR30" else registry.REPRODUCED), outcome.ours
    figure = Figure()
    outcome.figure(figure)
    assert figure.axes


def test_turning_flight_is_coordinated_and_consistent():
    angles, rates, forces = turning_flight(60.0)
    np.testing.assert_allclose(np.cumsum(rates[:, 0]) / 20.0, angles[:, 0], atol=0.01)
    assert np.degrees(np.abs(angles[:, 0]).max()) == pytest.approx(20.0)
    vertical = forces[:, 2] * np.cos(angles[:, 0])  # lift holds the weight, but for half a sample of roll
    np.testing.assert_allclose(vertical, -9.80665, rtol=0.005)
    assert forces[1200:][:, 2].min() == pytest.approx(-9.80665 / np.cos(np.radians(20.0)), rel=1e-6)


@pytest.mark.parametrize("gyros", [VIBRATING, FIBRE_OPTIC])
def test_switch_on_body_rates_beats_the_heading_s_and_the_open_loop(gyros):
    runs = {f: fly(gyros, f, np.random.default_rng(4), 60.5).rms_roll() for f in (OPEN_LOOP, HEADING_SWITCH, RATE_SWITCH)}
    assert runs[RATE_SWITCH] < 0.5 * runs[HEADING_SWITCH]
    assert runs[RATE_SWITCH] < 0.5 * runs[OPEN_LOOP]
