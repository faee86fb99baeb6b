"""Dead reckoning in flight: what GPS teaches, what is left without it, what each aid may and may not do."""

import copy
import math

import numpy as np
import pytest
from dead_reckoning_flight import ORIGIN, START_NS, Flight, in_order, station, straight, table, turning

from lowcostnav_ros.base.measurements import Measurement, Pressure, SlantRange
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.estimation.aiding import Decision, Innovation
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning, DeadReckoningSettings
from lowcostnav_ros.physics.atmosphere import pressure_at
from lowcostnav_ros.physics.stochastic import correlation_factor

CALM = {"wind.gust_mps": 0.05, "heading.noise_deg": 0.1, "airspeed.noise_mps": 0.05}
STATIONS = table(station("AAA", 40_000.0, 30_000.0), station("BBB", 40_000.0, -30_000.0))


def navigator(stations=None, **changes):
    settings = {name.replace("__", "."): value for name, value in changes.items()}
    return DeadReckoning(from_mapping(DeadReckoningSettings, settings), stations)


def quiet(stations=None, **changes):
    return navigator(stations, **{**{k.replace(".", "__"): v for k, v in CALM.items()}, **changes})


def gps_until(flight, seconds, every=10, seed=0):
    limit = START_NS + round(1e9 * seconds)
    return [m for m in flight.gps(np.random.default_rng(seed), every) if m.stamp_ns < limit]


def error_at(flight, solution):
    k = int(np.searchsorted(flight.stamps_ns, solution.stamp_ns))
    return flight.ned[k] - ORIGIN.to_ned(solution.lat, solution.lon, solution.height)


def test_turning_flight_teaches_wind_heading_and_airspeed():
    flight = turning(600.0)
    nav = quiet(airspeed__bias_mps=0.0, heading__bias_deg=0.0, wind__sigma_mps=0.5)
    last = nav.feed_all(in_order(flight.attitudes(math.radians(4.0)), flight.airspeeds(scale=0.04), gps_until(flight, 1e9)))[-1]
    np.testing.assert_allclose(last.wind_n, [5.0, -3.0], atol=0.3)
    assert last.states["heading_bias_rad"][0] == pytest.approx(math.radians(4.0), abs=math.radians(0.5))
    assert last.states["airspeed_scale"][0] == pytest.approx(0.04, abs=0.005)
    assert nav.mode == "calibrating"


def test_straight_flight_does_not_tell_wind_from_airspeed_and_the_sigma_says_so():
    nav = quiet(heading__bias_deg=0.0, heading__offset_deg=3.0, airspeed__bias_mps=0.0, airspeed__scale=0.05)
    flight = straight(300.0)
    last = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 1e9)))[-1]
    along, across = np.sqrt(np.diag(last.cov_wind))
    assert along > 0.9 * 50.0 * 0.05  # the whole scale-factor uncertainty stays in the along-track wind
    assert across > 0.9 * 50.0 * math.radians(3.0)
    assert last.states["airspeed_scale"][1] > 0.045
    assert math.sqrt(last.cov_vel[0, 0]) < 0.6  # while their sum, the ground speed, is known well


def test_outage_in_learned_wind_stays_close_and_the_mode_says_so():
    flight = turning(400.0)
    nav = quiet()
    out = nav.feed_all(in_order(flight.attitudes(math.radians(3.0)), flight.airspeeds(0.02), gps_until(flight, 280.0)))
    error = error_at(flight, out[-1])
    assert math.hypot(*error[0:2]) < 100.0  # two minutes, six kilometres flown; the wind alone is worth 700 m
    assert out[-1].mode == "coasting"
    assert "no GPS for 121 s" in nav.status().reason
    assert math.hypot(*error[0:2]) < 3.0 * math.sqrt(out[-1].cov_pos[0, 0] + out[-1].cov_pos[1, 1])


def test_any_arrival_order_within_the_lag_gives_the_same_bits():
    flight = turning(60.0)
    parts = (flight.attitudes(), flight.airspeeds(0.02, every=2), gps_until(flight, 50.0))
    stream = in_order(*parts, flight.ranges(STATIONS, zeros(flight), 150))
    rng = np.random.default_rng(5)
    shuffled = sorted(stream, key=lambda m: m.stamp_ns + rng.uniform(0.0, 0.24e9))
    first, second = navigator(STATIONS).feed_all(stream), navigator(STATIONS).feed_all(shuffled)
    assert len(first) == len(second) > 500
    for a, b in zip(first, second, strict=True):
        assert (a.stamp_ns, a.lat, a.lon, a.height, a.mode) == (b.stamp_ns, b.lat, b.lon, b.height, b.mode)
        assert np.array_equal(a.cov_pos, b.cov_pos)
        assert np.array_equal(a.vel_n, b.vel_n)


def zeros(flight, **shift):
    return {ident: np.full(len(flight), shift.get(ident, 0.0)) for ident in ("AAA", "BBB", "CCC")}


def test_a_copy_at_the_outage_goes_on_like_the_original():
    flight = turning(120.0)
    stream = in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 60.0))
    nav = navigator()
    nav.feed_all(stream[:1500])
    twin = copy.deepcopy(nav)
    a, b = nav.feed_all(stream[1500:]), twin.feed_all(stream[1500:])
    assert a[-1].lat == b[-1].lat
    assert np.array_equal(a[-1].cov_pos, b[-1].cov_pos)


def test_the_low_latency_output_is_the_fused_state_carried_on():
    flight = turning(90.0)
    nav = quiet()
    for m in in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 60.0)):
        nav.feed(m)
    ahead = nav.output()
    assert ahead.stamp_ns == flight.stamps_ns[-1]
    assert np.linalg.norm(error_at(flight, ahead)[0:2]) < 20.0  # half a second late it would be 25 m behind as well
    assert ahead.vel_n @ np.append(flight.vel[-1], 0.0) == pytest.approx(flight.vel[-1] @ flight.vel[-1], rel=0.03)
    assert nav.core.t_ns <= ahead.stamp_ns - 0.2e9  # the state itself has not moved


def test_what_is_carried_ahead_changes_no_bit_of_what_is_fused():
    """Live the low-latency output is asked for again and again, in a replay never; range biases age with the distance flown."""
    flight, found = turning(200.0), []
    parts = flight.attitudes(), flight.airspeeds(), gps_until(flight, 60.0), flight.ranges(STATIONS, zeros(flight), 150)
    stream = in_order(*parts)
    for asks in (True, False):
        nav, out = quiet(STATIONS), []
        for measurement in stream:
            out += nav.feed(measurement)
            if asks:
                nav.output()
        found.append(np.array([(s.lat, s.lon, *s.vel_n, *s.cov_pos.ravel()) for s in out]))
    assert len(found[0]) > 1500
    np.testing.assert_array_equal(*found)


def test_gps_after_an_outage_far_outside_the_gate_moves_position_and_leaves_the_wind():
    flight = turning(400.0)
    nav = quiet(gps__gate__recovery_s=3.0)
    before = gps_until(flight, 200.0)
    shift = Flight(flight.dt, flight.heading, flight.speed, flight.wind, start=np.array([0.0, 4000.0, 0.0]))
    after = [m for m in shift.gps(np.random.default_rng(1), 10) if m.stamp_ns >= START_NS + 260_000_000_000 and m.source == "gps/fix"]
    out = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), before, after))
    wind = {round((s.stamp_ns - START_NS) * 1e-9): s.wind_n for s in out}
    assert np.linalg.norm(wind[275] - wind[255]) < 1.0
    assert abs(error_at(flight, out[-1])[1] + 4000.0) < 20.0
    assert nav.mode == "calibrating"
    assert nav.aid("gps_position").status.rejected["recovered after rejections"] == 1


def test_slant_range_never_moves_height_and_corrects_along_the_line_of_sight_only():
    flight = straight(60.0)
    nav = quiet(STATIONS)
    nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 10.0)))
    nav.core.P[0, 0] += 500.0**2
    nav.core.P[1, 1] += 500.0**2
    before, start = nav.core.nav.copy(), ORIGIN.to_ned(*nav.core.nav)
    k = int(np.searchsorted(flight.stamps_ns, nav.core.t_ns))
    target = next(iter(STATIONS))
    line = (flight.ned[k] - ORIGIN.to_ned(target.lat, target.lon, target.height))[0:2]
    line /= np.linalg.norm(line)
    reply = next(m for m in flight.ranges(table(target), zeros(flight, AAA=300.0), k) if m.station == "AAA")
    assert nav.use_aid(nav.aid("dme"), SlantRange(nav.core.t_ns, reply.source, "AAA", reply.range_m, reply.variance))
    moved = ORIGIN.to_ned(*nav.core.nav) - start
    assert nav.core.nav[2] == before[2]
    assert moved[0:2] @ line > 100.0
    assert abs(moved[0] * line[1] - moved[1] * line[0]) < 0.05 * abs(moved[0:2] @ line)


def test_dme_holds_what_dead_reckoning_alone_would_lose():
    flight = turning(900.0)
    wind = flight.wind + np.linspace(0.0, 12.0, len(flight))[:, None] * np.array([1.0, 0.5])  # the wind turns after GPS is gone
    flight = Flight(flight.dt, flight.heading, flight.speed, wind)
    parts = (list(flight.attitudes()), list(flight.airspeeds()), gps_until(flight, 150.0))
    aided, alone = quiet(STATIONS), quiet()
    last = aided.feed_all(in_order(*parts, flight.ranges(STATIONS, zeros(flight), 150)))[-1]
    free = alone.feed_all(in_order(*parts))[-1]
    assert last.mode == "dme_aided"
    assert np.linalg.norm(error_at(flight, last)[0:2]) < 400.0 < 2000.0 < np.linalg.norm(error_at(flight, free)[0:2])
    assert np.linalg.norm(last.wind_n - wind[-1]) < 5.0


def flown_on(stations, flight, idents, seconds=150.0):
    nav = quiet(stations)
    heard = table(*(s for s in stations if s.ident in idents))
    nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 60.0), flight.ranges(heard, zeros(flight), 150)))
    return nav


@pytest.mark.parametrize(
    ("stations", "word"),
    [
        ((station("AAA", 40_000.0, 30_000.0),), "single station"),
        ((station("AAA", 60_000.0, -500.0), station("BBB", 90_000.0, 300.0)), "stations collinear with track"),
        ((station("AAA", 9_000.0, 30_000.0), station("BBB", 9_000.0, -30_000.0)), "mirror ambiguity possible"),
        ((station("AAA", 40_000.0, 30_000.0), station("BBB", 40_000.0, -30_000.0)), ""),
    ],
    ids=["single", "collinear", "mirror", "sound"],
)
def test_poor_geometry_is_named(stations, word):
    nav = flown_on(table(*stations), straight(167.0), {s.ident for s in stations})
    assert nav.geometry == word
    assert nav.mode == "dme_aided"
    assert word in nav.status().reason


def on_either_side(north_m):
    """Two stations 5 km south of the start, which is believed to lie ``north_m`` north; what a navigator makes of it, and the flight."""
    flight, stations = straight(200.0), table(station("AAA", -5_000.0, 30_000.0), station("BBB", -5_000.0, -30_000.0))
    stream = in_order(flight.attitudes(), flight.airspeeds(), flight.ranges(stations, zeros(flight), 150))
    nav = navigator(stations)
    nav.start_at(START_NS, *ORIGIN.from_ned(np.array([north_m, 0.0, 0.0])), 5_000.0)
    return nav, stream, flight


def test_a_start_on_the_wrong_side_of_the_line_of_stations_is_found_out_by_history():
    nav, stream, flight = on_either_side(-10_000.0)
    out = nav.feed_all(stream)
    error = error_at(flight, out[-1])
    assert nav.mirror.moved_ns is not None and "taken to the mirror place" in nav.status().reason
    assert math.hypot(*error[0:2]) < 300.0  # without a second place 30 km, sure to 600 m
    assert abs(error[0]) < 3.0 * math.sqrt(out[-1].cov_pos[0, 0])
    again, stream, _ = on_either_side(-10_000.0)
    rng = np.random.default_rng(5)
    other = again.feed_all(sorted(stream, key=lambda m: m.stamp_ns + rng.uniform(0.0, 0.24e9)))
    assert [s.lat for s in out] == [s.lat for s in other]


def test_a_start_on_the_right_side_stays_there():
    nav, stream, flight = on_either_side(0.0)
    out = nav.feed_all(stream)
    assert nav.mirror.moved_ns is None and nav.mirror.core is None and nav.mirror.log_odds > 9.0
    assert np.abs(error_at(flight, out[-1])[0:2]).max() < 300.0


def test_unknown_stations_and_missing_tables_are_refused_by_name():
    flight = straight(100.0)
    parts = (list(flight.attitudes()), list(flight.airspeeds()), gps_until(flight, 30.0))
    other = table(station("CCC", 40_000.0, 30_000.0))
    nav = navigator(STATIONS)
    nav.feed_all(in_order(*parts, flight.ranges(other, zeros(flight), 150)))
    assert nav.aid("dme").status.rejected == {"station unknown": 6}
    assert nav.aid("dme").status.reason == "station unknown: CCC"
    nav = navigator()
    nav.feed_all(in_order(*parts, flight.ranges(other, zeros(flight), 150)))
    assert nav.aid("dme").status.rejected == {"no station table": 6}


def test_a_range_far_off_is_rejected_and_one_a_little_off_is_limited():
    flight = straight(160.0)
    parts = (list(flight.attitudes()), list(flight.airspeeds()), gps_until(flight, 30.0))
    far, near = quiet(STATIONS), quiet(STATIONS)
    far.feed_all(in_order(*parts, flight.ranges(STATIONS, zeros(flight, AAA=20_000.0, BBB=20_000.0), 150)))
    near.feed_all(in_order(*parts, flight.ranges(STATIONS, zeros(flight, AAA=1800.0, BBB=-1800.0), 150)))
    assert far.aid("dme").status.rejected["innovation beyond gate"] >= 8
    assert far.mode == "coasting"
    assert near.aid("dme").status.rejected["innovation limited"] >= 4


def test_an_unconfirmed_airspeed_is_doubted_at_the_mirror_place_too():
    flight = straight(20.0)
    nav = quiet(STATIONS)
    nav.feed_all(in_order(list(flight.attitudes()), list(flight.airspeeds()), gps_until(flight, 20.0)))
    nav.mirror.core = nav.core.branch()
    cores, rows = (nav.core, nav.mirror.core), nav.layout["airspeed_bias"]
    for core in cores:
        core.settle()
    before = [core.P[rows, rows].item() for core in cores]
    nav._unconfirmed.take = lambda stamp_ns, speed, *, confirmed: 4.0
    nav._confirm_air(nav.core.t_ns)
    assert [core.P[rows, rows].item() for core in cores] == pytest.approx([b + 4.0 for b in before])


def test_a_limited_innovation_is_worth_less():
    """Huber: it moves the state as one at the edge of the gate would, S times the root of the test ratio, and teaches that much less."""
    flight = straight(60.0)
    nav = quiet(STATIONS)
    nav.feed_all(in_order(list(flight.attitudes()), list(flight.airspeeds()), gps_until(flight, 30.0)))
    aid, applied = nav.aid("dme"), []
    P, y, H = nav.P.copy(), np.array([900.0]), np.zeros((1, len(nav.P)))
    H[0, 0], R = 1.0, np.array([[100.0]])
    S = H @ P @ H.T + R
    aid.innovation = lambda measurement, host: Innovation(y.copy(), H, R.copy(), y)
    aid.prepare = lambda measurement, innovation, host: innovation
    aid.control = lambda *args: (Decision.LIMIT, "innovation limited")
    nav.correct = applied.append
    assert aid.process(Measurement(nav.core.t_ns, "dme/range"), nav)
    root = np.sqrt(float(y @ np.linalg.solve(S, y)) / aid.threshold)
    gain = P @ H.T / (root * S)
    assert applied[0] == pytest.approx((gain @ y), rel=1e-6, abs=1e-9)
    assert np.allclose(nav.P, P - gain @ H @ P, rtol=1e-6, atol=1e-9)


def test_alert_when_the_believed_error_passes_half_a_mile():
    flight = straight(600.0, dt=0.5)
    nav = navigator()
    out = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 60.0, every=2)))
    status = nav.status()
    assert status.level == Level.ERROR
    assert "ALERT" in status.reason and "0.5 NM" in status.reason
    assert status.sigmas["position_horizontal_m"] > 926.0
    assert out[-1].mode == "coasting"


def test_silent_airspeed_fails_the_mode_and_the_sigma_runs_away():
    flight = straight(120.0)
    nav = quiet()
    air = [m for m in flight.airspeeds() if m.stamp_ns < START_NS + 60e9]
    nav.feed_all(in_order(flight.attitudes(), air, gps_until(flight, 40.0)))
    assert nav.mode == "failed"
    assert nav.status().reason.startswith("no airspeed for")
    assert nav.status().sigmas["position_horizontal_m"] > 1000.0
    assert nav.status().level == Level.ERROR


def test_silent_airspeed_is_one_phrase_to_count_by_however_long_it_lasts():
    flight = straight(120.0)
    nav = quiet()
    air = [m for m in flight.airspeeds() if m.stamp_ns < START_NS + 60e9]
    nav.feed_all(in_order(flight.attitudes(), air, gps_until(flight, 120.0)))
    velocity = nav.aid("gps_velocity").status
    assert velocity.reason == "no airspeed for 59 s"
    assert set(velocity.rejected) == {"no airspeed"} and velocity.rejected["no airspeed"] > 20


def test_airspeed_that_collapses_without_gps_is_not_believed_to_be_a_landing():
    flight = straight(120.0)
    nav = quiet()
    blocked = Flight(flight.dt, flight.heading, np.where(np.arange(len(flight)) * flight.dt < 60.0, 50.0, 0.5), flight.wind)
    out = nav.feed_all(in_order(flight.attitudes(), blocked.airspeeds(), gps_until(flight, 50.0)))
    error = np.linalg.norm(error_at(flight, out[-1])[0:2])
    assert error > 2500.0
    assert error < 3.0 * nav.status().sigmas["position_horizontal_m"]
    assert "landed, or airspeed failed" in nav.status().reason


def test_on_the_ground_nothing_is_learned_about_the_wind():
    flight = straight(60.0, speed=3.0, wind=(0.0, 0.0))
    nav = navigator()
    out = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 1e9)))
    assert np.array_equal(out[-1].wind_n, [0.0, 0.0])
    assert nav.aid("gps_velocity").status.rejected["below the minimum airspeed"] > 50
    assert "on the ground" in nav.status().reason
    assert np.linalg.norm(error_at(flight, out[-1])[0:2]) < 10.0


def test_pressure_altitude_carries_height_with_the_bias_that_gps_taught():
    t = np.arange(0.0, 300.0, 0.1)
    flight = straight(300.0)
    climb = np.where(t < 150.0, 0.0, 3.0 * (t - 150.0))
    flight.ned[:, 2] = -climb
    flight.lat, flight.lon, flight.height = ORIGIN.from_ned(flight.ned)
    bias = 85.0
    columns = zip(flight.stamps_ns, pressure_at(flight.height + bias), strict=True)
    pressures = [Pressure(int(stamp), "air/static_pressure", float(pascal), 25.0) for stamp, pascal in columns]
    nav = quiet()
    last = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), pressures[::2], gps_until(flight, 120.0)))[-1]
    assert abs(error_at(flight, last)[2]) < 12.0
    assert last.vel_n[2] == pytest.approx(-3.0, abs=0.5)
    bare = quiet()
    last = bare.feed_all(in_order(flight.attitudes(), flight.airspeeds(), gps_until(flight, 120.0)))[-1]
    assert math.sqrt(last.cov_pos[2, 2]) > 150.0  # GPS height is held and nobody claims to know it


def test_inputs_that_are_missing_are_named():
    flight = straight(20.0)
    nav = navigator()
    nav.feed_all(flight.airspeeds())
    assert (nav.mode, nav.reason) == ("initialising", "no attitude yet")
    nav = navigator()
    nav.feed_all(in_order(flight.attitudes(), flight.airspeeds()))
    assert (nav.mode, nav.reason) == ("aligning", "waiting for the first GPS fix")
    assert nav.output() is None


def test_a_given_position_replaces_the_first_fix():
    flight = straight(30.0)
    nav = quiet()
    nav.start_at(START_NS, ORIGIN.lat, ORIGIN.lon, ORIGIN.height, 5.0)
    nav.core.know_wind(np.array([5.0, -3.0]), 0.5)
    last = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds()))[-1]
    assert np.linalg.norm(error_at(flight, last)[0:2]) < 5.0
    np.testing.assert_allclose(last.wind_n, [5.0, -3.0], atol=0.1)


@pytest.mark.parametrize(("dt", "tau"), [(0.2, 5.0), (1.0, 5.0), (30.0, 5.0)])
def test_correlated_samples_carry_what_their_autocorrelation_leaves(dt, tau):
    """Variance of the mean of many samples of a first-order autoregression, summed directly."""
    n = 4000
    k = np.arange(1, n)
    direct = 1.0 + 2.0 * np.sum((1.0 - k / n) * np.exp(-k * dt / tau))
    assert correlation_factor(dt, tau) == pytest.approx(direct, rel=0.02)
