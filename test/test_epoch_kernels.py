"""The compiled calls of an epoch of satellites or transmitters against the same in plain numpy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.aids._carrier_channels import COMMON, GAP, NEW, SLIP, Channels
from lowcostnav_ros.aids._carrier_watch import CHANGE_M, LONGEST_NS, SIGMAS, SLOW_SIGMAS, WINDOW, CodeWatch, pairs
from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.carrier_model import fused, predicted_codes, ranked, rows_of, screened_update, transmitter_model
from lowcostnav_ros.estimation.satellite_model import UNUSABLE, common_part, learnt, noise_covariance, observed, satellite_model, screened
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.radionav.troposphere import HOPFIELD, path_delays

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)
PLACE = 0.65, -2.1, 900.0
NAV = np.array([*PLACE, 40.0, -20.0, 1.0, *euler_to_quat(0.2, 0.1, 1.0)])
N = 12


def covariance(rng, n=N):
    A = rng.standard_normal((n, n))
    P = A @ A.T
    return 0.5 * (P + P.T)


def sky(rng, m):
    """Places and velocities of satellites above the horizon."""
    e = rng.standard_normal((m, 3))
    e[:, 2] = -0.2 - np.abs(e[:, 2])
    e /= np.linalg.norm(e, axis=1)[:, None]
    return geodetic_to_ecef(*PLACE) + 2.2e7 * e @ dcm_ne(*PLACE[:2]), 3000.0 * rng.standard_normal((m, 3))


# satellites -------------------------------------------------------------------------------------------------------------------------


@few
@given(seed=seeds, rate=st.booleans(), shares=st.booleans())
def test_what_satellites_say_is_that_of_the_model(seed, rate, shares):
    rng, m = np.random.default_rng(seed), 9
    pos, vel = sky(rng, m)
    estimate, lever, swing = rng.standard_normal(N), rng.standard_normal(3), rng.standard_normal(3)
    other, wanted, valid, cn0 = rng.random(m) < 0.4, rng.random(m) < 0.9, rng.random(m) < 0.9, rng.choice([0.0, 20.0, 45.0], m)
    ranges, rates, H_range, H_rate, sine = satellite_model(NAV, lever, swing, pos, vel, N)
    predicted, jacobian = (rates, H_rate) if rate else (ranges, H_range)
    measured, stated = predicted + rng.standard_normal(m), 1.0 + rng.random(m)
    least = 0.3, 30.0
    found, rows, y, H, r, common, sigma, usual, is_finite, is_steady = observed(
        NAV, lever, swing, estimate, (pos, vel, cn0, wanted, other), measured, stated, valid, rate, (9, 10), least, 1.5, 1.2, shares
    )
    failing = np.array([~valid, np.zeros(m, bool), ~wanted, sine < least[0], (cn0 > 0.0) & (cn0 < least[1])])
    assert [UNUSABLE[f] if f >= 0 else "" for f in found] == [UNUSABLE[np.argmax(bad)] if bad.any() else "" for bad in failing.T]
    good = ~failing.any(axis=0)
    assert np.array_equal(rows, np.flatnonzero(good)) and np.array_equal(sigma, stated[good]) and is_finite
    expected = jacobian[good].copy()
    expected[:, 9], expected[:, 10] = 1.0, other[good]
    assert np.array_equal(H, expected)
    np.testing.assert_allclose(y, (measured - predicted)[good] - expected[:, 9:11] @ estimate[9:11], atol=1e-7)
    np.testing.assert_allclose(r, (1.5 * stated[good]) ** 2, rtol=1e-14)
    assert np.array_equal(common, common_part(r, sine[good]) if shares else np.zeros(len(r))) and usual == learnt(sigma, 1.2)
    if good.any():
        assert is_steady == (abs(np.sort(y)[(len(y) - 1) // 2]) < 8.0 * math.sqrt(r.min()))


@few
@given(seed=seeds)
def test_each_satellite_is_tested_alone_and_all_are_summed_up(seed):
    rng, m = np.random.default_rng(seed), 9
    P, y, H, r, common = covariance(rng), rng.standard_normal(m), rng.standard_normal((m, N)), 0.5 + rng.random(m), 0.3 * rng.random(m)
    excluded = rng.random(m) < 0.3
    excluded[0] = False
    S, ratios, shown, passed, R, is_finite = screened(P, y, H, r, common, excluded, 0.05)
    left = ~excluded
    np.testing.assert_allclose(S, np.diag(H @ P @ H.T) + r, rtol=1e-12)
    np.testing.assert_allclose(ratios, y**2 / (0.05 * S), rtol=1e-12)
    np.testing.assert_allclose(R, np.outer(common, common) + np.diag(r - common**2), rtol=1e-14)
    mean = np.full(np.count_nonzero(left), 1.0 / np.count_nonzero(left))
    variance = mean @ (H[left] @ P @ H[left].T + noise_covariance(r[left], common[left])) @ mean
    lower = np.sort(ratios[left])[(np.count_nonzero(left) - 1) // 2]
    expected = [np.median(ratios), np.count_nonzero(left), mean @ y[left], variance, ratios[left].max(), lower]
    np.testing.assert_allclose(shown, expected, rtol=1e-10)
    assert is_finite and np.array_equal(passed, (ratios <= 1.0) & left)
    y[3] = math.nan
    assert not screened(P, y, H, r, common, excluded, 0.05)[-1]


# transmitters -----------------------------------------------------------------------------------------------------------------------


def transmitters(rng, m):
    pos = np.array([geodetic_to_ecef(PLACE[0] + d, PLACE[1] + e, 400.0) for d, e in 3e-3 * rng.standard_normal((m, 2))])
    return pos, np.tile([260.0, 40.0, 4.2e4, 1.1e4, 300.0, 400.0], (m, 1))


def test_codes_are_ranges_with_delays_and_clock():
    rng, m = np.random.default_rng(1), 6
    (pos, air), estimate, lever = transmitters(rng, m), rng.standard_normal(N), np.array([1.0, 0.5, -2.0])
    ranges, codes, H, delays = predicted_codes(NAV, lever, pos, estimate, HOPFIELD, air, 9, 11, 6)
    straight, expected = transmitter_model(*PLACE, lever, pos, N, 6)
    assert np.array_equal(ranges, straight) and np.array_equal(delays, path_delays(HOPFIELD, air, PLACE[2] + 2.0, straight))
    expected[:, 9], expected[:, 11] = 1.0, delays
    assert np.array_equal(H, expected)
    np.testing.assert_allclose(codes, straight + (1.0 + estimate[11]) * delays + estimate[9], atol=1e-8)
    assert not predicted_codes(NAV, lever, pos, estimate, HOPFIELD, air, 9, -1, 6)[2][:, 10:].any()


@few
@given(seed=seeds, counts=st.booleans(), always=st.booleans())
def test_rows_are_the_codes_and_then_the_carriers_that_count(seed, counts, always):
    rng, m, n = np.random.default_rng(seed), 7, 26
    predicted, H, x = 1000.0 * rng.random(m), rng.standard_normal((m, n)), rng.standard_normal(n)
    code, cycles, wave = predicted + rng.standard_normal(m), 5e3 * rng.random(m), np.full(m, 0.2)
    has_code, has_carrier = rng.random((2, m)) < 0.8
    channel, excluded, lost, begun = rng.permutation(9)[:m], *(rng.random((3, 9)) < 0.3)
    state, budget = np.where(rng.random(m) < 0.8, 10 + np.arange(m), -1), rng.integers(-1, 2, 9)
    signals, known = (code, cycles, wave, has_code, has_carrier), (excluded, lost, begun, budget)
    y_code, y_carrier, with_code, counting, y, rows, r, codes, is_finite = rows_of(
        predicted, H, x, signals, channel, state, 8, known, counts, always, (16.0, 4e-4)
    )
    in_step = ~excluded[channel]
    carriers = has_carrier & ~lost[channel] & (state >= 0) & in_step & counts
    used = has_code & in_step & ((budget[channel] != 0) | ~has_carrier | ~begun[channel]) & (always | ~has_carrier)
    assert np.array_equal(with_code, used) and np.array_equal(counting, carriers) and codes == np.count_nonzero(used) and is_finite
    expected, each = H[carriers].copy(), np.arange(np.count_nonzero(carriers))
    expected[each, state[carriers]], expected[each, state[carriers] + 8] = 0.2, 1.0
    residual = wave * (cycles - x[state]) - predicted - x[state + 8]
    assert np.array_equal(rows, np.vstack([H[used], expected])) and np.array_equal(y_code, code - predicted)
    np.testing.assert_allclose(y, np.concatenate([y_code[used], residual[carriers]]), atol=1e-9)
    assert np.array_equal(y_carrier[carriers], y[codes:]) and np.isnan(y_carrier[~carriers]).all()
    assert np.array_equal(r, [16.0] * codes + [4e-4] * len(each))


def test_rows_that_agree_best_come_first_and_nothing_moves_that_would_not_be_finite():
    rng = np.random.default_rng(2)
    P, y, H, r = covariance(rng), rng.standard_normal(8), rng.standard_normal((8, N)), 0.1 + rng.random(8)
    order, shown = ranked(P, y, H, r, 5.0)
    S = np.diag(H @ P @ H.T) + r
    ratios = y**2 / (5.0 * S)
    assert np.array_equal(order, np.argsort(ratios, kind="stable"))
    np.testing.assert_allclose(shown, [8.0, y.mean(), S.mean(), np.sort(ratios)[3]], rtol=1e-12)
    for by_factors in (False, True):
        after = P.copy()
        dx, used, is_finite = fused(after, y, H, r, order, math.inf, by_factors)
        expected = P.copy()
        dx0, _ = screened_update(expected, y, H, r, order, math.inf)
        assert is_finite and used.all()
        np.testing.assert_allclose(dx, dx0, atol=1e-9)
        np.testing.assert_allclose(after, expected, atol=1e-9)
    assert not fused(after, np.where(np.arange(8) == 5, math.inf, y), H, r, order, math.inf, False)[-1] and np.isfinite(after).all()


def epoch_of(stamp_ns, rng, m):
    ident = np.array([f"P{k}" for k in range(m)])
    columns = (1000.0 * rng.random(m), 5e3 * rng.random(m), 100.0 * rng.standard_normal(m), np.full(m, 0.2), np.zeros(m))
    return CarrierEpoch(stamp_ns, "pseudolite/raw", ident, *columns, np.ones(m, bool), np.ones(m, bool))


@few
@given(seed=seeds)
def test_slips_are_those_of_the_definition(seed):
    rng, m = np.random.default_rng(seed), 8
    channels, last, now_ns = Channels(1.5, 0.25), {}, 0
    for _ in range(6):
        now_ns += int(rng.choice([100_000_000, 200_000_000, 400_000_000]))
        epoch = epoch_of(now_ns, rng, m)
        before = [last.get(k) for k in range(m)]
        pairs_of = zip(before, epoch.doppler_hz, strict=True)
        going = np.array([0.0 if b is None else b[1] - 0.5e-9 * (doppler + b[2]) * (now_ns - b[0]) for b, doppler in pairs_of])
        slipped = rng.choice([0.0, 0.3, 7.0], m, p=[0.6, 0.2, 0.2]) + rng.choice([0.0, 40.0], p=[0.8, 0.2])
        epoch = replace(epoch, carrier_cycles=going + slipped)
        rows = np.sort(rng.permutation(m)[: rng.integers(1, m + 1)])
        found = channels.look(epoch, rows, rows)
        kinds, size = {}, np.zeros(len(rows))
        for i, k in enumerate(rows.tolist()):
            kinds[k] = NEW if before[k] is None else GAP if now_ns - before[k][0] > 250_000_000 else ""
            size[i] = slipped[k] if not kinds[k] else 0.0
            last[k] = now_ns, epoch.carrier_cycles[k], epoch.doppler_hz[k]
        counted = np.array([not kinds[k] for k in rows.tolist()])
        common = float(np.median(size[counted])) if np.count_nonzero(counted) >= COMMON else 0.0
        kinds |= {k: SLIP for k, c, s in zip(rows.tolist(), counted, size, strict=True) if c and abs(s - common) > 1.5}
        assert found.kinds == {k: kind for k, kind in kinds.items() if kind}
        np.testing.assert_allclose(found.size, size - common, atol=1e-6)
        assert found.step_m == pytest.approx(0.2 * common if abs(common) > 1.5 else 0.0, abs=1e-6)


def test_a_code_that_stays_off_is_excluded_as_the_definition_says():
    rng, m, sigma, slow = np.random.default_rng(3), 6, 4.0, 1.5
    P, H, watch = 0.1 * covariance(rng), 0.3 * rng.standard_normal((m, N)), CodeWatch(10, slow)
    mean, count, excluded, fallen = np.zeros(m), np.zeros(m), np.zeros(m, bool), set()
    known = np.diag(H @ P @ H.T)
    for k in range(260):
        y, valid = sigma * rng.standard_normal(m), rng.random(m) < 0.9
        y[2] += 15.0 * (k < 150)
        fell = watch.take(k, P, H, y, valid, np.arange(m) + 3, sigma)
        count[valid] = np.minimum(count[valid] + 1, WINDOW)
        mean[valid] += (y[valid] - mean[valid]) / count[valid]
        limit = SIGMAS * np.sqrt(sigma**2 / np.maximum(count, 1) + known) + SLOW_SIGMAS * slow
        off = valid & (count == WINDOW) & (np.abs(mean) > limit)
        off &= 2 * np.count_nonzero(off) < np.count_nonzero(valid)
        new = off | (excluded & (np.abs(mean) > 0.5 * limit))
        expected = np.flatnonzero(valid & new & ~excluded)
        excluded = np.where(valid, new, excluded)
        assert np.array_equal(fell, expected + 3) and np.array_equal(watch.excluded[3:9], excluded)
        fallen |= set(expected.tolist())
    assert fallen == {2} and not watch.excluded.any()


@few
@given(seed=seeds)
def test_pairs_of_code_and_carrier_end_when_the_range_has_changed(seed):
    rng, m = np.random.default_rng(seed), 4
    from_ns, start, begun, now_ns = np.zeros(6, dtype=np.int64), np.zeros((6, 3)), {}, 0
    for _ in range(12):
        now_ns += int(rng.choice([2_000_000_000, 12_000_000_000], p=[0.9, 0.1]))
        code, cycles, wave = 200.0 * rng.random(m), 1000.0 * rng.random(m), rng.choice([0.19, 0.2], m, p=[0.1, 0.9])
        valid = rng.random(m) < 0.9
        found, expected = pairs(from_ns, start, now_ns, np.arange(m), (code, cycles, wave, valid)), []
        for k in np.flatnonzero(valid).tolist():
            now, first = (now_ns, code[k], cycles[k] * wave[k], wave[k]), begun.get(k)
            if first is None or first[3] != wave[k] or now_ns - first[0] > LONGEST_NS:
                begun[k] = now
            elif max(abs(now[1] - first[1]), abs(now[2] - first[2])) >= CHANGE_M:
                expected.append([now[1] - first[1], now[2] - first[2]])
                begun[k] = now
        assert found.tolist() == expected


def test_a_scalar_update_equals_the_joseph_form():
    rng = np.random.default_rng(4)
    P0, h = covariance(rng), np.where(rng.random(N) < 0.4, rng.standard_normal(N), 0.0)
    free, dx, P = (rng.random(N) < 0.7).astype(float), 0.1 * rng.standard_normal(N), P0.copy()
    before = dx.copy()
    s = kalman.scalar_update(dx, P, 0.8, h, 0.3, free)
    K = free * (P0 @ h) / (h @ P0 @ h + 0.3)
    A = np.eye(N) - np.outer(K, h)
    np.testing.assert_allclose(P, A @ P0 @ A.T + 0.3 * np.outer(K, K), atol=1e-12)
    np.testing.assert_allclose(dx, before + K * (0.8 - h @ before), atol=1e-12)
    assert s == pytest.approx(h @ P0 @ h + 0.3) and np.array_equal(P, P.T)
