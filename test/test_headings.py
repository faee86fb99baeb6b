"""Several headings at once: the mixture's algebra, and starts at any heading."""

import dataclasses
import random

import numpy as np
import pytest
from test_ins_gps import GPS_ONLY, errors, measurements

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, ImuBlock
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.headings import CELLS, HEADING, WIDTH, cut, mean_turn, merged, spread, turned_from
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.cores.inertial import InertialCore
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.navigators.headings import WIDE
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.settings import settings_class
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_apply_phi_n, quat_to_euler, wrap
from lowcostnav_ros.reproduce.solimeno import flights
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

ANY = dataclasses.replace(GPS_ONLY, alignment=dataclasses.replace(GPS_ONLY.alignment, any_heading=True))


def a_core(sigma_deg, heading_deg=40.0):
    """A core at an attitude, its heading so uncertain and tied to a gyro bias."""
    core = InertialCore(Layout(InsGps(GPS_ONLY).blocks()))
    nav = np.array([0.7, 0.1, 300.0, 40.0, 10.0, 1.0, *euler_to_quat(0.1, -0.05, np.radians(heading_deg))])
    core.start(10**9, nav, np.diag([4.0, 4.0, 9.0, 0.1, 0.1, 0.1, 1e-4, 1e-4, np.radians(sigma_deg) ** 2]))
    bias = core.layout["gyro_bias"].stop - 1
    core.P[HEADING, bias] = core.P[bias, HEADING] = 0.6 * np.sqrt(core.P[HEADING, HEADING] * core.P[bias, bias])
    return core, bias


@pytest.mark.parametrize("sigma_deg", [3.0, 30.0, 45.0])
def test_a_core_that_is_cut_and_merged_is_what_it_was(sigma_deg):
    core, bias = a_core(sigma_deg)
    pieces = cut(core, core.nav[6:10])
    shares = np.array([share for _, share, _ in pieces])
    assert shares.sum() == pytest.approx(1.0, abs=1e-3)
    assert all(np.sqrt(piece.P[HEADING, HEADING]) < 0.31 * WIDTH for _, _, piece in pieces)
    whole = core.branch()
    whole.nav[6:10] = quat_apply_phi_n(core.nav[6:10], np.array([0.0, 0.0, 1.0]))  # where it is seen from does not matter
    whole.nav[3] += 5.0
    merged(shares / shares.sum(), [piece for _, _, piece in pieces], whole)
    assert turned_from(whole.nav[6:10], core.nav[6:10])[0] == pytest.approx(0.0, abs=1e-9)
    assert whole.nav[:6] == pytest.approx(core.nav[:6], abs=1e-6)
    sigmas = np.sqrt(np.diag(core.P))
    assert np.abs(whole.P - core.P) / np.outer(sigmas, sigmas) == pytest.approx(0.0, abs=4e-3)
    assert whole.P[HEADING, bias] == pytest.approx(core.P[HEADING, bias], rel=0.01)


def test_an_unknown_heading_is_uniform():
    core, _ = a_core(104.0)
    shares, cores = spread(np.ones(1), [core], core.nav[6:10])
    assert len(cores) == CELLS
    assert shares == pytest.approx(1.0 / CELLS, rel=0.02)
    sigma = merged(shares, cores, core)[HEADING], np.sqrt(core.P[HEADING, HEADING])
    assert abs(sigma[0]) < 0.3  # a circle has no mean: it stays about where it was
    assert sigma[1] == pytest.approx(np.pi / np.sqrt(3.0), rel=0.02)


def test_a_mean_turn_lies_between_directions_across_the_cut():
    shares = np.array([0.5, 0.5])
    assert wrap(mean_turn(shares, np.radians([170.0, -150.0]))) == pytest.approx(np.radians(-170.0))
    assert mean_turn(shares, np.radians([0.0, 180.0])) == pytest.approx(np.radians(90.0))


def test_what_hangs_together_in_the_body_turns_with_the_heading():
    core, _ = a_core(20.0)
    tilt, accel = 6, core.layout["accel_bias"].start
    core.P[tilt, accel] = core.P[accel, tilt] = 0.5 * np.sqrt(core.P[tilt, tilt] * core.P[accel, accel])
    other = core.branch()
    other.nav[6:10] = quat_apply_phi_n(core.nav[6:10], np.array([0.0, 0.0, np.radians(90.0)]))
    other.P[6, accel] = other.P[accel, 6] = 0.0
    other.P[7, accel] = other.P[accel, 7] = core.P[tilt, accel]  # the same tie, seen in the other's north and east
    both = core.branch()
    merged(np.array([0.5, 0.5]), [core, other], both)
    half = np.sqrt(0.5) * core.P[tilt, accel]
    assert both.P[6:8, accel] == pytest.approx([half, half], rel=1e-6)


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


def test_a_heading_that_is_known_is_one(turning):
    navigator = InsGps(GPS_ONLY)
    for m in measurements(turning, 3):
        navigator.feed(m)
        assert not navigator.headings.cores
    assert navigator.core.P[HEADING, HEADING] < WIDE**2
