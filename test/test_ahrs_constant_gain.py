"""The constant-gain filters of the attitude reference: closed-form turns, honesty of the covariance, modes, repeatability, refusals."""

import math

import numpy as np
import pytest
from ahrs_flights import DEG, T0, Turn, settings

from lowcostnav_ros.aids._constant_gain import joseph
from lowcostnav_ros.base.measurements import Attitude, GpsVelocity, ImuBlock, Measurement
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.navigators.ahrs.full import FullFilter
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs, AhrsSettings
from lowcostnav_ros.navigators.ahrs.settings import FILTERS
from lowcostnav_ros.physics.rotation import dcm_to_quat, euler_to_quat, quat_to_euler, wrap
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

SIGMA = 0.25 * DEG
BIAS = np.array([0.08, -0.05, 0.06]) * DEG


def gps_attitude(turn: Turn, start_s: float, stop_s: float, sigma: float = 0.0, seed: int = 1) -> list[Measurement]:
    """Attitude at 2 Hz."""
    rng, out = np.random.default_rng(seed), []
    for k in range(round(start_s * 2) + 1, round(stop_s * 2) + 1):
        angles = np.array(quat_to_euler(dcm_to_quat(turn.dcm(0.5 * k)))) + sigma * rng.standard_normal(3)
        q = euler_to_quat(*angles)
        out.append(Attitude(T0 + 500_000_000 * k, "gps/attitude", q, np.eye(3) * SIGMA**2, np.zeros(3), np.zeros(3)))
    return out


def flown(turn: Turn, kind: str, stop_s: float, gps_until_s: float, sources: tuple[str, ...] = ("mag", "gps"), bias=BIAS) -> Ahrs:
    """A navigator after a flight in which all GPS ends at ``gps_until_s``."""
    navigator = Ahrs(settings(filter=kind))
    items = turn.measurements(0.0, stop_s, sources, gyro_bias=bias) + gps_attitude(turn, 0.0, gps_until_s)
    items = [m for m in items if not isinstance(m, GpsVelocity) or m.stamp_ns <= T0 + 1e9 * gps_until_s]
    navigator.solutions = navigator.feed_all(sorted(items, key=lambda m: m.stamp_ns))
    return navigator


def error_deg(turn: Turn, solution) -> np.ndarray:
    t = (solution.stamp_ns - T0) * 1e-9
    return wrap(np.array([turn.bank, turn.pitch, turn.heading(t)]) - np.array(quat_to_euler(solution.q_nb))) / DEG


def test_the_setting_chooses_the_filter():
    assert isinstance(Ahrs(settings()).filter, FullFilter)
    for kind, chosen in FILTERS.items():
        assert type(Ahrs(settings(filter=kind)).filter) is chosen
    with pytest.raises(SettingsError, match="one of full, euler"):
        from_mapping(AhrsSettings, {"filter": "kalman"})


def test_only_who_uses_gps_attitude_listens_to_it():
    hears = [kind for kind in FILTERS if "gps/attitude" in Ahrs(settings(filter=kind)).inputs]
    assert hears == ["euler", "quaternion"]
    assert "gps/attitude" in Ahrs(settings(gps_attitude__enabled=True)).inputs


@pytest.mark.parametrize("kind", ["euler", "quaternion", "vector_matching", "wahba"])
@pytest.mark.parametrize("bank_deg", [0.0, 25.0])
def test_calibrates_attitude_and_gyro_bias(kind, bank_deg):
    turn = Turn(bank_deg)
    navigator = flown(turn, kind, 150.0, 150.0)
    last = navigator.solutions[-1]
    assert last.mode == "calibrating"
    assert np.abs(error_deg(turn, last)).max() < 0.6
    if bank_deg == 0.0:
        learned = [last.states[f"gyro_bias_{axis}_radps"][0] for axis in "xyz"]
        np.testing.assert_allclose(learned, BIAS, atol=0.02 * DEG)


def test_euler_and_quaternion_forms_agree():
    turn = Turn(25.0)
    euler, quaternion = (flown(turn, kind, 60.0, 60.0).solutions[-1] for kind in ("euler", "quaternion"))
    np.testing.assert_allclose(error_deg(turn, euler), error_deg(turn, quaternion), atol=0.02)
    np.testing.assert_allclose(euler.cov_att, quaternion.cov_att, rtol=0.02, atol=1e-9)


@pytest.mark.parametrize("kind", ["euler", "quaternion", "vector_matching", "wahba", "switched"])
def test_without_gps_it_levels_in_steady_flight(kind):
    turn = Turn(0.0)
    navigator = flown(turn, kind, 60.0, 30.0, bias=np.zeros(3))
    assert (navigator.mode, navigator.reason) == ("coasting", "levelled in steady flight")
    assert np.abs(error_deg(turn, navigator.solutions[-1])).max() < 0.2


def test_in_a_turn_the_gyros_carry_it_and_the_sigma_grows():
    turn = Turn(20.0)
    navigator = flown(turn, "quaternion", 60.0, 30.0, bias=np.zeros(3))
    assert navigator.mode == "gyro_only"
    assert "gyros alone" in navigator.reason
    assert navigator.aid("accelerometer_level").status.reason == "manoeuvring"
    assert np.abs(error_deg(turn, navigator.solutions[-1])).max() < 0.5  # levelling would have said zero bank
    early, late = navigator.solutions[320], navigator.solutions[-1]
    assert math.sqrt(late.cov_att[0, 0]) > 1.5 * math.sqrt(early.cov_att[0, 0])


def test_joseph_is_the_covariance_of_a_sampled_filter():
    rng = np.random.default_rng(2)
    A = rng.standard_normal((4, 4))
    P, H, R, K = A @ A.T, rng.standard_normal((2, 4)), np.diag([0.5, 0.2]), 0.3 * rng.standard_normal((4, 2))
    errors = rng.multivariate_normal(np.zeros(4), P, 200_000)
    noise = rng.multivariate_normal(np.zeros(2), R, 200_000)
    after = errors - (errors @ H.T + noise) @ K.T
    moved = P.copy()
    joseph(moved, K, H, R)
    scale = np.sqrt(np.diag(moved))
    np.testing.assert_allclose(moved / np.outer(scale, scale), np.cov(after.T) / np.outer(scale, scale), atol=0.02)


@pytest.mark.parametrize("kind", ["full", "euler", "quaternion"])
def test_a_wrong_attitude_is_rejected_and_a_lasting_one_believed(kind):
    turn, changes = Turn(0.0), {"gps_attitude__enabled": True, "gps_attitude__gate__recovery_s": 5.0, "filter": kind}
    navigator = Ahrs(settings(**changes, magnetic__enabled=False))
    straight = turn.measurements(0.0, 40.0, ("gps",)) + gps_attitude(turn, 0.0, 20.0)
    other = Turn(0.0, heading0_deg=70.0)
    late = gps_attitude(other, 20.0, 40.0)
    navigator.feed_all(sorted([*straight, *late], key=lambda m: m.stamp_ns))
    assert navigator.aid("gps_attitude").status.rejected["innovation beyond gate"] >= 5
    assert navigator.aid("gps_attitude").status.rejected["recovered after rejections"] >= 1
    assert abs(error_deg(other, navigator.output())[2]) < 2.0


@pytest.mark.parametrize("kind", ["full", "quaternion"])
def test_begins_on_gps_attitude_alone_in_a_turn(kind):
    turn = Turn(30.0)
    navigator = Ahrs(settings(filter=kind, gps_attitude__enabled=True, magnetic__enabled=False, airdata__enabled=False))
    items = turn.measurements(0.0, 6.0, ()) + gps_attitude(turn, 0.0, 6.0)
    solutions = navigator.feed_all(sorted(items, key=lambda m: m.stamp_ns))
    assert navigator.mode == "calibrating"
    assert np.abs(error_deg(turn, solutions[-1])).max() < 0.1


@pytest.mark.parametrize("kind", FILTERS)
def test_cut_and_order_of_arrival_do_not_change_a_bit(kind):
    turn = Turn(15.0)
    items = turn.measurements(0.0, 20.0, ("mag", "gps")) + gps_attitude(turn, 0.0, 20.0, SIGMA)
    items.sort(key=lambda m: m.stamp_ns)
    results = []
    for cut in (False, True):
        navigator = Ahrs(settings(filter=kind, horizon__lag_s=0.3, gps_attitude__enabled=True))
        mixed = items
        if cut:
            singles = [
                ImuBlock.of(m.source, *(c[k : k + 1] for c in (m.stamps_ns, m.specific_force_b, m.angular_rate_b)))
                for m in items
                if isinstance(m, ImuBlock)
                for k in range(len(m))
            ]
            others = [m for m in items if not isinstance(m, ImuBlock)]
            mixed = sorted([*singles, *others], key=lambda m: m.stamp_ns + (0 if isinstance(m, ImuBlock) else 90_000_000))
        results.append(navigator.feed_all(mixed))
    assert len(results[0]) == len(results[1]) > 100
    for one, two in zip(*results, strict=True):
        assert one.stamp_ns == two.stamp_ns
        np.testing.assert_array_equal(one.q_nb, two.q_nb)
        np.testing.assert_array_equal(one.cov_att, two.cov_att)


def test_euler_angles_are_refused_near_the_vertical():
    steep = Turn(0.0, speed=0.0, pitch_deg=84.0)
    navigator = Ahrs(settings(filter="euler", magnetic__enabled=False))
    items = steep.measurements(0.0, 6.0, ()) + gps_attitude(steep, 0.0, 6.0)
    navigator.feed_all(sorted(items, key=lambda m: m.stamp_ns))
    assert navigator.aid("gps_attitude").status.reason == "too steep for Euler angles"


def test_vector_matching_says_when_the_dip_is_unknown():
    navigator = Ahrs(settings(filter="vector_matching", place__lat_lon_deg=[], magnetic__declination_deg=[13.0]))
    navigator.feed_all(Turn(0.0).measurements(0.0, 10.0, ("gps", "mag")))
    assert "place unknown" in navigator.aid("magnetic_vector").status.reason
    assert navigator.aid("specific_force_vector").status.fused >= 5


def test_two_vectors_solved_together_need_both():
    navigator = Ahrs(settings(filter="wahba"))
    navigator.feed_all(Turn(20.0).measurements(0.0, 10.0, ("gps", "mag")))
    assert navigator.aid("wahba_attitude").status.fused >= 5
    alone = Ahrs(settings(filter="wahba", magnetic__enabled=False))
    alone.feed_all(Turn(20.0).measurements(0.0, 10.0, ("gps", "mag")))
    assert alone.aid("wahba_attitude").status.fused == 0
    assert alone.aid("wahba_attitude").status.reason == "no magnetic field"


FLIGHT = """
name: honest
seed: 5
sensors: [imu, magnetometer, gps, gps_attitude]
truth: {kind: segments, name: banked_turns, duration_s: 420.0}
imu: {profile: dmu6x}
gps: {rate_hz: 5.0}
"""


@pytest.fixture(scope="module")
def simulated():
    truths, heard = [], []
    for truth, measurements in Simulation(scenario_from_text(FLIGHT)).blocks(0.1):
        truths.append(truth)
        heard += sorted(measurements, key=lambda m: m.stamp_ns)
    return np.concatenate([t.stamps_ns for t in truths]), np.concatenate([t.q_nb for t in truths]), heard


@pytest.mark.parametrize(("kind", "rms_deg"), [("quaternion", 0.6), ("vector_matching", 0.7), ("wahba", 0.7), ("switched", 2.5)])
def test_simulated_flight_stays_inside_its_sigmas(simulated, kind, rms_deg):
    stamps, quats, heard = simulated
    changes = {"imu__gyro_turn_on_dps": 0.0, "imu__accel_turn_on_mg": 0.0, "imu__gyro_noise_dps_rthz": 0.05 / math.sqrt(20.0)}
    navigator = Ahrs(settings(filter=kind, **changes))
    solutions = [s for s in navigator.feed_all(heard) if s.stamp_ns - stamps[0] > 60e9]
    rows = np.searchsorted(stamps, [s.stamp_ns for s in solutions])
    true = np.array([quat_to_euler(quats[row]) for row in rows])
    found = np.array([quat_to_euler(s.q_nb) for s in solutions])
    tilt = wrap(true - found)[:, :2]
    sigma = np.array([np.sqrt(0.5 * np.trace(s.cov_att[:2, :2])) for s in solutions])
    assert np.sqrt(np.mean(tilt**2)) / DEG < rms_deg
    # levelling allows for 0.3 m/s^2 of acceleration, and this air is smooth
    assert 0.2 < np.sqrt(np.mean((tilt / sigma[:, np.newaxis]) ** 2)) < 1.3
