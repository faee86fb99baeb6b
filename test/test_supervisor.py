"""The supervisor: the mode table, the choice in an outage, changes without a jump, sentences for people."""

import itertools
import math

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, NavSolution
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.navigators.supervisor.modes import MODES, Facts, Gps, next_mode
from lowcostnav_ros.navigators.supervisor.navigator import Supervisor, SupervisorSettings
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_conjugate, quat_multiply, rotvec_from_quat

ORIGIN = LocalFrame(math.radians(37.7), math.radians(-121.8), 600.0)
T0 = 1_000_000_000_000
VEL = np.array([50.0, 0.0, 0.0])
INS, DR = "ins_gps/odometry_fused", "dead_reckoning/odometry_fused"


# ---- the table

FLIGHT = [  # mode, GPS, next mode: written from figures 2.2 and 2.3
    ("initialising", Gps.LOST, "coasting"),  # restarted in the air
    ("initialising", Gps.GOOD, "calibrating"),
    ("calibrating", Gps.GOOD, "calibrating"),
    ("calibrating", Gps.COARSE, "gps"),
    ("calibrating", Gps.LOST, "coasting"),
    ("gps", Gps.GOOD, "calibrating"),
    ("gps", Gps.LOST, "coasting"),
    ("coasting", Gps.LOST, "coasting"),
    ("coasting", Gps.SEEN, "re_acquiring"),
    ("re_acquiring", Gps.SEEN, "re_acquiring"),
    ("re_acquiring", Gps.LOST, "coasting"),
    ("re_acquiring", Gps.GOOD, "calibrating"),
    ("re_acquiring", Gps.COARSE, "gps"),
    ("failed", Gps.LOST, "coasting"),
    ("failed", Gps.SEEN, "re_acquiring"),
    ("no_go", Gps.LOST, "coasting"),
]
GROUND = [
    ("initialising", Gps.LOST, "initialising"),
    ("initialising", Gps.GOOD, "calibrating"),
    ("calibrating", Gps.LOST, "no_go"),
    ("gps", Gps.LOST, "no_go"),
    ("no_go", Gps.LOST, "no_go"),
    ("no_go", Gps.GOOD, "calibrating"),
    ("no_go", Gps.COARSE, "gps"),
    ("coasting", Gps.LOST, "coasting"),
]


@pytest.mark.parametrize(("mode", "gps", "expected"), FLIGHT)
def test_table_in_flight(mode, gps, expected):
    assert next_mode(mode, Facts(gps, airborne=True, solution=True)) == expected


@pytest.mark.parametrize(("mode", "gps", "expected"), GROUND)
def test_table_on_the_ground(mode, gps, expected):
    assert next_mode(mode, Facts(gps, airborne=False, solution=True)) == expected


def test_start_without_gps_forbids_departure_after_a_while():
    assert next_mode("initialising", Facts(Gps.LOST, False, True, waited=True)) == "no_go"
    assert next_mode("initialising", Facts(Gps.LOST, False, False, waited=True)) == "no_go"


def test_every_mode_has_a_successor_and_no_solution_fails():
    for mode, gps, airborne in itertools.product(MODES, Gps, (True, False)):
        assert next_mode(mode, Facts(gps, airborne, True)) in MODES
    for mode in ("calibrating", "gps", "coasting", "re_acquiring"):
        assert next_mode(mode, Facts(Gps.GOOD, True, False)) == "failed"


# ---- in flight


def place(t_s, offset=(0.0, 0.0, 0.0)):
    return ORIGIN.from_ned(VEL * t_s + np.asarray(offset))


def solution(source, t_s, sigma, offset=(0.0, 0.0, 0.0), heading_deg=0.0, drift=(0.0, 0.0, 0.0)):
    q = euler_to_quat(0.0, 0.0, math.radians(heading_deg))
    small = 1e-4 * np.eye(3)
    return NavSolution(
        *(T0 + round(1e9 * t_s), source, *place(t_s, offset), VEL + np.array(drift), q, np.zeros(3), None),
        *(sigma**2 * np.eye(3), 0.01 * np.eye(3), small),
    )


def fix(t_s, offset=(0.0, 0.0, 0.0), sigma=2.0):
    return GpsPosition(T0 + round(1e9 * t_s), "gps/fix", *place(t_s, offset), sigma**2 * np.eye(3))


def fly(supervisor, seconds, *tracks):
    """Feed tracks ``t -> measurement or None`` every 0.1 s."""
    out = []
    for t in np.arange(seconds[0], seconds[1], 0.1):
        for track in tracks:
            item = track(round(float(t), 1))
            if item is not None:
                out += supervisor.feed(item)
    return out


def gps(t, begin=0.0, end=0.0, **changes):
    """A fix each second, none from ``begin`` to ``end``."""
    whole = abs(t - round(t)) < 1e-6
    return fix(t, **changes) if whole and not begin <= t < end else None


def jumps(out):
    """Largest step of position against the own velocity, m, and of attitude, rad, between consecutive solutions."""
    ned = ORIGIN.to_ned(*(np.array([getattr(s, name) for s in out]) for name in ("lat", "lon", "height")))
    dt = np.diff([s.stamp_ns for s in out]) * 1e-9
    position = np.linalg.norm(np.diff(ned, axis=0) - VEL * dt[:, None], axis=1)
    attitude = [np.linalg.norm(rotvec_from_quat(quat_multiply(b.q_nb, quat_conjugate(a.q_nb)))) for a, b in itertools.pairwise(out)]
    return position.max(), max(attitude)


def outage_flight(**settings):
    """GPS lost from 30 s to 90 s; inertial sigma grows fast, dead reckoning slowly; both drift north."""
    supervisor = Supervisor(from_mapping(SupervisorSettings, settings))

    def ins(t):
        lost = max(t - 30.0, 0.0) if t < 90.0 else 0.0
        return solution(INS, t, 2.0 + 0.1 * lost**2, (0.05 * lost**2, 0.0, 0.0), 0.1 * lost, (0.1 * lost, 0.0, 0.0))

    def dr(t):
        lost = max(t - 30.0, 0.0) if t < 90.0 else 0.0
        return solution(DR, t, 5.0 + 1.5 * lost, (0.0, 1.0 * lost, 0.0), 3.0, (0.0, float(lost > 0.0), 0.0))

    return supervisor, fly(supervisor, (0.0, 120.0), ins, dr, lambda t: gps(t, 30.0, 90.0))


def test_it_begins_anew_without_a_core():
    supervisor = Supervisor()
    supervisor.reset("time base jumped")
    assert supervisor.mode == "initialising" and supervisor.restarts["time base jumped"] == 1


def test_modes_of_an_outage_in_order():
    _, out = outage_flight()
    assert [mode for mode, _ in itertools.groupby(s.mode for s in out)] == ["calibrating", "coasting", "re_acquiring", "calibrating"]
    times = {mode: min(1e-9 * (s.stamp_ns - T0) for s in out if s.mode == mode) for mode in ("coasting", "re_acquiring")}
    assert times["coasting"] == pytest.approx(32.1, abs=0.3)  # 3 s after the last fix at 29 s
    assert times["re_acquiring"] == pytest.approx(90.0, abs=0.3)


def test_the_smaller_believed_error_is_flown_with_reasons():
    supervisor, _ = outage_flight()
    assert [(s.before, s.after) for s in supervisor.switches] == [
        (None, "ins_gps"),
        ("ins_gps", "dead_reckoning"),
        ("dead_reckoning", "ins_gps"),
    ]
    assert "estimated error" in supervisor.switches[1].reason
    assert supervisor.switches[2].reason == "GPS is good" or "estimated error" in supervisor.switches[2].reason
    assert "flying on ins_gps" in supervisor.status().reason


def test_neither_position_nor_attitude_jumps_at_a_change():
    supervisor, out = outage_flight()
    position, attitude = jumps(out)
    apart = 0.05 * 20.0**2
    assert position < 0.1 * apart  # the two solutions were tens of metres apart
    assert attitude < math.radians(0.5)  # and one to three degrees


def test_the_sigma_covers_the_difference_that_is_carried_along():
    supervisor, out = outage_flight()
    change = supervisor.switches[1].stamp_ns
    at = next(s for s in out if s.stamp_ns == change)
    t = 1e-9 * (change - T0)
    true = VEL * t
    error = true - ORIGIN.to_ned(at.lat, at.lon, at.height)
    source_sigma = 5.0 + 1.5 * (t - 30.0)
    assert at.cov_pos[0, 0] > source_sigma**2 + 0.9 * (0.05 * (t - 30.0) ** 2) ** 2
    assert np.all(np.abs(error[0:2]) < 3.0 * np.sqrt(np.diag(at.cov_pos)[0:2]))
    later = next(s for s in out if s.stamp_ns == change + 15_000_000_000)
    assert later.cov_pos[0, 0] == pytest.approx((5.0 + 1.5 * (t + 15.0 - 30.0)) ** 2, rel=0.05)  # five time constants later it is gone


def test_hysteresis_keeps_two_equal_solutions_from_alternating():
    supervisor = Supervisor()
    rng = np.random.default_rng(3)
    noisy = {source: lambda t, s=source: solution(s, t, 100.0 * float(rng.uniform(0.9, 1.1))) for source in (INS, DR)}
    fly(supervisor, (0.0, 10.0), lambda t: solution(INS, t, 2.0), lambda t: solution(DR, t, 5.0), gps)
    fly(supervisor, (10.0, 100.0), noisy[INS], noisy[DR])
    assert len(supervisor.switches) == 1


def test_a_source_that_jumps_home_is_blended_too():
    supervisor = Supervisor()

    def track(t):
        return solution(INS, t, 80.0, (150.0, 0.0, 0.0)) if t < 50.0 else solution(INS, t, 2.0)

    out = fly(supervisor, (0.0, 80.0), track, lambda t: solution(DR, t, 1000.0), lambda t: gps(t, 0.5, 1e9))
    position, _ = jumps(out)
    assert position < 10.0
    assert len(supervisor.switches) == 1


def test_large_differences_die_away_and_never_build_up():
    """A kilometre at once, then jumps of a hundred metres every 15 s as ranges make them."""
    supervisor = Supervisor()

    def reckoning(t):
        return solution(DR, t, 30.0, (1000.0 if t > 20.0 else 0.0, 100.0 * (int(t / 15.0) % 2), 0.0))

    out = fly(supervisor, (0.0, 120.0), reckoning, lambda t: gps(t, 3.0, 1e9))
    position, _ = jumps(out)
    assert position < 1000.0 * 0.1 / 3.0 * 1.1  # what dies away in one period
    for s in out:
        t = 1e-9 * (s.stamp_ns - T0)
        if t > 45.0 and t % 15.0 > 14.0:
            source = reckoning(t)
            assert np.linalg.norm(ORIGIN.to_ned(s.lat, s.lon, s.height) - ORIGIN.to_ned(source.lat, source.lon, source.height)) < 3.0


def test_whatever_lives_is_flown_and_nothing_is_published_when_nothing_does():
    supervisor = Supervisor()

    def until(end, source, sigma):
        return lambda t: solution(source, t, sigma) if t < end else None

    out = fly(supervisor, (0.0, 60.0), until(20.0, INS, 2.0), until(40.0, DR, 9.0), gps)
    assert supervisor.switches[-1].reason == "ins_gps timed out"
    assert max(1e-9 * (s.stamp_ns - T0) for s in out) < 41.5
    assert supervisor.mode == "failed"
    assert supervisor.status().level == Level.ERROR
    assert "last one is held" in supervisor.status().reason


def test_no_departure_without_gps():
    supervisor = Supervisor()
    for t in np.arange(0.0, 70.0, 0.1):
        supervisor.feed(NavSolution(T0 + round(1e9 * t), DR, *place(0.0), np.zeros(3), cov_pos=25.0 * np.eye(3)))
    assert supervisor.mode == "no_go"
    assert "do not depart" in supervisor.status().reason
    assert supervisor.status().level == Level.ERROR


def test_coarse_gps_stays_primary_without_a_precise_approach():
    supervisor = Supervisor()
    fly(supervisor, (0.0, 20.0), lambda t: solution(INS, t, 2.0), lambda t: gps(t, sigma=12.0))
    assert supervisor.mode == "gps"
    assert "no precision approach" in supervisor.status().reason
    assert supervisor.status().level == Level.OK


def test_gps_that_disagrees_counts_as_lost():
    supervisor = Supervisor()
    fly(supervisor, (0.0, 20.0), lambda t: solution(INS, t, 2.0), gps)
    fly(supervisor, (20.0, 40.0), lambda t: solution(INS, t, 2.0), lambda t: gps(t, offset=(300.0, 0.0, 0.0)))
    assert supervisor.mode in ("coasting", "re_acquiring")


def test_a_solution_that_disagrees_with_gps_is_left_for_one_that_agrees():
    supervisor = Supervisor()
    fly(supervisor, (0.0, 20.0), lambda t: solution(INS, t, 2.0), lambda t: solution(DR, t, 5.0), gps)
    fly(supervisor, (20.0, 40.0), lambda t: solution(INS, t, 2.0, (200.0, 0.0, 0.0)), lambda t: solution(DR, t, 5.0), gps)
    assert supervisor.mode == "calibrating"
    assert supervisor.active == "dead_reckoning"
    assert supervisor.switches[-1].reason == "ins_gps: way and velocity disagree"
    assert len(supervisor.switches) == 2


def test_a_solution_without_attitude_gets_that_of_the_ahrs():
    supervisor = Supervisor()
    q = euler_to_quat(0.1, 0.05, 1.0)

    def bare(t):
        s = solution(DR, t, 5.0)
        return NavSolution(s.stamp_ns, DR, s.lat, s.lon, s.height, VEL, cov_pos=s.cov_pos, cov_vel=s.cov_vel)

    def attitude(t):
        return Attitude(T0 + round(1e9 * t), "imu/data_fused", q, 1e-4 * np.eye(3), np.zeros(3), None)

    out = fly(supervisor, (0.0, 5.0), bare, attitude, gps)
    np.testing.assert_allclose(out[-1].q_nb, q, atol=1e-12)


def test_any_arrival_order_within_the_lag_gives_the_same_bits():
    items = []
    for t in np.arange(0.0, 60.0, 0.1):
        t = round(float(t), 1)
        items += [solution(INS, t, 2.0 + t), solution(DR, t, 30.0, (5.0, 0.0, 0.0)), gps(t, 20.0, 40.0)]
    items = [i for i in items if i is not None]
    rng = np.random.default_rng(4)
    shuffled = sorted(items, key=lambda m: m.stamp_ns + rng.uniform(0.0, 0.45e9))
    a, b = Supervisor().feed_all(items), Supervisor().feed_all(shuffled)
    assert len(a) == len(b) > 500
    for x, y in zip(a, b, strict=True):
        assert (x.stamp_ns, x.lat, x.lon, x.mode) == (y.stamp_ns, y.lat, y.lon, y.mode)
        assert np.array_equal(x.cov_pos, y.cov_pos)


def test_the_low_latency_output_reaches_the_newest_stamp():
    supervisor = Supervisor()
    fly(supervisor, (0.0, 10.0), lambda t: solution(INS, t, 2.0), gps)
    ahead = supervisor.output()
    t = 1e-9 * (ahead.stamp_ns - T0)
    assert t == pytest.approx(9.9)
    assert np.linalg.norm(ORIGIN.to_ned(ahead.lat, ahead.lon, ahead.height) - VEL * t) < 0.1
