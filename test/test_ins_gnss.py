"""INS/GNSS: rows against differences, clock against its exact process, consistency, few satellites, faults, clock jumps, order."""

import dataclasses
import random

import numpy as np
import pytest

from lowcostnav_ros.aids.gnss import GnssSettings, RangeAid, clock_block
from lowcostnav_ros.aids.gps import GpsSettings
from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import core_block, imu_settings
from lowcostnav_ros.cores.inertial import CORE, InertialCore
from lowcostnav_ros.estimation.aiding import GateSettings
from lowcostnav_ros.estimation.consistency import acceptance_band
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.estimation.satellite_model import Observations, common_part, satellite_model
from lowcostnav_ros.gnss.constellation import gps_24
from lowcostnav_ros.gnss.error_budget import range_covariance
from lowcostnav_ros.gnss.observables import range_and_rate
from lowcostnav_ros.gnss.receiver_clock import CLOCKS, process_noise, transition
from lowcostnav_ros.navigators.ins_gnss import SOLUTION, InsGnss, InsGnssSettings, LooseSettings
from lowcostnav_ros.physics.earth import dcm_ne, displace, geodetic_to_ecef, radii
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_apply_phi_n, quat_to_dcm, wrap
from lowcostnav_ros.reproduce.solimeno.flights import (
    Case,
    epochs_of,
    fed,
    flight_of,
    fly,
    imu_of,
    inertial_settings,
    started,
    truth_of,
)

SHORT_S = 60.0
NAV = np.array([0.67, -0.16, 1500.0, 60.0, -45.0, 4.0, *euler_to_quat(0.3, -0.1, 2.0)])
LEVER_B, RATE_B = np.array([3.0, -1.0, 0.5]), np.array([0.2, -0.1, 0.3])
PROFILE = load_imu_profile("mems")


def satellites(count=6, seed=3):
    """Random satellites above the horizon, m and m/s ECEF."""
    rng = np.random.default_rng(seed)
    up = geodetic_to_ecef(*NAV[:3])
    away = rng.normal(size=(200, 3))
    away *= 2.2e7 / np.linalg.norm(away, axis=1)[:, None]
    high = away @ up > 0.2 * 2.2e7 * np.linalg.norm(up)
    return up + away[high][:count], 2500.0 * rng.normal(size=(count, 3))


def observed(nav, rate_b=RATE_B):
    """Range and range rate of the antenna by the simulator's own geometry."""
    sat_pos, sat_vel = satellites()
    C, C_ne = quat_to_dcm(nav[6:10]), dcm_ne(nav[0], nav[1])
    antenna_e = geodetic_to_ecef(*nav[:3]) + C_ne.T @ C @ LEVER_B
    velocity_e = C_ne.T @ (nav[3:6] + C @ np.cross(rate_b, LEVER_B))
    ranges, rates, _ = range_and_rate(antenna_e, velocity_e, sat_pos, sat_vel)
    return np.concatenate((ranges, rates))


def moved(x):
    nav = NAV.copy()
    nav[:3], nav[3:6] = displace(*NAV[:3], x[:3]), NAV[3:6] + x[3:6]
    nav[6:10] = quat_apply_phi_n(NAV[6:10], x[6:9])
    return nav


def test_rows_equal_differences_of_the_simulated_observations():
    C = quat_to_dcm(NAV[6:10])
    sat_pos, sat_vel = satellites()
    ranges, rates, H_range, H_rate, _ = satellite_model(NAV, C @ LEVER_B, C @ np.cross(RATE_B, LEVER_B), sat_pos, sat_vel, 12)
    assert np.concatenate((ranges, rates)) == pytest.approx(observed(NAV), rel=1e-12)
    H = np.vstack((H_range, H_rate))
    for i, step in enumerate([50.0] * 3 + [1.0] * 3 + [1e-3] * 3):
        x = np.zeros(9)
        x[i] = step
        numeric = (observed(moved(x)) - observed(moved(-x))) / (2.0 * step)
        # radii are constant in the linearisation; a turning lever arm also turns the line of sight, by 3e-4 (m/s)/rad, left out
        assert numeric == pytest.approx(H[:, i], rel=2e-5, abs=2e-7 if i < 6 else 6e-4), i
    assert not H[:, 9:].any()


def test_rows_of_satellite_24_are_the_recomputed_ones():
    """Rows of the thesis's (5-37) in radians and metres up, recomputed from its equations apart from this package; all printed digits."""
    lat, lon, height, vel_n = np.radians(38.7), np.radians(-9.1), 500.0, np.array([40.0, -30.0, 3.0])
    nav = np.array([lat, lon, height, *vel_n, 1.0, 0.0, 0.0, 0.0])
    sat_pos, sat_vel = (column[23:24] for column in gps_24().states(0.0))
    _, (rate,), H_range, H_rate, _ = satellite_model(nav, np.zeros(3), np.zeros(3), sat_pos, sat_vel, 9)
    meridian, normal = radii(lat)
    S = np.array([meridian + height, (normal + height) * np.cos(lat), -1.0])
    assert H_range[0, :3] * S == pytest.approx((4.0883219e5, -1.14410144e6, -0.97117786), rel=2e-8)
    assert H_rate[0, 3:6] == pytest.approx((0.06427279, -0.22952684, 0.97117786), abs=6e-9)
    assert H_range[0, :3] == pytest.approx(H_rate[0, 3:6]) and not H_range[0, 3:6].any()
    assert H_rate[0, :3] * S == pytest.approx((855.73488, -372.81503, 2.534003e-5), rel=3e-7)
    line = dcm_ne(lat, lon) @ (sat_pos[0] - geodetic_to_ecef(lat, lon, height))
    rho, u = np.linalg.norm(line), dcm_ne(lat, lon) @ sat_vel[0] - vel_n
    without_turn = -(u - rate * line / rho) / rho * S  # n held still while the position moves
    assert without_turn == pytest.approx((817.08, -355.15, 2.534e-5), rel=2e-5)


def test_clock_states_follow_the_exact_two_state_process():
    block = clock_block(GnssSettings())
    layout = Layout([core_block(imu_settings(PROFILE.filter_noise())), block])
    core = InertialCore(layout)
    core.start(0, NAV, np.eye(CORE))
    core.estimate[9:] = [5.0, 2.0]
    core.P[9:, 9:] = [[4.0, 0.3], [0.3, 0.5]]
    Phi, P = np.eye(2), core.P[9:, 9:].copy()
    for _ in range(20):
        core._sums[0] = 0.1
        core.settle()
        Phi = transition(0.1)
        P = Phi @ P @ Phi.T + process_noise(CLOCKS["compensated_crystal"], 0.1)
    assert core.estimate[9:] == pytest.approx([9.0, 2.0])
    assert core.P[9:, 9:] == pytest.approx(P, rel=2e-4)


@pytest.mark.parametrize(
    ("grade", "coupling", "states"), [("crista", "tight", 29), ("crista", "loose", 27), ("fog", "tight", 23), ("fog", "loose", 21)]
)
def test_the_four_filters_are_lists(grade, coupling, states):
    imu = imu_settings(load_imu_profile(grade).filter_noise())
    assert InsGnss(InsGnssSettings(imu=imu, coupling=coupling)).layout.size == states


def test_errors_stay_inside_their_sigmas_and_innovations_are_white():
    flights = [fly(Case("tight", "HD", "mems", seed, start="drawn", duration_s=SHORT_S)) for seed in range(4)]
    scores = np.mean([f.nees[100:].mean(axis=0) for f in flights], axis=0)
    low, high = acceptance_band(3, 4, 0.999)  # one independent look per flight: errors of a flight hang together
    assert np.all((low < scores) & (scores < high)), scores
    assert np.mean([f.rms_3d(after_s=10.0) for f in flights]) < 1.2
    assert np.mean([f.rms_3d(slice(3, 6), after_s=10.0) for f in flights]) < 0.1


def test_a_large_heading_error_leaves_the_attitude_inside_its_sigmas():
    """Forty degrees found out by the first horizontal acceleration: what was learnt of the biases before must turn with it."""
    flights = [fly(Case("tight", "LD", "mems", seed, start="drawn", heading_error_deg=40.0, duration_s=90.0)) for seed in range(8)]
    low, high = acceptance_band(3, 8, 0.999)
    assert low < np.mean([f.nees[-300:, 2].mean() for f in flights]) < high
    assert max(abs(np.degrees(f.error[-1, 8])) for f in flights) < 1.0


def test_straight_flight_shows_no_heading_and_the_sigma_says_so():
    """The gyro bias of a low-cost unit turns the estimated heading away; nothing brings it back before the first turn."""
    flight = fly(Case("tight", "STR", seed=2, duration_s=120.0))
    error_deg, sigma_deg = (np.degrees(wrap(rows[-1, 8])) for rows in (flight.error, flight.sigma))
    assert 30.0 < abs(error_deg) < 2.0 * sigma_deg


def test_a_slow_circle_shows_no_heading_either():
    """0.5 m/s^2 are no more than the accelerometers' biases: heading stays as uncertain as its start and the gyro's bias make it."""
    flight = fly(Case("tight", "LD-gentle", seed=1, heading_error_deg=20.0, duration_s=60.0))
    error_deg, sigma_deg = (np.degrees(wrap(rows[-1, 8])) for rows in (flight.error, flight.sigma))
    assert abs(error_deg) < 2.0 * sigma_deg
    assert 25.0 < sigma_deg < 60.0


def test_a_turn_after_an_unknown_heading_shows_it():
    """What was learnt of the biases before it hangs on the heading, and does not hold it where it was."""
    flight = fly(Case("tight", "LD", seed=1, heading_error_deg=20.0, duration_s=85.0))
    error_deg, sigma_deg = (np.degrees(wrap(rows[-1, 8])) for rows in (flight.error, flight.sigma))
    assert abs(error_deg) < 3.0 * sigma_deg < 9.0


def test_innovations_are_as_large_as_predicted():
    navigator, nis, dof = ready(), 0.0, 0
    truth = truth_of("HD", SHORT_S)

    def count(status):
        nonlocal nis, dof
        aid = navigator.aid("gnss_range") if status.name == "gnss_range" else navigator.aid("gnss_range_rate")
        nis, dof = nis + aid.epoch_nis, dof + aid.epoch_dof

    navigator.on_aid = count
    fed(navigator, imu_of(PROFILE, truth, 1), epochs_of(CASE, truth))
    assert dof > 9000
    assert nis / dof == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / dof))


CASE = Case("tight", "HD", "mems", 1, duration_s=SHORT_S)


def ready(case=CASE, **changes):
    settings = dataclasses.replace(inertial_settings(case, imu_settings(load_imu_profile(case.grade).filter_noise())), **changes)
    return started(InsGnss(settings), truth_of(case.dataset, case.duration_s), dataclasses.replace(case, start="drawn"))


def after(seconds, change, case=CASE, navigator=None):
    """Fly; from ``seconds`` on every epoch goes through ``change`` (None drops it); returns navigator and flight."""
    truth = truth_of(case.dataset, case.duration_s)
    start = truth.stamps_ns[0] + round(seconds * 1e9)
    epochs = [e if e.stamp_ns < start else change(e) for e in epochs_of(case, truth)]
    navigator = navigator or ready(case)
    solutions = fed(navigator, imu_of(load_imu_profile(case.grade), truth, case.seed), [e for e in epochs if e is not None])
    return navigator, flight_of(truth, solutions)


def test_every_further_satellite_bounds_the_drift_more():
    worst, sigma = {}, {}
    crista = dataclasses.replace(CASE, grade="crista")
    for count in (3, 2, 1, 0):
        navigator, flight = after(30.0, lambda e, n=count: e.rows(np.arange(n)) if n else None, crista)
        worst[count], sigma[count] = flight.worst(30.0, 60.0), float(np.linalg.norm(flight.sigma[-1, :3]))
        assert navigator.mode == ("sparse" if count else "coasting")
        assert worst[count] < 4.0 * sigma[count]
    assert sigma[3] < sigma[2] < sigma[1] < sigma[0]
    assert worst[3] < 0.5 * worst[0]


def test_a_satellite_that_lies_is_left_out_by_name_and_the_others_carry_on():
    def fault(epoch):
        pseudorange = epoch.pseudorange_m.copy()
        pseudorange[2] += 60.0
        return dataclasses.replace(epoch, pseudorange_m=pseudorange)

    liar = epochs_of(CASE, truth_of("HD", SHORT_S))[-1].sat_id[2]
    navigator, flight = after(30.0, fault)
    assert navigator.aid("gnss_range").satellites[f"G{liar:02d}: excluded by the integrity test"] > 250
    assert list(navigator.receiver.integrity.status.excluded) == [f"G{liar:02d}"]
    assert flight.worst(30.0, 60.0) < 4.0
    assert navigator.mode == "gps"


def test_a_clock_that_jumps_by_a_millisecond_is_followed_without_moving_the_position():
    jump_m = 299792.458
    navigator, flight = after(30.0, lambda e: dataclasses.replace(e, pseudorange_m=e.pseudorange_m + jump_m))
    assert navigator.aid("gnss_range").status.rejected["clock jump followed"] == 1
    assert flight.worst(30.0, 60.0) < 4.0


def test_a_velocity_that_the_dopplers_contradict_is_off_by_what_they_say():
    navigator, _ = after(55.0, lambda e: e)
    epoch = epochs_of(CASE, truth_of("HD", SHORT_S))[-1]
    assert navigator._apart(epoch) is None and navigator.trust.away is None
    navigator.core.nav[3:6] += [6.0, 0.0, -4.0]
    _, apart, drift = navigator._apart(epoch)
    np.testing.assert_allclose(drift, [-6.0, 0.0, 4.0], atol=1.0)
    assert np.linalg.norm(apart) < 30.0


def test_a_sigma_that_shrinks_at_once_is_believed_in_part_and_one_that_cannot_be_not_at_all():
    aid = RangeAid(GnssSettings())
    for stated in [5.4] * 20 + [0.3] * 200:
        aid.learn(np.full(7, stated))
    assert aid.believed(np.array([7.0, 2.0, 1.0, 0.3])) == pytest.approx([7.0, 2.0, 1.8, 5.4])
    for _ in range(100):
        aid.learn(np.full(7, 2.0))
    assert aid.believed(np.array([2.0])) == pytest.approx([2.0])


@pytest.mark.parametrize(("change", "reason"), [
    (lambda e: dataclasses.replace(e, range_valid=np.zeros(len(e), bool), doppler_valid=np.zeros(len(e), bool)), "not valid"),
    (lambda e: dataclasses.replace(e, system=np.full(len(e), "R")), "system not used"),
    (lambda e: dataclasses.replace(e, cn0=np.full(len(e), 12.0)), "signal too weak"),
])  # fmt: skip
def test_what_cannot_be_used_is_counted_by_its_reason(change, reason):
    gnss = GnssSettings(minimum_cn0=20.0)
    navigator, _ = after(50.0, change, navigator=ready(gnss=gnss))
    assert navigator.aid("gnss_range").status.rejected[reason] >= 4 * 90
    assert navigator.mode == "coasting"


def test_aligns_on_the_move_from_satellites_alone():
    truth = truth_of("LD", SHORT_S)
    case = dataclasses.replace(CASE, dataset="LD")
    settings = inertial_settings(case, imu_settings(PROFILE.filter_noise()))
    navigator = InsGnss(settings)
    flight = flight_of(truth, fed(navigator, imu_of(PROFILE, truth, 1), epochs_of(case, truth)))
    assert flight.t_s[0] < 5.0
    assert flight.worst(20.0, 60.0) < 5.0
    assert np.degrees(np.abs(flight.error[-50:, 6:])).max() < 5.0


def test_too_few_satellites_to_start_is_said_in_a_sentence():
    navigator = InsGnss(InsGnssSettings(gps=GpsSettings(latency_s=0.0)))
    truth = truth_of("LD", SHORT_S)
    epochs = [e.rows(np.arange(3)) for e in epochs_of(CASE, truth)]
    fed(navigator, imu_of(PROFILE, truth, 1), epochs[:40])
    assert navigator.mode == "aligning" and "at least 4" in navigator.reason


def test_loose_coupling_coasts_with_three_satellites_and_is_consistent():
    truth = truth_of("HD", SHORT_S)
    case = dataclasses.replace(CASE, navigator="loose")
    flight = fly(case)
    assert flight.rms_3d(after_s=10.0) < 1.5
    assert flight.nees[100:].mean(axis=0)[0] < acceptance_band(3, 1, 0.999)[1]
    assert len(flight.t_s) > 10 * (len(truth) / 100 - 2)


def test_the_common_part_of_the_noise_is_that_of_the_error_budget():
    elevation = np.radians([6.0, 20.0, 45.0, 88.0])
    R = range_covariance(elevation, 5.5)
    common = common_part(np.diag(R), np.sin(elevation))
    obs = Observations(np.arange(4), np.zeros(4), np.zeros((4, 3)), np.diag(R), common)
    assert obs.covariance(np.array([0, 2, 3])) == pytest.approx(R[np.ix_([0, 2, 3], [0, 2, 3])])


def test_a_solution_is_weighed_by_how_long_its_errors_last():
    navigator = InsGnss(InsGnssSettings(coupling="loose", loose=LooseSettings(position_tau_s=10.0, velocity_tau_s=0.5)))
    eye = np.eye(3)
    sent = [NavSolution(k * 100_000_000, SOLUTION, 0.6, 0.1, 9.0, np.ones(3), cov_pos=eye, cov_vel=eye) for k in (10, 11, 1011)]
    (first, _), (second, rate), (late, _) = (navigator._fix_of(s) for s in sent)
    assert first.cov_n == pytest.approx(eye)
    assert second.cov_n == pytest.approx(200.0 * eye)  # 2 tau / dt: ten seconds of errors heard every tenth of one
    assert rate.cov_n == pytest.approx(10.0 * eye)
    assert late.cov_n == pytest.approx(eye)


def test_a_solution_without_velocity_is_refused_by_name():
    truth, case = truth_of("HD", 20.0), dataclasses.replace(CASE, navigator="loose", duration_s=20.0)
    aids = [NavSolution(e.stamp_ns, SOLUTION, 0.6, 0.1, 9.0, cov_pos=np.eye(3)) for e in epochs_of(case, truth)]
    navigator = ready(case)
    fed(navigator, imu_of(PROFILE, truth, 1), aids)
    assert navigator.input_status[SOLUTION].rejected["no position or no velocity"] > 150


def test_the_order_of_arrival_changes_no_bit():
    case = dataclasses.replace(CASE, duration_s=10.0)
    truth = truth_of(case.dataset, case.duration_s)
    block, epochs = imu_of(PROFILE, truth, 1), epochs_of(case, truth)
    lagged = {"gps": GpsSettings(latency_s=0.5)}
    straight, shuffled = ready(case, **lagged), ready(case, **lagged)
    first = {s.stamp_ns: s for s in fed(straight, block, epochs)}
    late = [dataclasses.replace(e) for e in epochs]
    rng, queue = random.Random(1), sorted(late, key=lambda e: e.stamp_ns)
    for k in range(0, len(queue) - 2, 3):
        queue[k : k + 3] = rng.sample(queue[k : k + 3], 3)
    second = {s.stamp_ns: s for s in fed(shuffled, block, queue)}
    common = first.keys() & second.keys()
    assert len(common) > 80
    assert all(first[k].lat == second[k].lat and np.array_equal(first[k].cov_att, second[k].cov_att) for k in common)


def test_loose_coupling_on_single_epochs_is_consistent_in_innovations_and_errors():
    scores, nis = [], {"gps_position": [], "gps_velocity": []}
    wide = GpsSettings(latency_s=0.0, gate=GateSettings(probability=0.9999999))  # a gate would cut the tail off the statistic
    for seed in range(4):
        case = dataclasses.replace(CASE, navigator="epochs", seed=seed)
        truth, navigator = truth_of("HD", SHORT_S), ready(case, gps=wide)
        navigator.on_aid = lambda status: nis[status.name].append(status.nis)
        flight = flight_of(truth, fed(navigator, imu_of(PROFILE, truth, seed), epochs_of(case, truth)))
        scores.append(flight.nees[100:].mean(axis=0))
    low, high = acceptance_band(3, 4, 0.999)
    assert np.all((low < np.mean(scores, axis=0)) & (np.mean(scores, axis=0) < high)), scores
    for name, values in nis.items():
        low, high = acceptance_band(3, len(values), 0.999)
        assert len(values) > 2000 and low < np.mean(values) < high, name


def test_loose_coupling_on_single_epochs_coasts_without_four_satellites_and_leaves_out_what_it_may_not_use():
    case = dataclasses.replace(CASE, navigator="epochs")
    navigator, flight = after(40.0, lambda e: e.rows(np.arange(3)), case, ready(case))
    assert navigator.mode == "coasting"
    assert navigator.input_status["gnss/raw"].rejected["no solution of this epoch"] > 190
    assert flight.worst(40.0, 60.0) < 20.0
    navigator, _ = after(50.0, lambda e: dataclasses.replace(e, system=np.full(len(e), "R")), case, ready(case))
    assert navigator.aid("gnss_range").status.rejected["system not used"] >= 4 * 90
    assert navigator.mode == "coasting"
