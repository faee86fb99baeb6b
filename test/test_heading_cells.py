"""Cores of several headings: cutting, moments, merging."""

import numpy as np
import pytest
from test_ins_gps import GPS_ONLY

from lowcostnav_ros.cores.headings import CELLS, HEADING, WIDTH, cut, mean_turn, merged, spread, turned_from
from lowcostnav_ros.cores.inertial import InertialCore
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_apply_phi_n, wrap


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
    core.estimate[bias] = 0.02
    pieces = cut(core, quat_apply_phi_n(core.nav[6:10], np.array([0.0, 0.0, 0.3])))
    shares = np.array([share for _, share, _ in pieces])
    assert shares.sum() == pytest.approx(1.0, abs=1e-3)
    assert all(np.sqrt(piece.P[HEADING, HEADING]) < 0.31 * WIDTH for _, _, piece in pieces)
    whole = core.branch()
    whole.nav[6:10] = quat_apply_phi_n(core.nav[6:10], np.array([0.0, 0.0, 1.0]))  # where it is seen from does not matter
    whole.nav[3] += 5.0
    whole.estimate[bias] -= 0.01
    merged(shares / shares.sum(), [piece for _, _, piece in pieces], whole)
    assert turned_from(whole.nav[6:10], core.nav[6:10])[0] == pytest.approx(0.0, abs=1e-4)
    assert whole.estimate[bias] == pytest.approx(0.02, abs=1e-5)
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
