"""Tuning: the true noise numbers come back from a simulated flight within the uncertainty that is stated."""

import math
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import AirVelocity, Attitude, GpsPosition, GpsVelocity
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.cores.noise_levels import NoiseLevels
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning, DeadReckoningSettings
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.report.outages.tuning import tuning_page
from lowcostnav_ros.studies.outages.result import End, Flown, Outage, OutageStudy
from lowcostnav_ros.studies.tuning import fit as fitting
from lowcostnav_ros.studies.tuning.likelihood import Flight, Source, innovations
from lowcostnav_ros.studies.tuning.study import Tuned

SECOND = 1_000_000_000
TRUE = {"wind.gust_mps": 0.5, "heading.bias_deg": 8.0}


def flight(seed, seconds=240, speed=20.0, turn_dps=4.0):
    """Circles at 20 m/s in a wind of 3 and -2 m/s with turbulence over 300 m and a heading error over 120 s; everything once a second."""
    rng = np.random.default_rng(seed)
    place, before, gust, error, out = (0.65, -2.1, 500.0), None, rng.normal(0.0, TRUE["wind.gust_mps"], 2), 0.0, []
    decay, slow = math.exp(-speed / 300.0), math.exp(-1.0 / 120.0)
    for k in range(seconds):
        stamp, heading = k * SECOND, math.radians(turn_dps * k)
        gust = decay * gust + TRUE["wind.gust_mps"] * math.sqrt(1.0 - decay**2) * rng.standard_normal(2)
        error = slow * error + math.radians(TRUE["heading.bias_deg"]) * math.sqrt(1.0 - slow**2) * rng.standard_normal()
        vel = np.array([speed * math.cos(heading) + 3.0 + gust[0], speed * math.sin(heading) - 2.0 + gust[1], 0.0])
        place, before = displace(*place, 0.5 * (vel + (vel if before is None else before)) * (k > 0)), vel
        seen = heading - error
        q = np.array([math.cos(seen / 2), 0.0, 0.0, math.sin(seen / 2)])
        rate = np.array([0.0, 0.0, math.radians(turn_dps)])
        unknown = np.diag([0.1, 1e6, 1e6])
        out.append(Attitude(stamp, "imu/data_fused", q, 1e-4 * np.eye(3), rate, None))
        out.append(AirVelocity(stamp, "air/velocity", np.array([speed, 0.0, 0.0]), unknown))
        fix = displace(*place, rng.normal(0.0, 1.5, 3))
        out.append(GpsPosition(stamp, "gps/fix", *fix, 2.25 * np.eye(3)))
        out.append(GpsVelocity(stamp, "gps/vel", vel + rng.normal(0.0, 0.1, 3), 0.01 * np.eye(3)))
    return out


def settings(**changes):
    plain = {"heading.noise_deg": 0.1, "airspeed.noise_mps": 0.05, "airspeed.bias_mps": 0.1, "wind.sigma_mps": 0.05, "wind.mean_mps": 5.0}
    slow = {"heading.timeout_s": 3.0, "horizon.output_period_s": 1.0, "airspeed.timeout_s": 4.0}
    return from_mapping(DeadReckoningSettings, plain | slow | changes)


@pytest.fixture(scope="module")
def flown():
    measurements = flight(3)
    return Flight(DeadReckoning, settings(), measurements, 0, 1 + int(1e-9 * measurements[-1].stamp_ns / 10.0))


class Here(fitting.Trials):
    """Trials in this process, of some numbers."""

    def __init__(self, flown, names):
        self.reference, self._flown, self._known = [innovations(flown, {})], flown, {}
        self._advance, self._done = None, 0
        self._pool = self._fly = self
        self.parameters = [p for p in fitting.tunables(flown.settings, self.reference[0].groups) if p.name in names]

    def map(self, _, changes):
        return [[innovations(self._flown, c)] for c in changes]


def test_the_true_numbers_come_back_within_the_stated_uncertainty(flown):
    trials = Here(flown, TRUE)
    assert [p.name for p in trials.parameters] == ["heading.bias_deg", "wind.gust_mps"]
    everything = np.ones(len(trials.count()))
    found = fitting.fit(trials, everything, np.zeros(2), 12)
    assert found.gain > 15.0
    for parameter, x, sigma in zip(trials.parameters, found.x, found.sigma(), strict=True):
        off = math.log(parameter.at(x) / TRUE[parameter.name])
        assert sigma < 0.4, parameter.name
        assert abs(off) < 3.0 * sigma, (parameter.name, parameter.at(x), sigma)


def test_scores_that_scatter_more_than_the_likelihood_curves_promise_nothing():
    prior = np.array([1.0, 1.0])
    J = np.array([[400.0, 60.0], [60.0, 900.0]])
    fits = fitting.misspecified(J + np.eye(2), np.diag(J), prior)
    assert fits == pytest.approx(np.linalg.inv(J + np.eye(2)))
    flat = fitting.misspecified(J + np.eye(2), np.diag(J) / 100.0, prior)
    bread = np.linalg.inv(J / 100.0 + np.eye(2))
    assert flat == pytest.approx(bread @ (J + np.eye(2)) @ bread)
    assert np.all(np.diag(fitting.misspecified(J + np.eye(2), np.array([-5.0, 0.0]), prior)) > 1.0)  # says less than the prior


def test_fewer_innovations_are_no_gain(flown):
    usual = innovations(flown, {})
    fewer = innovations(flown, {"gps.gate.probability": 0.5, "gps.period_s": 5.0})
    assert fewer.count.sum() < 0.3 * usual.count.sum()
    assert fewer.against(usual).sum() < usual.against(usual).sum()


def test_the_levels_that_a_flight_shows_are_learned(flown):
    navigator = DeadReckoning(settings())
    navigator.feed_all(flown.measurements)
    learned = navigator.core.levels.factors
    assert learned["heading_bias"] * 2.5 == pytest.approx(TRUE["heading.bias_deg"], rel=0.6)
    assert learned["gust"] == pytest.approx(TRUE["wind.gust_mps"], rel=0.3)
    assert navigator.layout.psd[navigator.layout["gust"]] == pytest.approx(2.0 * learned["gust"] ** 2 * 20.0 / 300.0, rel=0.05)


def test_levels_stay_at_one_without_evidence_and_where_nothing_is_to_be_learned():
    layout = DeadReckoning().layout
    levels = NoiseLevels(layout, 0.0)
    assert not levels.wants(0)
    assert set(levels.factors.values()) == {1.0}
    assert np.all(layout.level == 1.0)


def test_numbers_that_may_be_tuned_are_declared_and_stay_in_their_range():
    found = {p.name: p for p in fitting.tunables(DeadReckoningSettings(), frozenset({"gps"}))}
    assert "baro.sigma_m" not in found  # no innovations
    gust = found["wind.gust_mps"]
    assert gust.at(0.0) == 1.0
    assert gust.at(100.0) == 20.0
    assert gust.at(-100.0) == pytest.approx(1.0 / 27.0)


def outage_study(errors):
    """Outages of 60 s with the settings to begin with and the tuned ones: errors and sigmas by windows."""

    def flown(settings, ends):
        each = enumerate(End(60.0, e, 0.0, 0.0, e, s, e / s, None, None, {}, {}) for e, s in ends)
        outages = tuple(Outage(60.0 * k, 60.0 * k, 0.0, 0.0, (end,), (), (), ()) for k, end in each)
        return Flown("dead_reckoning", settings, "", outages)

    pair = tuple(flown(*one) for one in zip(("shipped", "tuned"), errors, strict=True))
    return OutageStudy("bag", "", 0.0, 600.0, "", (), (60.0,), 60.0, (), {}, pair, ())


def test_tuned_is_better_where_both_likelihood_and_outages_are():
    gust = next(p for p in fitting.tunables(DeadReckoningSettings(), frozenset({"gps"})) if p.name == "wind.gust_mps")
    found = fitting.Fit(np.array([math.log(2.0)]), np.array([[0.01]]), 9.0)
    source = Source(Path("bag"), "dead_reckoning", ("dead_reckoning",), Path("config"))

    def tuned(judged, *errors):
        return Tuned(source, [gust], found, found, judged, 40, [outage_study(errors)] if errors else [])

    page = tuning_page(tuned(3.5))
    assert "1 of 1 numbers of dead_reckoning are told by the recordings. Better on" in page and "wind.gust_mps" in page
    assert not tuned(-1.0).is_better and tuned(-1.0).verdict().startswith("Not better")
    nearer = tuned(3.5, [(30.0, 60.0), (40.0, 60.0)], [(20.0, 60.0), (30.0, 60.0)])
    assert nearer.is_better
    assert "2 outages of 60 s: 35.4 m RMS before, 25.5 m tuned, error over sigma 0.59 before, 0.42 tuned" in nearer.verdict()
    further = tuned(3.5, [(30.0, 60.0), (40.0, 60.0)], [(31.0, 60.0), (41.0, 60.0)])
    assert not further.is_better and "log-likelihood +3.5" in further.verdict()
    assert not tuned(3.5, [(30.0, 60.0)], [(29.0, 10.0)]).is_better  # nearer, and sure of more than that
