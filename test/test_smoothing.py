"""The smoother: filterpy's equations against a batch solution, blocks against one pass, and whole flights of every core."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue import config_files
from lowcostnav_ros.catalogue.building import build_navigators
from lowcostnav_ros.estimation import kalman, smoothing
from lowcostnav_ros.estimation.station_slots import StationSlots
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.columns import columns_of
from lowcostnav_ros.replay.evaluation import truth_columns
from lowcostnav_ros.replay.metrics import errors_between
from lowcostnav_ros.replay.session import replay_stream, simulated
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

N, STEPS = 4, 30
ROWS = {"vel": np.eye(N)[:3]}


class Batch:
    """Least squares over all steps at once, the oracle: rows of information about the stacked states."""

    def __init__(self):
        self.steps, self.rows, self.values = 1, [], []

    def add(self, blocks, value, covariance):
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        self.rows.append({k: white @ block for k, block in blocks.items()})
        self.values.append(white @ value)

    def solve(self):
        A = np.zeros((sum(len(v) for v in self.values), N * self.steps))
        at = 0
        for row, value in zip(self.rows, self.values, strict=True):
            for k, block in row.items():
                A[at : at + len(value), N * k : N * k + N] = block
            at += len(value)
        Q, R = np.linalg.qr(A)
        mean, root = np.linalg.solve(R, Q.T @ np.concatenate(self.values)), np.linalg.inv(R)
        covariance = root @ root.T
        return mean.reshape(-1, N), np.array([covariance[N * k : N * k + N, N * k : N * k + N] for k in range(self.steps)])


def random_flight(seed, block_s, resets):
    """A linear error-state filter with several measurements at an instant and a state that other stations take over; its history."""
    rng = np.random.default_rng(seed)
    mean, P = rng.standard_normal(N), 4.0 * np.eye(N)
    batch, history = Batch(), smoothing.History()
    batch.add({0: np.eye(N)}, mean.copy(), P.copy())
    slots, outputs, filtered = StationSlots(slice(3, 4), 1.5), [], []
    slots.take("0", 0, P.copy(), mean.copy())
    for k in range(STEPS):
        t_ns = k * 500_000_000
        for _ in range(2 if k else 0):
            H, y, R = rng.standard_normal((1, N)), rng.standard_normal(1), np.array([[rng.uniform(0.1, 2.0)]])
            batch.add({batch.steps - 1: H}, y, R)
            dx = kalman.update(P, y - H @ mean, H, R, np.ones(N))
            mean = mean + dx
            history.correct(dx)
            if resets and rng.random() < 0.2:
                slots.take(str(rng.integers(1, 100)), t_ns, P, mean, history)
                if P[3, 3] == 1.5**2:
                    batch.add({batch.steps - 1: -np.eye(N)[:3], batch.steps: np.eye(N)[:3]}, np.zeros(3), 1e-10 * np.eye(3))
                    batch.add({batch.steps: np.eye(N)[3:]}, np.zeros(1), np.array([[1.5**2]]))
                    batch.steps += 1
        solution = NavSolution(t_ns, "x", 0.0, 0.0, 0.0, vel_n=mean[:3].copy(), cov_vel=P[:3, :3].copy())
        history.output(solution, P, ROWS)
        outputs.append(batch.steps - 1)
        filtered.append(solution)
        Phi, Q = np.eye(N) + 0.2 * rng.standard_normal((N, N)), np.diag(rng.uniform(0.05, 0.5, N))
        batch.add({batch.steps - 1: -Phi, batch.steps: np.eye(N)}, np.zeros(N), Q)
        batch.steps += 1
        history.begin(P)[:] = Phi
        mean, P[:] = Phi @ mean, Phi @ P @ Phi.T + Q
        history.end(P)
    end = batch.steps - 1
    batch.steps = outputs[-1] + 1
    batch.rows, batch.values = zip(*[(r, v) for r, v in zip(batch.rows, batch.values, strict=True) if end not in r], strict=True)
    before = smoothing.BLOCK_S
    smoothing.BLOCK_S = block_s
    try:
        return batch, outputs, filtered, list(history.smoothed())
    finally:
        smoothing.BLOCK_S = before


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), resets=st.booleans())
def test_the_history_of_a_filter_smooths_to_the_batch_solution(seed, resets):
    batch, outputs, filtered, smoothed = random_flight(seed, smoothing.BLOCK_S, resets)
    mean, covariance = batch.solve()
    assert [s.stamp_ns for s in smoothed] == [s.stamp_ns for s in filtered]
    assert np.allclose([s.vel_n for s in smoothed], mean[outputs, :3], atol=1e-6)
    assert np.allclose([s.cov_vel for s in smoothed], covariance[outputs][:, :3, :3], rtol=1e-6, atol=1e-8)
    for one, other in zip(filtered, smoothed, strict=True):
        assert np.linalg.eigvalsh(one.cov_vel - other.cov_vel).min() > -1e-9
    assert np.allclose(smoothed[-1].vel_n, filtered[-1].vel_n, atol=1e-12)


@pytest.mark.parametrize("block_s", [0.5, 3.0])
def test_blocks_equal_one_pass(block_s):
    pieces, whole = (random_flight(7, s, True)[3] for s in (block_s, 1e9))
    assert np.allclose([s.vel_n for s in pieces], [s.vel_n for s in whole], atol=1e-9)
    assert np.allclose([s.cov_vel for s in pieces], [s.cov_vel for s in whole], atol=1e-9)


def test_nothing_is_smoothed_across_a_cut():
    history = smoothing.History()
    for k in range(2):
        solution = NavSolution(k, "x", 0.0, 0.0, 0.0, vel_n=np.zeros(3), cov_vel=np.eye(3))
        history.output(solution, np.eye(N), ROWS)
        history.begin(np.eye(N))
        history.end(1.1 * np.eye(N))
        history.correct(np.ones(N))
        history.cut()
    assert [s.vel_n.tolist() for s in history.smoothed()] == [[0.0] * 3] * 2


def test_units_of_states_may_differ_by_many_powers_of_ten():
    rng, n = np.random.default_rng(3), 5
    x, root = rng.standard_normal((n, 3)), rng.standard_normal((n, 3, 3))
    P = root @ root.transpose(0, 2, 1) + np.eye(3)
    Phi, Q = np.repeat(np.eye(3)[None], n, 0) + 0.1 * rng.standard_normal((n, 3, 3)), np.repeat(0.1 * np.eye(3)[None], n, 0)
    scale = np.array([1e6, 1.0, 1e-7])
    plain, scaled = (
        smoothing.rts_smoother(x * s, P * np.outer(s, s), Phi * s[:, None] / s, Q * np.outer(s, s)) for s in (np.ones(3), scale)
    )
    assert np.allclose(plain[0] * scale, scaled[0], rtol=1e-9, atol=0.0)
    assert np.allclose(plain[1] * np.outer(scale, scale), scaled[1], rtol=1e-9, atol=0.0)


GPS = {"gps.outages_s": [100.0, 140.0], "gps.rate_hz": 1.0}
FLIGHTS = {
    "ins_gps": ("livermore", GPS),
    "dead_reckoning": ("livermore", GPS),
    "gnss_only": ("gnss_ld", {}),
    "ins_gnss": ("gnss_ld", {}),
}


def flown(name, seed=1, duration_s=180.0):
    """Truth, filtered and smoothed solutions of a navigator, as shipped, in a scenario, also shipped."""
    scenario, changes = FLIGHTS[name]
    path = config_files.config_dir() / "scenarios" / f"{scenario}.yaml"
    flight = scenario_from_text(path.read_text(), path.name, seed=seed, **{"truth.duration_s": duration_s, **changes})
    seconds = list(Simulation(flight).blocks())
    navigators, filtered = build_navigators(["ahrs", name] if name == "dead_reckoning" else [name], NAVIGATORS, None), []
    navigator = navigators[name]
    feed = navigator.feed
    navigator.feed = lambda measurement: [filtered.append(solution) or solution for solution in feed(measurement)]
    replay_stream(simulated(seconds), navigators, smooth=True)
    return TruthBlock.joined(block for block, _ in seconds), filtered, list(navigator.history.smoothed())


def errors_of(truth, solutions):
    estimate = columns_of(solutions)
    rows = np.searchsorted(truth.stamps_ns, estimate.stamps_ns)
    return errors_between(estimate, truth_columns(truth[rows])), 1e-9 * (estimate.stamps_ns - truth.stamps_ns[0])


@pytest.mark.parametrize("name", list(FLIGHTS))
def test_a_flight_is_known_better_afterwards_than_during_it(name):
    truth, filtered, smoothed = flown(name)
    assert [s.stamp_ns for s in smoothed] == [s.stamp_ns for s in filtered]
    (before, t), (after, _) = errors_of(truth, filtered), errors_of(truth, smoothed)
    lost = (t > 100.0) & (t < 140.0) if "gnss" not in name else t > 20.0
    rms_before, rms_after = (np.sqrt(np.mean(e.values[lost, :6] ** 2, axis=0)) for e in (before, after))
    assert np.linalg.norm(rms_after[:3]) < np.linalg.norm(rms_before[:3])
    assert np.linalg.norm(rms_after[3:]) < np.linalg.norm(rms_before[3:])
    assert np.nanmax(after.sigmas[:, :6] / before.sigmas[:, :6]) < 1.0 + 1e-6
    for part in ("cov_pos", "cov_vel", "cov_att"):  # roll and pitch of two headings lie along different axes: no direction may lose
        known = [(getattr(f, part), getattr(s, part)) for f, s in zip(filtered, smoothed, strict=True) if getattr(f, part) is not None]
        gained = np.array([f - s for f, s in known]).reshape(-1, 3, 3)
        assert (np.linalg.eigvalsh(gained)[:, 0] > -1e-6 * np.array([np.trace(f) for f, _ in known])).all()
    assert (smoothed[-1].lat, smoothed[-1].lon, smoothed[-1].height) == (filtered[-1].lat, filtered[-1].lon, filtered[-1].height)
    assert np.array_equal(smoothed[-1].cov_pos, filtered[-1].cov_pos)
