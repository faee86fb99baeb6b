"""Several headings at once: starts at any heading."""

import dataclasses
import random

import numpy as np
import pytest
from test_ins_gps import GPS_ONLY, errors, measurements

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, ImuBlock
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.headings import CELLS, HEADING
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.navigators.headings import WIDE, all_but_heading
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.settings import settings_class
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quat_to_euler, wrap
from lowcostnav_ros.reproduce.solimeno import flights
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

ANY = dataclasses.replace(GPS_ONLY, alignment=dataclasses.replace(GPS_ONLY.alignment, any_heading=True))


@pytest.fixture(scope="module")
def turning():
    mission = ["straight duration_s=30", "turn by_deg=180 bank_deg=25", "straight duration_s=10"]
    return build(standard("demo", kind="segments", mission=mission, duration_s=70.0)).table()


def sideways(stream, by_rad):
    """The same flight with an IMU that is turned in the vehicle, so that the track says nothing of its heading."""
    c, s = np.cos(by_rad), np.sin(by_rad)
    T = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = lambda v: v @ T.T  # noqa: E731
    return [
        dataclasses.replace(m, specific_force_b=turned(m.specific_force_b), angular_rate_b=turned(m.angular_rate_b))
        if isinstance(m, ImuBlock) else m
        for m in stream
    ]  # fmt: skip


@pytest.mark.parametrize("by_deg", [0.0, 100.0, 180.0])
def test_a_start_without_any_heading_finds_it_in_the_first_turn(turning, by_deg):
    navigator, by = InsGps(ANY), np.radians(by_deg)
    solutions = navigator.feed_all(sideways(measurements(turning, 3), by))
    t_s = np.array([1e-9 * (s.stamp_ns - turning.stamps_ns[0]) for s in solutions])
    rows = np.searchsorted(turning.stamps_ns, [s.stamp_ns for s in solutions])
    true = np.array([quat_to_euler(turning.q_nb[r])[2] for r in rows]) + by
    error = wrap(np.array([quat_to_euler(s.q_nb)[2] for s in solutions]) - true)
    sigma = np.sqrt([s.cov_att[2, 2] for s in solutions])
    assert sigma[t_s < 25.0].min() > np.radians(60.0)  # nothing shows it yet, and it says so
    assert np.degrees(np.abs(error[-1])) < 4.0
    assert np.degrees(sigma[-1]) < 3.0
    assert not navigator.headings.cores
    e, _ = errors(turning, solutions)
    assert np.abs(e[:, 1:4]).max() < 15.0


def test_several_headings_replay_to_the_bit_in_any_order_and_cut(turning):
    stream = sideways(measurements(turning[:3600], 5), 2.0)
    first = InsGps(ANY)
    reference, rng, single, kept = first.feed_all(stream), random.Random(7), [], InsGps(ANY)
    for m in stream:
        rows = [slice(i, i + 1) for i in range(len(m))] if isinstance(m, ImuBlock) else []
        single += [ImuBlock.of(m.source, m.stamps_ns[r], m.specific_force_b[r], m.angular_rate_b[r]) for r in rows] or [m]
    kept.keep_history()
    jittered = sorted(single, key=lambda m: m.stamp_ns + (0 if isinstance(m, ImuBlock) else rng.randrange(0, 45_000_000)))
    solutions = [s for m in jittered for s in kept.feed(m)]
    assert len(solutions) == len(reference) > 300
    for a, b in zip(reference, solutions, strict=True):
        assert (a.stamp_ns, a.lat, a.lon, a.height, a.mode) == (b.stamp_ns, b.lat, b.lon, b.height, b.mode)
        assert np.array_equal(a.q_nb, b.q_nb)
        assert np.array_equal(a.cov_att, b.cov_att)
    smoothed = list(kept.history.smoothed())
    assert len(smoothed) == len(reference)
    assert all(np.isfinite(s.cov_pos).all() for s in smoothed)


def test_standing_it_starts_without_a_heading_where_that_is_wanted():
    rng = np.random.default_rng(0)
    stamps, force = np.arange(1, 1001, dtype=np.int64) * 10_000_000, np.array([0.0, 0.0, -9.8]) + 0.01 * rng.standard_normal((1000, 3))
    block = ImuBlock.of("imu/data_raw", stamps, force, 0.001 * rng.standard_normal((1000, 3)))
    place, still = ("gps/fix", 0.7, 0.1, 100.0, np.eye(3) * 4.0), ("gps/vel", np.zeros(3), np.eye(3) * 0.01)
    fixes = [m for t in range(1, 10) for m in (GpsPosition(t * 10**9, *place), GpsVelocity(t * 10**9, *still))]
    navigator = InsGps(ANY)
    solutions = navigator.feed_all([*fixes, block])
    assert len(navigator.headings.cores) == CELLS
    assert np.degrees(np.sqrt(solutions[-1].cov_att[2, 2])) > 95.0
    assert navigator.mode == "gps"


@pytest.mark.parametrize("coupling", ["tight", "epochs"])
def test_satellites_show_any_heading(coupling):
    case = flights.Case(coupling, "HD", "crista", duration_s=40.0)
    truth, profile = flights.truth_of("HD", 40.0), load_imu_profile("crista")
    navigator = InsGnss(flights.inertial_settings(case, imu_settings(profile.filter_noise())))
    wrong = quat_apply_phi_n(truth.q_nb[0], np.array([0.0, 0.0, 2.5]))
    start = np.array([truth.lat[0], truth.lon[0], truth.height[0], *truth.vel_n[0], *wrong])
    navigator.begin(int(truth.stamps_ns[0]), start, np.diag([*flights.START_SIGMA[:8], np.pi / np.sqrt(3.0)]) ** 2)
    epochs = flights.epochs_of(case, truth)[::5]
    flown = flights.flight_of(truth, flights.fed(navigator, flights.imu_of(profile, truth, 1), epochs))
    assert abs(np.degrees(wrap(flown.error[-1, 8]))) < 4.0 * np.degrees(flown.sigma[-1, 8]) < 25.0
    assert np.linalg.norm(flown.error[-1, :3]) < 5.0


def test_antennas_show_a_heading_at_once_that_nothing_else_does(turning):
    settings = settings_class(InsGps, ("gps", "gps_attitude"))(imu=ANY.imu, alignment=ANY.alignment)
    navigator, stream = InsGps(settings), measurements(turning[:1500], 3)
    after = int(turning.stamps_ns[800])
    for m in stream:
        for solution in navigator.feed(m):
            row = np.searchsorted(turning.stamps_ns, solution.stamp_ns)
            error = wrap(quat_to_euler(solution.q_nb)[2] - quat_to_euler(turning.q_nb[row])[2])
        if isinstance(m, GpsPosition) and m.stamp_ns > after:
            q = turning.q_nb[np.searchsorted(turning.stamps_ns, m.stamp_ns)]
            navigator.feed(Attitude(m.stamp_ns, "gps/attitude", q, np.eye(3) * np.radians(0.5) ** 2, np.zeros(3), np.zeros(3)))
        elif m.stamp_ns < after and navigator.headings.cores:
            assert navigator.core.P[HEADING, HEADING] > 1.0
    assert not navigator.headings.cores
    assert abs(np.degrees(error)) < 1.5


def test_what_the_biases_could_be_shows_no_heading():
    navigator = InsGps(GPS_ONLY)
    core, layout = navigator.core, navigator.layout
    core.nav[6:10] = [1.0, 0.0, 0.0, 0.0]
    could_be = 2.0 * np.sqrt(2.0 / 3.0) * np.linalg.norm(layout.sigma0[layout["accel_bias"]])
    for force, hidden in ((0.9, True), (1.1, False)):
        core._sums[19:21] = force * could_be * np.array([0.6, -0.8])
        assert core.hides_heading() is hidden
    held = np.flatnonzero(all_but_heading(core) == 0.0)
    assert held.tolist() == [HEADING, layout["gyro_bias"].stop - 1]
    core.nav[6:10] = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]  # on its side: the right axis is the upright one
    assert np.flatnonzero(all_but_heading(core) == 0.0).tolist() == [HEADING, layout["gyro_bias"].start + 1]


def test_a_heading_that_is_known_is_one(turning):
    navigator = InsGps(GPS_ONLY)
    for m in measurements(turning, 3):
        navigator.feed(m)
        assert not navigator.headings.cores
    assert navigator.core.P[HEADING, HEADING] < WIDE**2
