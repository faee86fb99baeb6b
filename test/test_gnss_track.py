"""A whole recording located, on RINEX text of a receiver whose place and clock are known: what is found, left out and said."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rinex_text import DAY, ephemerides, navigation_text, observation_text, seen_at

from lowcostnav_ros.gnss.clock_watch import MILLISECOND_M
from lowcostnav_ros.gnss.gps_time import SECOND, gps_ns
from lowcostnav_ros.gnss.rinex_nav import joined, parse_navigation
from lowcostnav_ros.gnss.rinex_obs import parse_observations
from lowcostnav_ros.gnss.track import track
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef

LAT, LON = math.radians(38.7), math.radians(-9.1)
PLACE = geodetic_to_ecef(LAT, LON, 120.0)
SATELLITES = ephemerides()
NAVIGATION = parse_navigation(navigation_text(SATELLITES))


def epochs(seconds, clock_m=lambda s: 3.0e4, change=lambda s, seen: seen, place=lambda s: PLACE, **options):
    """Epochs of a receiver: its clock and place over time, and what is changed of what it saw."""
    return [(s, change(s, seen_at(SATELLITES, s, place(s), clock_m(s), **options))) for s in seconds]


def located(made, navigation=NAVIGATION):
    return track(parse_observations(observation_text(made)).epochs, navigation)


def errors(out):
    return np.array([np.linalg.norm(one.result.fix.position_e - PLACE) for one in out.located])


def test_position_clock_and_velocity_of_a_known_receiver():
    def moved(s):
        return PLACE + dcm_ne(LAT, LON).T @ np.array([30.0 * s, -40.0 * s, 0.0])

    out = located(epochs((0.0, 1.0, 2.0), clock_m=lambda s: 3.0e4 + 12.0 * s, place=moved))
    assert out.verdicts() == {"healthy": 3} and not out.remarks and not out.rejected
    for one, s in zip(out.located, (0.0, 1.0, 2.0), strict=True):
        fix = one.result.fix
        assert fix.position_e == pytest.approx(moved(s), abs=0.02)
        assert fix.clocks_m["G"] == pytest.approx(3.0e4 + 12.0 * s, abs=0.02)
        assert gps_ns(one.epoch.stamp_ns) == pytest.approx(DAY + s * SECOND - fix.clocks_m["G"] / 0.299792458, abs=2)


def test_velocity_comes_with_the_dopplers_only():
    def still(s):
        return 3.0e4

    with_, without = (
        track(parse_observations(observation_text(epochs((0.0,), still), doppler=d)).epochs, NAVIGATION).located[0] for d in (True, False)
    )
    assert with_.velocity.vel_n == pytest.approx(np.zeros(3), abs=0.05)
    assert without.velocity is None and not without.epoch.doppler_valid.any()


def test_what_has_no_ephemeris_is_ill_or_stands_below_the_horizon_is_left_out_by_name():
    used = sorted(epochs((0.0,))[0][1])
    absent, ill = (int(name[1:]) for name in used[:2])
    navigation = parse_navigation(navigation_text([e for e in ephemerides(unhealthy=(ill,)) if e.sat_id != absent]))
    everything = epochs((0.0,), lowest_deg=-10.0)
    below = [n for n in everything[0][1] if n not in epochs((0.0,), lowest_deg=0.0)[0][1]]
    low = [n for n in epochs((0.0,), lowest_deg=0.0)[0][1] if n not in epochs((0.0,), lowest_deg=10.0)[0][1]]
    out = located(everything, navigation)
    assert below and low
    assert out.rejected == {
        "no ephemeris": 1, "satellite unhealthy": 1, "below the horizon": len(below), "below the elevation mask": len(low),
    }  # fmt: skip
    assert out.verdicts() == {"healthy": 1} and errors(out)[0] < 0.05


def test_nothing_to_compute_with_says_why():
    galileo = parse_navigation(navigation_text([replace(SATELLITES[0], sat_id=32)]))
    out = located(epochs((0.0, 30.0)), galileo)
    assert out.verdicts() == {"no position": 2}
    assert out.rejected["no ephemeris"] == sum(one.satellites for one in out.located)
    assert "0 satellites give no position" in out.located[0].refusal
    assert out.located[0].epoch is None


def test_a_fault_is_excluded_and_two_make_the_epoch_faulty():
    def faults(s, seen):
        names = sorted(seen)[: int(s)]
        return {n: (code + 500.0 * (1 + names.index(n)) if n in names else code, rate) for n, (code, rate) in seen.items()}

    out = located(epochs((0.0, 1.0, 2.0, 3.0), change=faults))
    assert [one.verdict for one in out.located] == ["healthy", "excluded", "faulty", "faulty"]
    assert out.located[1].result.excluded == sorted(epochs((1.0,))[0][1])[0]
    assert not out.located[2].usable and out.located[2].epoch is not None  # corrected at the last good position
    assert errors(out)[1] < 0.05


def test_an_epoch_of_three_satellites_is_corrected_at_the_last_good_place_for_a_minute():
    def few(s, seen):
        return seen if s == 0.0 else dict(list(seen.items())[:3])

    out = located(epochs((0.0, 60.0, 61.0), change=few))
    assert [one.verdict for one in out.located] == ["healthy", "no position", "no position"]
    held = out.located[1].epoch
    assert len(held) == 3 and out.located[2].epoch is None
    ranges = np.linalg.norm(held.sat_pos_e - PLACE, axis=1)
    assert held.pseudorange_m - ranges == pytest.approx(np.full(3, 3.0e4), abs=0.05)


def test_a_clock_that_is_set_is_followed_and_said():
    out = located(epochs((0.0, 1.0, 2.0), clock_m=lambda s: 1.0e4 - MILLISECOND_M * (s >= 1.0)))
    assert out.resets == 1 and out.remarks == [(DAY + SECOND, "The receiver set its clock by -1 ms.")]
    assert out.runaway_epochs == 0 and np.all(errors(out) < 0.05)


def test_a_clock_that_runs_away_is_said_once_and_counted():
    def clock(s):
        return 5000.0 * s

    out = located(epochs((0.0, 1.0, 2.0, 3.0), clock_m=clock))
    assert out.runaway_epochs == 3 and len(out.remarks) == 1
    assert "The receiver clock runs away at 5000 m/s (16.7 ppm)" in out.remarks[0][1]


def test_a_pseudorange_that_jumps_alone_is_left_out():
    def jump(s, seen):
        first = sorted(seen)[0]
        return {n: (code + MILLISECOND_M * (n == first and s == 1.0), rate) for n, (code, rate) in seen.items()}

    out = located(epochs((0.0, 1.0), change=jump))
    assert out.rejected == {"pseudorange jumped alone": 1} and "leave it out" in out.remarks[0][1]
    assert out.verdicts() == {"healthy": 2} and np.all(errors(out) < 0.05)


def test_after_a_long_journey_the_last_place_is_no_start_and_is_given_up():
    far = geodetic_to_ecef(LAT - 1.2, LON + 1.5, 0.0)
    out = located(epochs((0.0, 3000.0), place=lambda s: PLACE if s == 0.0 else far))
    assert out.located[1].result.fix.position_e == pytest.approx(far, abs=0.05)


def test_navigation_files_of_several_systems_are_joined():
    galileo = replace(SATELLITES[4], system="E", sat_id=11, sqrt_a=5440.6, valid_s=14400.0)
    parts = [parse_navigation(navigation_text(part, 3.04)) for part in (SATELLITES, [SATELLITES[2]])]
    both = joined([*parts, parse_navigation(navigation_text([galileo], 3.04))])
    assert ("E", 11) in both.store.satellites() and len(both.store) == 33
    assert both.rejected == {"repeated ephemeris": 1} and both.klobuchar is None
