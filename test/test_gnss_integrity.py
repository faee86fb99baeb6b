"""Integrity in flight: faults found and left out, protection levels kept, spoofing and clocks noticed, and what cannot be tested said."""

import dataclasses

import numpy as np
import pytest

from lowcostnav_ros.aids.gnss import GnssSettings
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.estimation.satellite_integrity import IntegritySettings
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.navigators.gnss_only import GnssOnly, GnssOnlySettings
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.reproduce.solimeno.flights import (
    NO_LAG,
    Case,
    fed,
    flight_of,
    imu_of,
    inertial_settings,
    started,
    truth_of,
)
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator, GnssRawSimulatorSettings
from lowcostnav_ros.starts.point_solution import SlopeVelocity, point_solution

DATASET, DURATION_S, FAULT_S = "LD", 80.0, 40.0
PROFILE = load_imu_profile("mems")


def epochs(seed=1, **settings):
    simulator = GnssRawSimulator(GnssRawSimulatorSettings(seed=seed, max_satellites=9, **settings))
    return simulator.simulate(truth_of(DATASET, DURATION_S))


def satellite(seed=1, row=4):
    """A satellite that is used all the time."""
    seen = set.intersection(*({int(s) for s in e.sat_id} for e in epochs(seed)))
    return sorted(seen)[row]


def fly(heard, kind="tight", seed=1, **integrity):
    """Fly epochs; returns navigator, flight and what the integrity tests said with every solution."""
    truth, gnss = truth_of(DATASET, DURATION_S), GnssSettings(integrity=IntegritySettings(**integrity))
    if kind == "tight":
        plain = inertial_settings(Case(kind, DATASET, "mems", seed), imu_settings(PROFILE.filter_noise()))
        navigator = started(InsGnss(dataclasses.replace(plain, gnss=gnss)), truth, Case(kind, DATASET, "mems", seed, start="drawn"))
        solutions = fed(navigator, imu_of(PROFILE, truth, seed), heard)
    else:
        navigator = GnssOnly(GnssOnlySettings(horizon=NO_LAG, latency_s=0.0, model=kind, gnss=gnss))
        solutions = navigator.feed_all(heard)
    return navigator, flight_of(truth, solutions), [(s.stamp_ns - int(truth.stamps_ns[0]), s.integrity) for s in solutions]


def first(reports, found):
    """Seconds from the fault until the first report for which ``found`` holds."""
    return next((1e-9 * t - FAULT_S for t, report in reports if found(report)), None)


@pytest.mark.parametrize("kind", ["tight", "pva"])
@pytest.mark.parametrize(("fault", "within_s", "worst_m"), [
    (lambda s: {"range_faults": [FAULT_S, s, 50.0]}, 2.0, 4.0),
    (lambda s: {"range_ramps": [FAULT_S, s, 0.5]}, 10.0, 4.0),
    (lambda s: {"range_ramps": [FAULT_S, s, 0.5], "faults_in_doppler": False}, 35.0, 8.0),
])  # fmt: skip
def test_one_satellite_that_lies_is_found_named_and_left_out(kind, fault, within_s, worst_m):
    number = satellite()
    navigator, flight, reports = fly(epochs(**fault(number)), kind)
    took_s = first(reports, lambda r: f"G{number:02d}" in r.excluded)
    assert 0.0 <= took_s < within_s
    assert list(navigator.receiver.integrity.status.excluded) == [f"G{number:02d}"]
    assert f"G{number:02d} is excluded" in navigator.receiver.integrity.status.reason
    assert reports[-1][1].verdict == "excluded" and reports[-1][1].hpl_m > 0.0
    assert flight.worst(FAULT_S, DURATION_S) < worst_m
    assert navigator.aid("gnss_range").satellites[f"G{number:02d}: excluded by the integrity test"] > 10


@pytest.mark.parametrize("kind", ["tight", "pva"])
def test_healthy_satellites_stay_and_the_error_stays_below_the_protection_level(kind):
    for seed in (1, 2, 3):
        navigator, flight, reports = fly(epochs(seed), kind, seed)
        assert not navigator.receiver.integrity.status.excluded and not navigator.receiver.integrity.status.alarm
        assert {r.verdict for _, r in reports[10:]} == {"healthy"}
        horizontal = np.hypot(flight.error[:, 0], flight.error[:, 1])
        assert all(e < r.hpl_m for e, (_, r) in zip(horizontal[10:], reports[10:], strict=True))
        lasting = [r.lasting_hpl_m for _, r in reports if r.lasting_hpl_m is not None]
        assert lasting and max(lasting) < 0.5 * reports[-1][1].hpl_m


def test_a_satellite_that_recovers_is_used_again():
    number = satellite()
    faulty, sound = epochs(range_faults=[FAULT_S, number, 50.0]), epochs()
    heard = [f if f.stamp_ns - sound[0].stamp_ns < 1e9 * (FAULT_S + 5.0) else s for f, s in zip(faulty, sound, strict=True)]
    navigator, _, reports = fly(heard, readmit_s=5.0, windows_s=[2.0])
    assert first(reports, lambda r: r.excluded) < 5.0
    assert not navigator.receiver.integrity.status.excluded
    assert reports[-1][1].verdict == "healthy"


def test_with_five_satellites_the_inertial_sensors_tell_which_lies_and_the_rest_cannot_be_tested():
    five = [e.rows(np.arange(5)) for e in epochs()]
    lie = np.array([0.0, 0.0, 400.0, 0.0, 0.0])
    heard = [e if k < 400 else dataclasses.replace(e, pseudorange_m=e.pseudorange_m + lie) for k, e in enumerate(five)]
    navigator, flight, reports = fly(heard)
    assert reports[300][1].verdict == "healthy" and reports[-1][1].verdict == "not possible"
    assert navigator.aid("gnss_range").status.rejected["innovation beyond gate"] > 300
    assert flight.worst(FAULT_S, DURATION_S) < 8.0


def test_five_satellites_whose_fault_the_gate_lets_pass_contradict_each_other():
    five = [e.rows(np.arange(5)) for e in epochs()]
    lie = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    heard = [dataclasses.replace(e, pseudorange_m=e.pseudorange_m + lie * max(0.0, 0.1 * k - FAULT_S)) for k, e in enumerate(five)]
    _, _, reports = fly(heard)
    faulty = [r for _, r in reports if r.verdict == "faulty"]
    assert faulty and "do not show which; 6 are needed" in faulty[-1].reason
    assert all(r.lasting_hpl_m is None for r in faulty)


def test_what_cannot_be_tested_is_said_and_has_no_protection_level():
    four = [e.rows(np.arange(4)) for e in epochs()]
    _, _, reports = fly(four)
    assert reports[-1][1].verdict == "not possible" and "at least 5 are needed" in reports[-1][1].reason
    assert reports[-1][1].hpl_m is None
    _, _, reports = fly(epochs(), enabled=False)
    assert reports[-1][1].verdict == "not possible" and "switched off" in reports[-1][1].reason


def test_a_verdict_does_not_outlast_its_epochs():
    _, _, reports = fly(epochs()[:400])
    assert reports[-1][1].verdict == "not possible" and "no epoch tested for" in reports[-1][1].reason
    assert reports[-1][1].hpl_m is None


@pytest.mark.parametrize(("spoofing", "doppler", "within_s", "word"), [
    ([FAULT_S, 0.0, 0.5, 0.0, 0.0, 0.0], False, 25.0, "ranges contradict the inertial sensors"),
    ([FAULT_S, 1.0, 0.0, 0.0, 0.0, 0.0], True, 5.0, "rates contradict the inertial sensors"),
    ([FAULT_S, 2.0, 0.0, 0.0, 0.0, 20.0], True, 15.0, "rates contradict the inertial sensors"),
    ([FAULT_S, 0.0, 0.0, 0.0, 0.5, 0.0], False, 25.0, "clock"),
])  # fmt: skip
def test_a_common_ramp_is_caught_by_the_inertial_sensors_and_by_no_comparison_of_satellites(spoofing, doppler, within_s, word):
    heard = epochs(spoofing=spoofing, faults_in_doppler=doppler)
    navigator, _, reports = fly(heard)
    took_s = first(reports, lambda r: r.alarm)
    assert 0.0 <= took_s < within_s
    assert word in navigator.receiver.integrity.status.alarm
    assert navigator.mode == "suspect" and navigator.reason == navigator.receiver.integrity.status.alarm
    assert not navigator.receiver.integrity.status.excluded
    alone, _, _ = fly(heard, "pva")
    assert not alone.receiver.integrity.status.alarm and not alone.receiver.integrity.status.excluded


def test_after_the_alarm_the_satellites_may_be_left_out():
    heard = epochs(spoofing=[FAULT_S, 5.0, 0.0, 0.0, 0.0, 0.0])
    _, followed, _ = fly(heard)
    navigator, coasted, _ = fly(heard, on_alarm="coast")
    assert navigator.mode == "coasting" and "not used since the alarm" in navigator.aid("gnss_range").status.reason
    assert followed.worst(DURATION_S - 1.0, DURATION_S) > 150.0
    assert coasted.worst(DURATION_S - 1.0, DURATION_S) < 0.5 * followed.worst(DURATION_S - 1.0, DURATION_S)


def changed(epoch: GnssEpoch, row: int, metres: float) -> GnssEpoch:
    pseudorange = epoch.pseudorange_m.copy()
    pseudorange[row] += metres
    return dataclasses.replace(epoch, pseudorange_m=pseudorange)


def test_the_start_excludes_a_faulty_satellite_and_waits_where_it_cannot_be_identified():
    heard = epochs()
    sound, _ = point_solution(heard[0])
    cleaned, velocity = point_solution(changed(heard[0], 2, 3000.0))
    assert abs(cleaned.height - sound.height) < 30.0 and np.all(np.isfinite(velocity.vel_n))
    with pytest.raises(GnssError, match="which is faulty"):
        point_solution(changed(heard[0].rows(np.arange(5)), 2, 3000.0))
    doppler = heard[0].doppler_mps + 50.0 * np.arange(len(heard[0])) ** 2
    with pytest.raises(GnssError, match="Dopplers contradict"):
        point_solution(dataclasses.replace(heard[0], doppler_mps=doppler))
    navigator, flight, _ = fly([changed(e, 2, 3000.0) for e in heard], "pva")
    assert flight.worst(5.0, DURATION_S) < 8.0 and not navigator.restarts


@pytest.mark.parametrize("kind", ["tight", "pva"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_observation_that_is_not_a_number_costs_that_satellite_one_epoch(kind, wrong):
    heard = epochs()
    for k in (300, 301):
        heard[k] = changed(heard[k], 1, wrong)
        heard[k] = dataclasses.replace(heard[k], doppler_mps=np.where(np.arange(len(heard[k])) == 0, wrong, heard[k].doppler_mps))
    navigator, flight, _ = fly(heard, kind)
    assert navigator.aid("gnss_range").status.rejected["not finite"] == navigator.aid("gnss_range_rate").status.rejected["not finite"] == 2
    assert np.isfinite(flight.error[:, :6]).all() and flight.worst(20.0, DURATION_S) < 5.0


def test_a_clock_reset_is_followed_though_one_satellite_lies():
    number = satellite()
    heard = epochs(range_faults=[FAULT_S - 10.0, number, 100.0])
    heard = [e if k < 400 else dataclasses.replace(e, pseudorange_m=e.pseudorange_m - 299792.458) for k, e in enumerate(heard)]
    navigator, flight, _ = fly(heard)
    assert navigator.aid("gnss_range").status.rejected["clock jump followed"] == 1
    assert flight.worst(FAULT_S - 10.0, DURATION_S) < 4.0 and not navigator.receiver.integrity.status.alarm


def jumped(epoch: GnssEpoch) -> GnssEpoch:
    return dataclasses.replace(epoch, pseudorange_m=epoch.pseudorange_m - 299792.458)


@pytest.mark.parametrize("kind", ["tight", "pva"])
def test_an_innovation_changes_nothing_though_the_clock_has_jumped(kind):
    received = epochs()
    navigator, _, _ = fly(received, kind)
    aid = navigator.aid("gnss_range")
    before = navigator.P.copy(), navigator.core.estimate.copy(), dict(aid.status.rejected), dict(aid.satellites)
    first_time, again = (aid.innovation(jumped(received[-1]), navigator) for _ in range(2))
    assert np.array_equal(first_time.y, again.y) and np.abs(first_time.y).max() < 100.0
    assert np.array_equal(navigator.P, before[0]) and np.array_equal(navigator.core.estimate, before[1])
    assert (dict(aid.status.rejected), dict(aid.satellites)) == before[2:]


def test_an_epoch_that_is_refused_moves_no_clock():
    received = epochs(spoofing=[FAULT_S, 5.0, 0.0, 0.0, 0.0, 0.0])
    navigator, _, _ = fly(received, on_alarm="coast")
    aid, before = navigator.aid("gnss_range"), navigator.core.estimate.copy()
    assert not aid.process(jumped(received[-1]), navigator)
    assert np.array_equal(navigator.core.estimate, before) and not aid.status.rejected["clock jump followed"]


@pytest.mark.parametrize("kind", ["tight", "pva"])
def test_a_clock_that_runs_away_raises_the_alarm_and_moves_no_position(kind):
    def away(epoch, k, rate_mps, seen_in_doppler):
        late_s = 0.1 * max(0, k - 400)
        doppler = epoch.doppler_mps + (rate_mps if late_s and seen_in_doppler else 0.0)
        return dataclasses.replace(epoch, pseudorange_m=epoch.pseudorange_m + rate_mps * late_s, doppler_mps=doppler)

    for seen, word in ((True, "runs away at 5"), (False, "clock jumped 6 times")):
        navigator, flight, reports = fly([away(e, k, 5000.0, seen) for k, e in enumerate(epochs())], kind)
        assert word in navigator.receiver.integrity.status.alarm
        assert first(reports, lambda r: r.alarm) < 2.0
        assert navigator.mode == "suspect" and flight.worst(FAULT_S, DURATION_S) < 5.0
    step = [away(e, k, 50.0, True) for k, e in enumerate(epochs())]
    navigator, flight, _ = fly(step, kind)
    assert navigator.aid("gnss_range_rate").status.rejected["clock jump followed"] == 1  # a step of the frequency is lived with
    assert flight.worst(FAULT_S, DURATION_S) < 4.0


def test_a_receiver_without_dopplers_starts():
    truth, gnss = truth_of(DATASET, DURATION_S), GnssSettings(doppler=False)
    blind = [dataclasses.replace(e, doppler_valid=np.zeros(len(e), dtype=bool)) for e in epochs()]
    navigator = GnssOnly(GnssOnlySettings(horizon=NO_LAG, latency_s=0.0, gnss=gnss))
    flight = flight_of(truth, navigator.feed_all(blind))
    assert flight.t_s[0] < 1.0 and flight.worst(30.0, DURATION_S) < 12.0
    plain = inertial_settings(Case("tight", DATASET, "mems"), imu_settings(PROFILE.filter_noise()))
    navigator = InsGnss(dataclasses.replace(plain, gnss=gnss))
    flight = flight_of(truth, fed(navigator, imu_of(PROFILE, truth, 1), blind))
    assert 4.0 < flight.t_s[0] < 12.0 and flight.worst(40.0, DURATION_S) < 12.0


def test_the_slope_of_positions_is_a_velocity():
    fixes = [point_solution(e, doppler=False)[0] for e in epochs(gps_sigma_m=0.01)[:60]]
    slope = SlopeVelocity()
    velocities = [slope.add(fix) for fix in fixes]
    assert velocities[30] is None
    truth = truth_of(DATASET, DURATION_S)
    middle = truth.vel_n[np.searchsorted(truth.stamps_ns, (fixes[0].stamp_ns + fixes[59].stamp_ns) // 2)]
    assert velocities[59].vel_n == pytest.approx(middle, abs=0.3)
    slope.clear()
    assert slope.add(fixes[0]) is None
