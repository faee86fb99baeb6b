"""Code and carrier of ground transmitters: messages, compiled updates, slips, flights, and what can be wrong with it."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lowcostnav_ros.aids._carrier_channels import Channels
from lowcostnav_ros.aids.pseudolite import PseudoliteAid
from lowcostnav_ros.base.measurements import CarrierEpoch, StationWeather
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.carrier_model import renewed, screened_update, screened_update_ud, transmitter_model
from lowcostnav_ros.messages.decode import Decoder, decode
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.pseudolite_ins import PseudoliteIns
from lowcostnav_ros.physics.earth import difference_n, displace, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_apply_phi_n, quat_to_dcm
from lowcostnav_ros.reproduce.kawecki.beyond import OtherCase, fly_other
from lowcostnav_ros.reproduce.kawecki.flights import Case, imu_of_case, navigator_of, simulator_of, started, table, truth_of
from lowcostnav_ros.reproduce.kawecki.signals import false_slips
from lowcostnav_ros.reproduce.solimeno.flights import fed, flight_of
from lowcostnav_ros.sensors.pseudolite import WAVELENGTH_M

FLIGHT_S = 30.0
CASE = Case(test=0, signals="clean", start="drawn", duration_s=FLIGHT_S)


@cache
def signals(case=CASE):
    truth = truth_of(FLIGHT_S)
    return truth, simulator_of(case).simulate(truth), imu_of_case(case, truth)


def flown(change=None, case=CASE, changes=(), navigator=None, pieces=None):
    """Fly half a minute; ``change`` makes other measurements of each."""
    case = replace(case, changes=changes)
    truth, measured, imu = signals(replace(case, changes=tuple(c for c in changes if c[0].startswith("sim."))))
    measured = [m for given in measured for m in ([given] if change is None else change(given))]
    navigator = started(navigator_of(case), truth, case) if navigator is None else navigator
    return navigator, flight_of(truth, fed(navigator, imu, measured)), truth


def epochs_only(function):
    return lambda m: [function(m)] if isinstance(m, CarrierEpoch) else [m]


def receiver_of(navigator):
    return navigator.aids_of(PseudoliteAid)[0]


# messages -----------------------------------------------------------------------------------------------------------------------


def test_messages_to_the_bit_and_back():
    _, measured, _ = signals()
    epoch = next(m for m in measured if isinstance(m, CarrierEpoch))
    weather = next(m for m in measured if isinstance(m, StationWeather))
    for sent in (epoch, weather):
        ((_, topic, msgtype, raw),) = encode_cdr(sent)
        got = decode(topic, msgtype, raw)
        for name in type(sent).__dataclass_fields__:
            a, b = getattr(sent, name), getattr(got, name)
            assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b, name


def test_what_cannot_be_is_not_valid_and_a_transmitter_heard_twice_is_taken_out():
    _, measured, _ = signals()
    epoch = next(m for m in measured if isinstance(m, CarrierEpoch))
    code, ident = epoch.code_m.copy(), epoch.ident.copy()
    code[0], ident[2] = math.inf, ident[1]
    ((_, topic, msgtype, raw),) = encode_cdr(replace(epoch, code_m=code, ident=ident))
    decoder = Decoder()
    got = decoder.decode(topic, msgtype, raw)
    assert not got.code_valid[0] and len(got) == len(epoch) - 2
    assert set(decoder.notes) == {"pseudolite/raw: implausible code not used", "pseudolite/raw: transmitter appears twice, not used"}


# the compiled parts ---------------------------------------------------------------------------------------------------------------


def test_jacobian_against_differences():
    place, lever_b = (0.575, -1.853, 5000.0), np.array([1.0, 0.5, -0.5])
    q, pos = euler_to_quat(0.3, 0.1, 1.0), np.array([geodetic_to_ecef(0.576, -1.852, 1250.0), geodetic_to_ecef(0.5745, -1.8535, 1300.0)])

    def ranges(d):
        lever = quat_to_dcm(quat_apply_phi_n(q, d[3:])) @ lever_b
        return transmitter_model(*displace(*place, d[:3]), lever, pos, 9, 6)[0]

    _, H = transmitter_model(*place, quat_to_dcm(q) @ lever_b, pos, 9, 6)
    for k, column in enumerate([0, 1, 2, 6, 7, 8]):
        d, step = np.zeros(6), 0.5 if k < 3 else 1e-3
        d[k] = step
        assert (ranges(d) - ranges(-d)) / (2.0 * step) == pytest.approx(H[:, column], abs=2e-6)


def test_row_by_row_equals_the_vector_update_and_the_factored_one():
    rng = np.random.default_rng(1)
    A, H = rng.standard_normal((31, 31)), rng.standard_normal((28, 31)) * (rng.random((28, 31)) < 0.3)
    P0, y, r = A @ A.T + 1e-6 * np.eye(31), rng.standard_normal(28), 0.01 + rng.random(28)
    expected = P0.copy()
    dx0 = kalman.update(expected, y, H, np.diag(r), np.ones(31))
    order = np.argsort(rng.random(28))
    for update in (screened_update, screened_update_ud):
        P = P0.copy()
        dx, used = update(P, y, H, r, order, math.inf)
        assert used.all() and np.abs(dx - dx0).max() < 1e-9 * np.abs(dx0).max() and np.abs(P - expected).max() < 1e-9 * np.abs(P0).max()
    P = P0.copy()
    bad = y.copy()
    bad[5] = 1e6
    dx, used = screened_update(P, bad, H, r, order, 20.0)
    assert not used[5] and np.isfinite(dx).all()


def test_the_factored_form_stays_positive_where_the_plain_one_in_single_precision_does_not():
    P0, rows, r = 1e6 * np.eye(2), np.array([[1.0, 1e-4], [1.0, 1.0]]), 1e-4
    P = P0.copy()
    screened_update_ud(P, np.zeros(2), rows, np.full(2, r), np.arange(2), math.inf)
    assert np.linalg.eigvalsh(P).min() > 0.0
    single = P0.astype(np.float32)
    for h in rows.astype(np.float32):
        Ph = single @ h
        single = single - np.outer(Ph, Ph) / (h @ Ph + np.float32(r))
    assert np.linalg.eigvalsh(single.astype(float)).min() < 0.0


def test_a_renewed_ambiguity_is_worth_what_a_monte_carlo_says():
    rng = np.random.default_rng(2)
    A = rng.standard_normal((4, 4))
    P, row = A @ A.T, np.array([0.7, -0.2, 0.5, 0.0])
    x = np.linalg.cholesky(P) @ rng.standard_normal((4, 200_000))
    x[3] = row @ x + 0.3 * rng.standard_normal(200_000)
    renewed(P, row, 3, 0.09)
    assert np.cov(x) == pytest.approx(P, abs=0.05 * P.max())


# slips ------------------------------------------------------------------------------------------------------------------------------


def channel_epoch(k, cycles, doppler, missing=()):
    rows = [i for i in range(5) if i not in missing]
    ones = np.ones(len(rows))
    columns = np.array(cycles)[rows] * WAVELENGTH_M, np.array(cycles)[rows], np.array(doppler)[rows], ones * WAVELENGTH_M, 0.0 * ones
    return CarrierEpoch(10**9 + k * 10**8, "pseudolite/raw", np.array([str(i) for i in rows]), *columns, ones > 0, ones > 0), np.array(rows)


def test_slips_gaps_and_clock_steps():
    channels, cycles, doppler = Channels(1.5, 0.25), np.arange(5) * 100.0, np.full(5, -40.0)

    def look(k, missing=()):
        epoch, rows = channel_epoch(k, cycles, doppler, missing)
        slips = channels.look(epoch, np.arange(len(rows)), rows)
        return {int(rows[row]): kind for row, kind in slips.kinds.items()}, slips.step_m

    assert set(look(0)[0].values()) == {"new"}
    cycles += 4.0
    assert look(1) == ({}, 0.0)
    cycles += 4.0
    cycles[2] += 2.0
    assert look(2) == ({2: "threshold slip"}, 0.0)
    cycles += 4.0 + 5000.0  # the receiver sets its clock
    kinds, step_m = look(3)
    assert kinds == {} and step_m == pytest.approx(5000.0 * WAVELENGTH_M)
    for k in (4, 5, 6):
        cycles += 4.0
        assert look(k, missing=(1,)) == ({}, 0.0)
    cycles += 4.0
    assert look(7) == ({1: "time slip"}, 0.0)
    cycles += 4.0
    assert look(8, missing=(3,)) == ({}, 0.0)
    cycles += 4.0
    assert look(9) == ({}, 0.0), "one epoch away is counted over"


def test_no_false_slips_in_noise():
    rng = np.random.default_rng(3)
    assert false_slips(rng, 1.5, seconds=60.0) == 0 and false_slips(rng, 0.2, seconds=5.0) > 0


# flights ----------------------------------------------------------------------------------------------------------------------------


def test_a_flight_is_accurate_and_honest():
    navigator, flight, _ = flown()
    assert navigator.mode == "pseudolite" and navigator.layout.size == 46
    late = flight.t_s > 10.0
    assert np.linalg.norm(flight.error[late, :3], axis=1).max() < 1.0
    assert 0.2 < flight.nees[late, 0].mean() < 9.0
    assert not receiver_of(navigator).status.rejected and navigator.contradictions() == ()


def test_the_same_bits_however_the_inertial_data_is_cut():
    truth, measured, imu = signals()
    outs = []
    for size in (10, 100):
        navigator = started(navigator_of(CASE), truth, CASE)
        navigator.horizon.lag_ns = 2_000_000_000
        items = sorted(
            [*measured, *(imu[k : k + size] for k in range(1, len(imu), size))], key=lambda m: (m.stamp_ns, size * hash(m.source))
        )
        outs.append([(s.stamp_ns, s.lat, s.lon, s.height) for s in navigator.feed_all(items)])
    n = min(map(len, outs))
    assert n > 250 and outs[0][:n] == outs[1][:n]


def test_factors_and_covariance_agree_over_a_flight():
    _, plain, _ = flown()
    _, factored, _ = flown(changes=(("pseudolite.update", "ud"),))
    assert np.abs(plain.error[:, :3] - factored.error[:, :3]).max() < 1e-6
    assert np.abs(factored.sigma / plain.sigma - 1.0).max() < 1e-6


def test_kept_covariances_know_that_an_ambiguity_is_made_of_the_position():
    slips = replace(CASE, signals="large")
    kept, _, _ = flown(case=slips)
    zeroed, _, _ = flown(case=slips, changes=(("pseudolite.reset.covariance", "zeroed"),))
    assert kept.core.P[0, 0] > zeroed.core.P[0, 0]


def test_two_transmitters_hold_back_the_drift():
    def few(m):
        keep = np.isin(m.ident, ["100", "400"])
        columns = (
            getattr(m, name)[keep]
            for name in ("ident", "code_m", "carrier_cycles", "doppler_hz", "wavelength_m", "cn0", "code_valid", "carrier_valid")
        )
        return CarrierEpoch(m.stamp_ns, m.source, *columns)

    navigator, flight, _ = flown(epochs_only(few))
    alone, free, _ = flown(lambda m: [])
    assert navigator.mode == "sparse" and navigator.reason == "2 transmitters" and alone.mode == "coasting"
    assert flight.sigma[-1, :2].min() < 0.9 * free.sigma[-1, :2].min()


def test_a_start_takes_four_transmitters_and_needs_no_gps():
    def few(m):
        return replace(m, code_valid=m.code_valid & np.isin(m.ident, ["100", "400", "700"]))

    navigator, imu = navigator_of(CASE), signals()[2]
    for k, m in enumerate([few(m) for m in signals()[1] if isinstance(m, CarrierEpoch)][:30]):
        navigator.feed(m)
        navigator.feed(imu[10 * k : 10 * k + 10])
    assert navigator.mode == "aligning" and "3 transmitters; a position takes 4" in navigator.reason
    navigator, flight, _ = flown(navigator=navigator_of(CASE))
    assert navigator.mode == "pseudolite"
    assert np.linalg.norm(flight.error[-1, :3]) < 3.0 * np.linalg.norm(flight.sigma[-1, :3])


def test_the_smoother_serves_this_filter():
    truth, measured, imu = signals()
    navigator = started(navigator_of(CASE), truth, CASE)
    navigator.keep_history()
    plain = flight_of(truth, fed(navigator, imu, measured))
    solutions = list(navigator.history.smoothed())
    rows = np.searchsorted(truth.stamps_ns, [s.stamp_ns for s in solutions])
    error = np.array([difference_n(truth.lat[r], truth.lon[r], truth.height[r], *s.place) for r, s in zip(rows, solutions, strict=True)])
    sigma = np.sqrt([np.diag(s.cov_pos) for s in solutions])
    first = slice(0, 100)
    assert np.sqrt((error[first] ** 2).mean()) < np.sqrt((plain.error[first, :3] ** 2).mean())
    assert (sigma[first] < plain.sigma[first, :3]).mean() > 0.95 and np.sqrt(((error / sigma) ** 2).mean()) < 2.5


# what can be wrong ------------------------------------------------------------------------------------------------------------------


def test_lost_synchronisation_is_named_and_the_transmitter_left_out():
    navigator, flight, _ = flown(changes=(("sim.lost_sync", (8.0, 300.0, 60.0, 2.0)),))
    named = [c for c in navigator.contradictions() if c.name == "transmitter out of step"]
    assert [c.parties[0] for c in named] == ["300"]
    assert np.linalg.norm(flight.error[-1, :3]) < 1.5


def test_carrier_in_metres_and_a_wrong_wavelength_are_named():
    for change in (
        epochs_only(lambda m: replace(m, carrier_cycles=m.carrier_cycles * m.wavelength_m)),
        epochs_only(lambda m: replace(m, wavelength_m=1.5 * m.wavelength_m)),
    ):
        navigator, flight, _ = flown(change)
        assert any(c.name == "carrier and code disagree in scale" for c in navigator.contradictions())
        assert np.isfinite(flight.error).all() and np.linalg.norm(flight.error[-1, :3]) < 5.0 * np.linalg.norm(flight.sigma[-1, :3])


def test_unknown_transmitters_absurd_weather_and_one_at_the_aircraft_are_counted():
    truth = signals()[0]

    def change(m):
        if isinstance(m, StationWeather):
            return [replace(m, pressure_pa=np.where(m.ident == "100", 65000.0, m.pressure_pa))]
        ident, pos = m.ident.copy(), np.zeros((len(m), 3))
        ident[3], ident[4] = "9999", "NEAR"
        row = int(np.searchsorted(truth.stamps_ns, m.stamp_ns))
        pos[4] = geodetic_to_ecef(truth.lat[row], truth.lon[row], truth.height[row])
        return [replace(m, ident=ident, pos_e=pos, vel_e=0.0 * pos)]

    navigator, flight, _ = flown(change)
    rejected = receiver_of(navigator).status.rejected
    assert rejected["transmitter unknown"] > 200 and rejected["transmitter at the aircraft"] > 200
    assert navigator.aid("pseudolite_weather").status.rejected["weather absurd"] == 1
    assert np.linalg.norm(flight.error[-1, :3]) < 1.0


def test_a_clock_step_moves_the_clock_alone():
    navigator, flight, _ = flown(changes=(("sim.clock_step", (15.0, 3000.0)),))
    rejected = receiver_of(navigator).status.rejected
    assert rejected["clock step followed"] == 1 and rejected["threshold slip"] == 0 and np.linalg.norm(flight.error[-1, :3]) < 1.0


def test_without_weather_the_standard_atmosphere_is_taken_and_said():
    navigator, _, _ = flown(lambda m: [m] if isinstance(m, CarrierEpoch) else [])
    assert receiver_of(navigator).remark == ""
    bare = PseudoliteIns(navigator.settings, type(table())([replace(s, weather=None) for s in table()]))
    assert "no weather for 100, 200" in bare.status().details["pseudolite"]


def test_the_aid_serves_another_navigator_by_configuration():
    ins = InsGps(from_mapping(InsGps.Settings, {"aids": ["gps", "pseudolite", "ranging", "gnss_carrier"]}), table())
    assert {"pseudolite", "pseudolite_weather", "ranging", "gnss_carrier"} <= {aid.status.name for aid in ins.aids}


def test_ranges_that_leave_a_direction_open_do_not_teach_it_by_their_curvature():
    """Two beacons, no barometer, a place known to 1.5 km: NEES of the position, three expected; of four flights 5.8 is beyond 97.5 %."""
    flights = [fly_other(OtherCase(beacons=2, seed=seed, start_m=1500.0, duration_s=80.0)) for seed in (1, 2, 3, 4)]
    assert np.mean([flight.nees[-1, 0] for flight in flights]) < 5.8
    assert min(flight.sigma[-1, :3].max() for flight in flights) > 500.0
