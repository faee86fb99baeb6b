"""Satellites alone: prediction against closed forms and Van Loan, consistency of PV and PVA, holding back, contradiction, restart."""

import dataclasses

import numpy as np
import pytest
from drawn_motion import drawn_motion
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.cores.motion import MotionCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import GateSettings
from lowcostnav_ros.estimation.consistency import acceptance_band
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.navigators.gnss_only import GnssOnly, GnssOnlySettings, motion_blocks
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic, geodetic_to_ecef
from lowcostnav_ros.reproduce.solimeno.flights import Case, epochs_of, flight_of, gps_only_settings, truth_of

SHORT_S = 100.0
PV, PVA = (Case(model, "HD", duration_s=SHORT_S) for model in ("pv", "pva"))


def flown(case=PVA, change=lambda e: e):
    truth = truth_of(case.dataset, case.duration_s)
    navigator = GnssOnly(gps_only_settings(case))
    solutions = navigator.feed_all(e for e in map(change, epochs_of(case, truth)) if e is not None)
    return navigator, flight_of(truth, solutions)


@pytest.mark.parametrize(("model", "size"), [("pv", 8), ("pva", 11)])
def test_covariance_equals_van_loan_over_a_second(model, size):
    choice = GnssOnlySettings(model=model)
    layout = Layout(motion_blocks(choice))
    core = MotionCore(layout)
    core.start(0, (0.6, 0.1, 100.0), np.zeros(3))
    before = core.P.copy()
    for k in range(1, 11):
        core.advance(k * 100_000_000)
    Phi, Qd = kalman.van_loan(core.dynamics(), np.diag(layout.psd), 1.0)
    assert layout.size == size
    np.testing.assert_allclose(core.P, Phi @ before @ Phi.T + Qd, rtol=1e-3, atol=1e-3)


def test_the_thesis_s_tuning_lets_the_position_wander_by_six_and_ninety_square_metres_a_second():
    grown = {}
    for tuning in ("thesis", "consistent"):
        core = MotionCore(Layout(motion_blocks(GnssOnlySettings(model="pv", tuning=tuning))))
        core.start(0, (0.6, 0.1, 100.0), np.zeros(3))
        core.advance(1_000_000_000)
        grown[tuning] = np.diag(core.P)[:3]
    np.testing.assert_allclose(grown["thesis"] - grown["consistent"], [6.0, 6.0, 90.0], rtol=1e-9)


@settings(deadline=None, max_examples=25)
@given(lat=st.floats(-1.4, 1.4), v=st.lists(st.floats(-150.0, 150.0), min_size=3, max_size=3))
def test_a_steady_velocity_is_a_straight_line_in_space(lat, v):
    """Velocity in n turns with n, so that in ECEF the motion is uniform: the oracle is one multiplication."""
    core = MotionCore(Layout(motion_blocks(GnssOnlySettings(model="pv"))))
    core.start(0, (lat, 0.4, 1000.0), np.array(v))
    start_e, velocity_e = geodetic_to_ecef(lat, 0.4, 1000.0), dcm_ne(lat, 0.4).T @ np.array(v)
    core.advance(30_000_000_000)
    end = ecef_to_geodetic(start_e + 30.0 * velocity_e)
    off = geodetic_to_ecef(*core.nav[:3]) - geodetic_to_ecef(*end)
    assert np.linalg.norm(off) < 0.1
    assert dcm_ne(*core.nav[:2]).T @ core.nav[3:6] == pytest.approx(velocity_e, abs=2e-3)


@pytest.mark.parametrize("case", [PV, PVA])
def test_errors_stay_inside_their_sigmas(case):
    flights = [flown(dataclasses.replace(case, seed=seed))[1] for seed in range(4)]
    scores = np.mean([f.nees[100:].mean(axis=0) for f in flights], axis=0)
    assert scores[0] < acceptance_band(3, 4, 0.999)[1]
    assert scores[1] < acceptance_band(3, 4, 0.999)[1]
    assert np.mean([f.rms_3d(after_s=10.0) for f in flights]) < 1.2
    assert np.mean([f.rms_3d(slice(3, 6), after_s=10.0) for f in flights]) < 0.35


@pytest.mark.parametrize("model", ["pv", "pva"])
def test_on_motion_drawn_from_its_own_model_the_filter_is_consistent(model):
    """Here nothing excuses a filter: errors and innovations must be as large as it says, neither more nor less."""
    scores, nis = [], {}
    for seed in range(20):
        case = Case(model, seed=seed, duration_s=SHORT_S)
        navigator = GnssOnly(replace_gate(gps_only_settings(case)))
        *_, motion, _ = navigator.layout.blocks
        tau_s, start = (motion.tau_s, motion.sigma0[0]) if model == "pva" else (0.0, 0.0)
        truth = drawn_motion(np.random.default_rng(seed), case.duration_s, motion.psd[0], tau_s, start)
        navigator.on_aid = lambda status, nav=navigator: count_innovations(nav, status, nis)
        scores.append(flight_of(truth, navigator.feed_all(epochs_of(case, truth))).nees[199::200, :2])
    looks = np.concatenate(scores)  # 20 s apart: about as long as an error of position lasts
    low, high = acceptance_band(3, len(looks), 0.999)
    assert np.all((low < looks.mean(axis=0)) & (looks.mean(axis=0) < high)), looks.mean(axis=0)
    for name, (total, dof) in nis.items():
        assert dof > 30000
        assert total / dof == pytest.approx(1.0, abs=3.3 * np.sqrt(2.0 / dof)), name  # 99.9 %


def replace_gate(settings):
    """Gates that do not cut the tail off the statistic."""
    return dataclasses.replace(settings, gnss=dataclasses.replace(settings.gnss, gate=GateSettings(probability=0.9999999)))


def count_innovations(navigator, status, nis):
    aid = navigator.aid("gnss_range") if status.name == "gnss_range" else navigator.aid("gnss_range_rate")
    if status.stamp_ns > 5_000_000_000:  # the clock starts far too uncertain
        total, dof = nis.get(status.name, (0.0, 0))
        nis[status.name] = total + aid.epoch_nis, dof + aid.epoch_dof


def test_with_three_satellites_the_solution_is_held_back_and_comes_back_at_once():
    start = truth_of("HD", SHORT_S).stamps_ns[0]
    in_gap = lambda e: 40e9 < e.stamp_ns - start <= 70e9  # noqa: E731
    navigator, flight = flown(change=lambda e: e.rows(np.arange(3)) if in_gap(e) else e)
    assert not ((flight.t_s > 40.0) & (flight.t_s <= 70.0)).any()
    assert flight.worst(70.0, 72.0) < 25.0
    assert flight.worst(80.0, 100.0) < 5.0
    assert navigator.mode == "gps"


def test_a_state_that_most_satellites_contradict_is_started_afresh():
    start = truth_of("HD", SHORT_S).stamps_ns[0]

    def moved(epoch):  # the aircraft is suddenly seen 2 km further east: what a stolen or replayed signal would look like
        if epoch.stamp_ns - start < 40e9:
            return epoch
        place = truth_of("HD", SHORT_S)
        row = int(np.searchsorted(place.stamps_ns, epoch.stamp_ns))
        east_e = dcm_ne(place.lat[row], place.lon[row])[1]
        here = geodetic_to_ecef(place.lat[row], place.lon[row], place.height[row])
        change = np.linalg.norm(epoch.sat_pos_e - here - 2000.0 * east_e, axis=1) - np.linalg.norm(epoch.sat_pos_e - here, axis=1)
        return dataclasses.replace(epoch, pseudorange_m=epoch.pseudorange_m + change)

    navigator, flight = flown(change=moved)
    assert navigator.restarts["most satellites contradicted the state"] == 1
    assert flight.error[-1, 1] == pytest.approx(-2000.0, abs=10.0)


def test_a_long_outage_starts_the_filter_afresh():
    settings = dataclasses.replace(gps_only_settings(PVA), restart_s=20.0)
    truth = truth_of("HD", SHORT_S)
    navigator = GnssOnly(settings)
    for epoch in epochs_of(PVA, truth):
        gap = 30e9 < epoch.stamp_ns - truth.stamps_ns[0] < 60e9
        navigator.feed(epoch.rows(np.arange(2)) if gap else epoch)
    assert navigator.restarts["no solution for 20 s"] == 1
    assert navigator.mode == "gps"


def test_low_latency_output_carries_the_state_to_the_newest_stamp():
    case = dataclasses.replace(PVA, duration_s=20.0)
    truth = truth_of("HD", 20.0)
    navigator = GnssOnly(dataclasses.replace(gps_only_settings(case), latency_s=0.5))
    navigator.feed_all(epochs_of(case, truth))
    ahead = navigator.output()
    assert ahead.stamp_ns == navigator.horizon.newest_ns > navigator.core.t_ns
    assert np.trace(ahead.cov_pos) > np.trace(navigator.P[:3, :3])


@pytest.mark.parametrize("step_s", [0.6, 3.0, 9.9, 60.0, 100.0, -60.0, 1e6, -1e6])
def test_one_wild_stamp_costs_one_epoch(step_s):
    count = iter(range(10**6))

    def stamped(epoch):
        return dataclasses.replace(epoch, stamp_ns=epoch.stamp_ns + round(step_s * 1e9) * (next(count) == 40))

    plain, _ = flown()
    navigator, _ = flown(change=stamped)
    assert navigator.restarts == plain.restarts
    assert navigator.mode == "gps"
    assert navigator.input_status["gnss/raw"].received == plain.input_status["gnss/raw"].received
    assert sum(navigator.input_status["gnss/raw"].rejected.values()) == 1
    assert navigator.range_aid.status.fused >= plain.range_aid.status.fused - 3
