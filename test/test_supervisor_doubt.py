"""A supervisor that doubts: solutions that contradict themselves, one another or GPS; what navigators say of themselves."""

from dataclasses import replace

import numpy as np
import pytest
from test_supervisor import DR, INS, ORIGIN, T0, VEL, fly, gps, place, solution

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, Health
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.navigators.supervisor.navigator import Supervisor

FAULT_S = 60.0


def growing(source, t, rate):
    """A solution whose sigma grows without GPS from 20 s on."""
    return solution(source, t, 2.0 + rate * max(t - 20.0, 0.0))


def faulty(kind, name, t):
    """The inertial solution, with a fault from 60 s on."""
    good = growing(INS, t, 0.5)
    if t < FAULT_S:
        return good
    if kind == "frozen":
        return replace(growing(INS, FAULT_S, 0.5), stamp_ns=good.stamp_ns)
    offset = (1000.0 if kind == "jump" else 25.0 * (t - FAULT_S), 0.0, 0.0)
    return solution(INS, t, 1.0, offset)


def errors_over_sigma(out, true=lambda t: VEL * t):
    """Horizontal error over horizontal sigma of each solution."""
    ned = [true(1e-9 * (s.stamp_ns - T0)) - ORIGIN.to_ned(s.lat, s.lon, s.height) for s in out]
    return np.array([np.hypot(*e[:2]) / s.horizontal_sigma_m for e, s in zip(ned, out, strict=True)])


def velocity(t):
    """What the receiver says of its velocity, each second."""
    return GpsVelocity(T0 + round(1e9 * t), "gps/vel", VEL, 0.01 * np.eye(3)) if abs(t - round(t)) < 1e-6 else None


@pytest.mark.parametrize("with_gps", [False, True])
@pytest.mark.parametrize("kind", ["frozen", "jump", "runaway"])
def test_a_solution_that_contradicts_its_own_velocity_is_left(kind, with_gps):
    supervisor = Supervisor()
    out = fly(
        supervisor,
        (0.0, 90.0),
        lambda t: faulty(kind, INS, t),
        lambda t: growing(DR, t, 1.5),
        lambda t: gps(t, 20.0, 0.0 if with_gps else 1e9),
        velocity,
    )
    assert supervisor.active == "dead_reckoning"
    change = next(s for s in supervisor.switches if s.after == "dead_reckoning")
    assert 1e-9 * (change.stamp_ns - T0) < FAULT_S + (3.0 if kind != "runaway" else 8.0)
    assert "ins_gps" in change.reason
    assert np.mean(errors_over_sigma(out) > 4.0) < (0.01 if kind != "runaway" else 0.07)
    assert any(c.suspect == "ins_gps" for c in supervisor.status().contradictions)


def test_a_solution_sure_of_itself_is_not_taken_once_it_has_jumped():
    supervisor = Supervisor()
    fly(supervisor, (0.0, FAULT_S), lambda t: growing(INS, t, 1.5), lambda t: growing(DR, t, 1.5), lambda t: gps(t, 20.0, 1e9))
    fly(supervisor, (FAULT_S, 80.0), lambda t: growing(INS, t, 1.5), lambda t: solution(DR, t, 1.0, (1000.0, 0.0, 0.0)))
    assert supervisor.active == "ins_gps"
    assert len(supervisor.switches) == 1


def health(name, t, mode, level=2, restarts=0):
    return Health(T0 + round(1e9 * t), f"{name}/health", mode, level, "says the test", restarts, 0)


@pytest.mark.parametrize("mode", ["failed", "suspect"])
def test_a_solution_whose_navigator_doubts_it_is_left_for_a_sound_one(mode):
    supervisor = Supervisor()
    tracks = (lambda t: solution(INS, t, 2.0), lambda t: solution(DR, t, 5.0), gps)
    fly(supervisor, (0.0, 20.0), *tracks)
    fly(supervisor, (20.0, 30.0), lambda t: health("ins_gps", t, mode), *tracks)
    assert supervisor.active == "dead_reckoning"
    assert supervisor.switches[-1].reason.startswith(f"ins_gps says {mode}")


def test_gps_alone_is_flown_when_no_navigator_has_a_sound_solution_and_said_so():
    supervisor = Supervisor()
    tracks = (lambda t: solution(DR, t, 1.0, (0.0, 300.0 if t > 25.0 else 0.0, 0.0)), gps, velocity)
    fly(supervisor, (0.0, 20.0), *tracks)
    out = fly(supervisor, (20.0, 40.0), lambda t: health("dead_reckoning", t, "failed"), *tracks)
    assert supervisor.active == "gps"
    assert supervisor.mode == "gps"
    assert supervisor.status().level == Level.WARN
    assert errors_over_sigma(out)[-1] < 3.0


def test_two_solutions_that_nobody_can_tell_apart_are_both_covered():
    """Both drift within their own sigmas of velocity, too far apart for the sigmas of position."""
    supervisor = Supervisor()

    def ins(t):
        return solution(INS, t, 2.0, (1.0 * max(t - 20.0, 0.0), 0.0, 0.0), drift=(float(t > 20.0), 0.0, 0.0))

    def dr(t):
        return solution(DR, t, 1.0, (-1.0 * max(t - 20.0, 0.0), 0.0, 0.0), drift=(-float(t > 20.0), 0.0, 0.0))

    out = fly(supervisor, (0.0, 60.0), ins, dr, lambda t: gps(t, 20.0, 1e9))
    assert len(supervisor.switches) <= 2
    assert supervisor.status().level == Level.WARN
    assert "solutions disagree" in supervisor.status().reason
    own, other = ins(59.0), dr(59.0)
    apart = np.linalg.norm(ORIGIN.to_ned(own.lat, own.lon, own.height) - ORIGIN.to_ned(other.lat, other.lon, other.height))
    assert out[-1].horizontal_sigma_m > 0.9 * apart


def test_gps_that_a_solution_has_just_jumped_to_is_not_good():
    """A receiver that jumps by 5 km; the navigators follow it after a while, one after the other."""
    supervisor = Supervisor()
    away = np.array([5000.0, 0.0, 0.0])

    def navigator(source, sigma, follows_s):
        return lambda t: solution(source, t, sigma, away if t > follows_s else np.zeros(3))

    def receiver(t):
        return gps(t, offset=away if t >= 30.0 else (0.0, 0.0, 0.0))

    out = fly(supervisor, (0.0, 60.0), navigator(INS, 2.0, 40.0), navigator(DR, 5.0, 41.0), receiver, velocity)
    late = [s for s in out if s.stamp_ns > T0 + 34e9]
    assert not {s.mode for s in late} & {"calibrating", "gps"}
    assert (errors_over_sigma(late) < 4.0).all()
    assert supervisor.status().level != Level.OK


def test_fixes_that_never_change_in_flight_are_no_fixes():
    supervisor = Supervisor()

    def frozen(t):
        held = gps(t)
        return GpsPosition(held.stamp_ns, held.source, *place(30.0), held.cov_n) if held is not None and t > 30.0 else held

    fly(supervisor, (0.0, 40.0), lambda t: solution(INS, t, 2.0), frozen, velocity)
    assert supervisor.mode in ("coasting", "re_acquiring")
    assert "position does not change in flight" in supervisor.status().reason or "way and velocity" in supervisor.status().reason


def test_a_healthy_solution_is_never_doubted():
    rng = np.random.default_rng(5)
    supervisor = Supervisor()

    def noisy(source, sigma):
        return lambda t: solution(source, t, sigma, 0.3 * sigma * rng.standard_normal(3))

    out = fly(supervisor, (0.0, 120.0), noisy(INS, 2.0), noisy(DR, 5.0), lambda t: gps(t, offset=rng.standard_normal(3)), velocity)
    assert len(supervisor.switches) == 1
    assert not supervisor.status().contradictions
    assert {s.health.level for s in out if s.health is not None and s.stamp_ns > T0 + 10e9} == {Level.OK}


def test_a_turn_between_two_fixes_is_no_contradiction():
    """The velocity of a fix is that of its own stamp, whichever of the two comes first."""
    speed, rate = 50.0, 0.15

    def turning(t):
        angle = rate * t
        place = speed / rate * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        return place, speed * np.array([np.cos(angle), np.sin(angle), 0.0])

    supervisor = Supervisor()
    for k in range(80):
        stamp_ns, (offset, vel_n) = T0 + k * 500_000_000, turning(0.5 * k)
        lat, lon, height = place(0.0, offset)
        supervisor.feed(GpsPosition(stamp_ns, "gps/fix", lat, lon, height, np.eye(3)))
        supervisor.feed(GpsVelocity(stamp_ns, "gps/vel", vel_n, 0.01 * np.eye(3)))
        assert not supervisor.status().contradictions
