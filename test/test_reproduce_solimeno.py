"""The INS/GPS study: its own arithmetic against other ways to get the same, and the results that cost little."""

import dataclasses

import numpy as np
import pytest

from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat
from lowcostnav_ros.reproduce.registry import BY_DEFINITION, REPRODUCED, Context, selected
from lowcostnav_ros.reproduce.solimeno.estimates import only, true_clock, true_errors
from lowcostnav_ros.reproduce.solimeno.flights import (
    GAPS_S,
    SETTLED_S,
    Case,
    epochs_of,
    fly,
    imu_of,
    navigator_of,
    started,
    truth_of,
)
from lowcostnav_ros.reproduce.solimeno.galileo import expected, single_epoch_sigma
from lowcostnav_ros.reproduce.solimeno.gps_only import largest, mean_error, mean_rms
from lowcostnav_ros.reproduce.solimeno.inertial import COMPENSATED, calibrated, unaided
from lowcostnav_ros.reproduce.solimeno.outages import not_above, standard_error

SHORT = Case("tight", "HD", duration_s=30.0)


def test_an_accelerometer_bias_at_rest_grows_with_half_the_square_of_time():
    truth = truth_of("STR", 30.0)
    bias = np.array([0.05, 0.0, 0.0])
    error = unaided(truth, truth.specific_force_b + bias, truth.angular_rate_b, COMPENSATED)
    t_s = 29.99
    assert error[-1, 0] == pytest.approx(0.5 * 0.05 * t_s**2, rel=5e-4)
    assert error[-1, 1] == pytest.approx(0.05 * t_s, rel=1e-3)


def test_an_ideal_imu_gives_the_printed_half_millimetre():
    context = Context(quick=True)
    for function in (entry.function for entry in selected(["SR1", "SR2", "SR3"])):
        assert function(context).verdict == REPRODUCED
    assert "LD-gentle 0.5" in selected(["SR1"])[0].function(context).ours


def test_expected_errors_of_two_constellations():
    assert expected(Context()).verdict == BY_DEFINITION


def test_error_of_single_epochs_is_the_error_of_least_squares():
    case = Case(schedule="gaps", duration_s=20.0)
    truth, rng = truth_of("LD", 20.0), np.random.default_rng(4)
    (epoch,) = epochs_of(case, truth)[50::100][:1]
    row = int(np.searchsorted(truth.stamps_ns, epoch.stamp_ns))
    here = LocalFrame(truth.lat[row], truth.lon[row], truth.height[row])
    line = epoch.sat_pos_e - here.origin_e
    H = np.column_stack((-line / np.linalg.norm(line, axis=1)[:, None], np.ones(len(epoch))))
    missed = np.linalg.pinv(H) @ (epoch.sigma_m[:, None] * rng.standard_normal((len(epoch), 20000)))
    assert single_epoch_sigma(case) == pytest.approx(np.sqrt(np.mean(np.sum(missed[:3] ** 2, axis=0))), rel=0.03)


def test_pairs_of_flights_contradict_an_order_only_beyond_chance():
    rng = np.random.default_rng(2)
    common, small = rng.standard_normal(10), 0.01 * rng.standard_normal(10)
    assert not_above(common, common + 1.0)
    assert not_above(common + small, common)
    assert not not_above(common + 0.1 + small, common)
    assert standard_error(np.array([1.0, 2.0, 3.0])) == pytest.approx(1.0 / np.sqrt(3.0))
    assert np.isinf(standard_error(np.array([[1.0, 2.0]]))).all()


def test_more_position_noise_is_more_error():
    quiet, loud = (fly(Case(tuning="thesis", position_noise=factor, duration_s=20.0)) for factor in (1.0, 100.0))
    assert loud.rms_3d(after_s=10.0) > 1.5 * quiet.rms_3d(after_s=10.0)


def test_a_known_start_is_the_truth_and_a_drawn_one_is_not():
    truth, profile = truth_of("LD", 20.0), load_imu_profile("mems")
    for start, most in (("known", 1e-12), ("drawn", 0.1)):
        case = Case(grade="mems", start=start, duration_s=20.0)
        navigator = started(navigator_of(case, profile), truth, case)
        turn = rotvec_from_quat(quat_multiply(truth.q_nb[0], quat_conjugate(navigator.core.nav[6:10])))
        assert (np.linalg.norm(turn) > 1e-3) == (start == "drawn")
        assert np.linalg.norm(turn) < most
        assert np.degrees(np.sqrt(navigator.P[8, 8])) == pytest.approx(1.0)


def test_the_parts_of_the_sensor_errors_sum_up_to_what_the_sensor_measures():
    profile, truth = load_imu_profile("crista"), truth_of("HD", 30.0)
    quiet = dataclasses.replace(
        profile,
        gyro=dataclasses.replace(profile.gyro, noise_density_deg_per_h_per_rt_hz=[0.0] * 3),
        accelerometer=dataclasses.replace(profile.accelerometer, noise_density_mg_per_rt_hz=[0.0] * 3),
    )
    measured = imu_of(quiet, truth, SHORT.seed)
    parts = {part: true_errors(SHORT, part) for part in ("bias", "drift", "scale")}
    for k, (got, true) in enumerate(((measured.specific_force_b, truth.specific_force_b), (measured.angular_rate_b, truth.angular_rate_b))):
        model = true * (1.0 + parts["scale"][k]) + parts["bias"][k] + parts["drift"][k]
        assert got == pytest.approx(model, abs=1e-12)
    assert not np.any(calibrated(profile).filter_noise().gyro_turn_on_sigma)
    assert not np.any(only(profile, "drift").filter_noise().accel_noise_density)


def test_the_true_clock_is_the_one_in_the_pseudoranges():
    truth = truth_of("HD", 30.0)
    epoch, clock = epochs_of(SHORT, truth)[100], true_clock(SHORT)[100]
    row = int(np.searchsorted(truth.stamps_ns, epoch.stamp_ns))
    here = LocalFrame(truth.lat[row], truth.lon[row], truth.height[row])
    off = epoch.pseudorange_m - np.linalg.norm(epoch.sat_pos_e - here.origin_e, axis=1) - clock[0]
    assert np.abs(off).max() < 5.0 * 5.5
    assert np.abs(off.mean()) < 4.0 * 5.5 / np.sqrt(len(off))


def test_statistics_of_flights_are_those_of_their_rows():
    flight = fly(dataclasses.replace(SHORT, duration_s=90.0))
    settled = flight.error[flight.t_s > SETTLED_S]
    assert len(settled) == 300
    assert mean_rms([flight, flight]) == pytest.approx(np.sqrt(np.mean(settled[:, :3] ** 2, axis=0)))
    assert mean_error([flight])[2] == pytest.approx(settled[:, 2].mean())  # up is minus down, estimated minus true minus the other way
    assert largest([flight], 3)[1] == pytest.approx(np.abs(settled[:, 5]).max())
    assert flight.worst(5.0, 6.0) == pytest.approx(np.linalg.norm(flight.error[(flight.t_s >= 5) & (flight.t_s <= 6), :3], axis=1).max())
    assert flight.state("clock").shape == (len(flight.t_s), 2)
    assert len(flight.labels) == 20 == flight.states.shape[1]


def test_gaps_hold_the_satellites_they_are_named_for():
    case = Case(schedule="gaps", duration_s=600.0)
    truth = truth_of("LD")
    counts = {round((e.stamp_ns - truth.stamps_ns[0]) * 1e-9, 2): len(e) for e in epochs_of(case, truth)}
    for count, (begin, end) in GAPS_S.items():
        inside = [n for t, n in counts.items() if begin + 0.1 < t < end - 0.1]
        assert set(inside) == ({count} if count else set())
    assert counts[max(counts)] == 6


def test_rows_of_an_epoch_keep_columns_together():
    epoch = epochs_of(SHORT, truth_of("HD", 30.0))[0]
    two = epoch.rows(np.array([3, 1]))
    assert two.sat_id.tolist() == epoch.sat_id[[3, 1]].tolist()
    assert np.array_equal(two.sat_pos_e, epoch.sat_pos_e[[3, 1]])
