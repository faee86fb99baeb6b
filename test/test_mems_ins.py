"""The MEMS navigator: its dynamics against differences, its sigmas, the sign of accelerometers, both filters, GPS that lies, holes."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.base.units import MILLI_G
from lowcostnav_ros.calibration.reference_rest import CHANNELS, GRAVITY_POSITIVE, SPECIFIC_FORCE, gravity_b, reference_at_rest
from lowcostnav_ros.cores.carried import CORE, CarriedCore, CarriedSettings, carried_blocks, frame_acceleration
from lowcostnav_ros.cores.cascade import LowPass, butterworth
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.estimation.offset_watch import JUMPED, OffsetWatch
from lowcostnav_ros.estimation.rates import RateMonitor, coast_sigma, coast_time
from lowcostnav_ros.navigators.mems_ins.log import row_of
from lowcostnav_ros.navigators.mems_ins.navigator import GPS_ONLY, NEITHER, UNFELT, MemsIns
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, difference_n, displace
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_apply_phi_n, quat_rotate

NS = 1_000_000_000
HZ = 20
SPEED, RADIUS_S = 60.0, 40.0
BIAS = np.array([0.04, -0.03, 0.05])
PLACE = 0.7, -1.2, 800.0


def flight(seconds=120.0, seed=1, sign=1.0, wander_deg=0.4):
    """S-turns at 60 m/s: attitude of a reference that wanders, accelerations with a bias, GPS at 2 Hz; truth by stamp."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * HZ) + 1) / HZ
    rate = 0.12 * np.sin(2 * math.pi * t / RADIUS_S)
    heading = 0.5 + np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) / HZ)))
    vel = np.column_stack((SPEED * np.cos(heading), SPEED * np.sin(heading), np.sin(t / 15.0)))
    acc = np.column_stack((-vel[:, 1] * rate, vel[:, 0] * rate, np.cos(t / 15.0) / 15.0))
    items, truth = [], {}
    place, sigma = PLACE, np.radians([wander_deg, wander_deg, 1.5])
    phi, keep = sigma * rng.standard_normal(3), math.exp(-1.0 / (60.0 * HZ))
    bias = CarriedSettings().accel_bias_mg * MILLI_G * rng.standard_normal(3)
    for k, now in enumerate(t):
        stamp = NS + round(now * NS)
        if k:
            place = displace(*place, 0.5 * (vel[k] + vel[k - 1]) / HZ)
        q = euler_to_quat(math.atan(SPEED * rate[k] / 9.81), 0.03, heading[k])
        force_n = acc[k] - frame_acceleration(np.array([*place, *vel[k]]))
        force_b = quat_rotate(q * [1, -1, -1, -1], force_n) + bias + 0.15 * rng.standard_normal(3)
        phi = keep * phi + math.sqrt(1 - keep**2) * sigma * rng.standard_normal(3)
        said = quat_apply_phi_n(q, -phi)
        items.append(Attitude(stamp, "imu/data_fused", said, np.diag(sigma**2), np.array([0.0, 0.0, rate[k]]), sign * force_b))
        truth[stamp] = place, vel[k]
        if k % 10 == 0:
            off = 1.5 * rng.standard_normal(3)
            items.append(GpsPosition(stamp, "gps/fix", *displace(*place, off), 2.25 * np.eye(3)))
            items.append(GpsVelocity(stamp, "gps/vel", vel[k] + 0.1 * rng.standard_normal(3), 0.01 * np.eye(3)))
    return items, truth


def make(**changes):
    return MemsIns(from_mapping(MemsIns.Settings, {key.replace("__", "."): value for key, value in changes.items()}))


def fly(items, **changes):
    nav = make(**changes)
    return nav, nav.feed_all(items)


def errors(solutions, truth, after_s=30.0):
    kept = [s for s in solutions if s.stamp_ns > NS + after_s * NS and s.stamp_ns in truth]
    p = np.array([difference_n(*s.place, *truth[s.stamp_ns][0]) for s in kept])
    v = np.array([s.vel_n - truth[s.stamp_ns][1] for s in kept])
    return p, v, kept


def without(items, begin_s, end_s):
    return [i for i in items if isinstance(i, Attitude) or not begin_s * NS <= i.stamp_ns - NS < end_s * NS]


CASCADE = {
    "filter": "cascade",
    "cascade__r_accel_ft2": 10.0,
    "cascade__q_accel_ft2": [1e-4] * 3,
    "cascade__r_position_ft2": 25.0,
    "cascade__q_position_ft2": [1.0] * 3,
}


@pytest.fixture(scope="module")
def flown():
    return flight()


def test_its_dynamics_against_differences():
    """F of the errors against the motion of two means a little apart, in every state."""
    settings = CarriedSettings()
    layout = Layout(carried_blocks(settings))

    def carried(dx, dt):
        core = CarriedCore(settings, layout)
        q = euler_to_quat(0.3, 0.1, 1.0)
        core.start(0, np.array([*PLACE, 60.0, 10.0, -2.0]), np.eye(3), np.eye(3))
        core.hold(Attitude(0, "imu/data_fused", q, 1e-4 * np.eye(3), np.zeros(3), np.array([1.0, -2.0, -11.0])))
        core.correct(dx)
        F = core.dynamics()
        core.move(round(dt * NS))
        return core.nav, F

    dt = 0.01
    still, F = carried(np.zeros(layout.size), dt)
    for k in range(layout.size):
        step = np.zeros(layout.size)
        step[k] = 1e-2 if k < CORE else 1e-3
        moved, _ = carried(step, dt)
        change = np.concatenate((difference_n(*moved[:3], *still[:3]), moved[3:6] - still[3:6])) / step[k]
        Phi = np.eye(layout.size) + F * dt + 0.5 * F @ F * dt * dt
        assert change == pytest.approx(Phi[:CORE, k], abs=2e-4)  # Coriolis and the second order of the rotation are left out


def test_a_healthy_flight_is_accurate_and_its_sigmas_are_honest():
    """NEES of position and velocity over four flights: 3 expected."""
    scores = []
    for seed in range(4):
        items, truth = flight(70.0, seed)
        nav, solutions = fly(items, gps__correlation_s=0.0)  # errors of this receiver are white
        p, v, kept = errors(solutions, truth, 20.0)
        assert nav.contradictions() == () and {s.mode for s in solutions} == {"gps"}
        assert np.sqrt((p**2).mean()) < 1.0 and np.sqrt((v**2).mean()) < 0.2
        scores.append([mean_nees(p, [s.cov_pos for s in kept]), mean_nees(v, [s.cov_vel for s in kept])])
    assert np.all((np.mean(scores, axis=0) > 1.5) & (np.mean(scores, axis=0) < 4.8))


def mean_nees(errors, covariances):
    return np.mean([e @ np.linalg.solve(c, e) for e, c in zip(errors, covariances, strict=True)])


def test_an_outage_is_coasted_within_its_sigma_and_its_budget(flown):
    items, truth = flown
    nav, solutions = fly(without(items, 60.0, 100.0))
    p, _, kept = errors(solutions, truth, 99.0)
    last = kept[[k for k, s in enumerate(kept) if s.stamp_ns < 101 * NS][-1]]
    error = np.hypot(*difference_n(*last.place, *truth[last.stamp_ns][0])[:2])
    assert last.mode == "coasting" and error < 3.0 * last.horizontal_sigma_m < 600.0
    assert nav.mode == "gps" and np.abs(p[-1]).max() < 5.0
    assert 0.0 < nav.coast_s() < 120.0 and "without GPS" in nav.status().details


def test_the_sign_of_the_accelerometers_is_told_and_changes_nothing(flown):
    items, _ = flown
    turned = [replace(i, specific_force_b=-i.specific_force_b) if isinstance(i, Attitude) else i for i in items]
    (a, one), (b, other) = fly(items), fly(turned)
    assert (a.sign, b.sign) == (SPECIFIC_FORCE, GRAVITY_POSITIVE)
    assert b.status().details["accelerometers"] == "gravity positive"
    assert all(np.array_equal(x.place, y.place) for x, y in zip(one, other, strict=True))


def test_accelerations_that_tell_no_sign_are_refused_in_words(flown):
    items, _ = flown
    none = [replace(i, specific_force_b=np.array([0.1, 0.0, 0.3])) if isinstance(i, Attitude) else i for i in items[:600]]
    nav, solutions = fly(none)
    assert not solutions and nav.mode == "aligning" and NEITHER in nav.reason


def test_a_reference_without_accelerometers_is_said_and_flown_on(flown):
    items, truth = flown
    down = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    deaf = [replace(i, specific_force_b=quat_rotate(i.q_nb * [1, -1, -1, -1], down)) if isinstance(i, Attitude) else i for i in items]
    nav, solutions = fly(deaf)
    p, _, _ = errors(solutions, truth)
    assert UNFELT in nav.reason and np.sqrt((p**2).mean()) < 3.0


def test_without_the_reference_gps_alone_is_flown_then_nothing(flown):
    items, truth = flown
    for changes in ({}, CASCADE):
        nav, solutions = fly([i for i in items if not isinstance(i, Attitude) or i.stamp_ns < 60 * NS], **changes)
        p, _, kept = errors(solutions, truth, 70.0)
        assert nav.mode == GPS_ONLY and len(kept) > 100
        assert np.sqrt((p**2).mean()) < 15.0
        assert np.mean([(e**2 / s.cov_pos.diagonal()).sum() for e, s in zip(p, kept, strict=True)]) < 6.0
        ended = [i for i in items if i.stamp_ns < 60 * NS or (isinstance(i, GpsPosition) and i.stamp_ns < 70 * NS)]
        nav, _ = fly([*ended, replace(items[-1], stamp_ns=71 * NS)], **changes)
        assert nav.mode in (GPS_ONLY, "failed")


def test_order_of_arrival_changes_no_bit(flown):
    items, _ = flown
    rng = np.random.default_rng(3)
    shuffled = sorted(items[:1500], key=lambda m: m.stamp_ns + rng.uniform(0.0, 0.1) * NS)
    for changes in ({}, CASCADE):
        one, other = (fly(stream, **changes)[1] for stream in (items[:1500], shuffled))
        pairs = list(zip(one, other, strict=False))
        assert len(pairs) > 500
        assert all(a.stamp_ns == b.stamp_ns and a.place == b.place and np.array_equal(a.cov_pos, b.cov_pos) for a, b in pairs)


def test_numbers_that_are_none_change_nothing(flown):
    items, _ = flown
    spoilt = []
    for k, i in enumerate(items[:1200]):
        spoilt.append(i)
        if isinstance(i, Attitude) and k % 50 == 7:
            spoilt.append(replace(i, stamp_ns=i.stamp_ns + 1, specific_force_b=np.array([np.nan, 0.0, 0.0])))
        if isinstance(i, GpsPosition) and k % 40 == 7:
            spoilt.append(replace(i, stamp_ns=i.stamp_ns + 1, lat=np.nan))
    for changes in ({}, CASCADE):
        _, solutions = fly(spoilt, **changes)
        assert len(solutions) > 300 and all(np.isfinite([*s.place, *s.vel_n, *np.ravel(s.cov_pos)]).all() for s in solutions)


# the cascade ---------------------------------------------------------------------------------------------------------------------


def test_the_cascade_flies_and_owns_up_to_its_errors(flown):
    items, truth = flown
    nav, solutions = fly(items, **CASCADE)
    p, v, kept = errors(solutions, truth, 60.0)
    assert {s.mode for s in solutions} == {"gps"}
    assert np.sqrt((p**2).mean()) < 8.0
    assert np.mean([(e**2 / s.cov_pos.diagonal()).sum() for e, s in zip(p, kept, strict=True)]) < 6.0
    assert np.mean([(e**2 / s.cov_vel.diagonal()).sum() for e, s in zip(v, kept, strict=True)]) < 9.0
    row = row_of(nav, solutions[-1], NS)
    assert row["gps_hz"] == pytest.approx(2.0, abs=0.1) and row["reference_hz"] == pytest.approx(20.0, abs=0.1)
    assert row["mode"] == "gps" and np.isfinite(row["gps_accel_filtered_n_fps2"])


def test_a_jump_of_gps_is_left_out_until_it_is_back(flown):
    items, truth = flown
    jumped = [
        replace(i, lat=i.lat + 2e-4) if isinstance(i, GpsPosition) and 80 * NS <= i.stamp_ns - NS < 95 * NS else i for i in items
    ]
    nav, solutions = fly(jumped, **CASCADE)
    during = [s for s in solutions if 83 * NS < s.stamp_ns - NS < 94 * NS]
    assert {s.mode for s in during} == {"suspect"}
    error = max(np.abs(difference_n(*s.place, *truth[s.stamp_ns][0])[0]) for s in during if s.stamp_ns in truth)
    assert error < 300.0  # of 1270 m
    assert nav.mode == "gps"


def test_settings_that_contradict_each_other_are_refused():
    with pytest.raises(SettingsError, match="as_printed"):
        make(accel_sign="as_printed")
    with pytest.raises(SettingsError, match="gps"):
        make(aids=["cascade"])


def test_the_low_pass_filter_against_scipy():
    b, a = signal.butter(4, 0.2)
    for ours, other in zip(signal.sos2tf([[*s[:3], 1.0, *s[3:]] for s in butterworth(0.1, 1.0)]), (b, a), strict=True):
        assert ours == pytest.approx(other, abs=1e-12)
    assert b[0] == pytest.approx(0.00482434, abs=1e-8)
    x = np.random.default_rng(1).standard_normal((200, 3))
    low = LowPass(0.1, 1.0)
    assert np.array([low(row) for row in x]) == pytest.approx(signal.lfilter(b, a, x, axis=0), abs=1e-9)
    assert np.array_equal(LowPass(0.0, 1.0)(x[0]), x[0])


def test_the_watch_finds_a_jump_and_forgives_after_ten_good_epochs():
    watch, rng = OffsetWatch(), np.random.default_rng(1)
    faults = []
    for k in range(80):
        offset = 0.1 * k + 0.2 * rng.standard_normal(3) + (200.0 if 40 <= k < 50 else 0.0)
        unexpected = np.full(3, 200.0 if 40 <= k < 50 else 0.0)
        watch.take(k * NS, offset, np.full(3, 60.0), np.full(3, 60.0), unexpected, np.full(3, 5.0))
        faults.append(watch.fault)
    assert not any(faults[:40]) and all(faults[40:59]) and faults[40] == JUMPED and not faults[-1]


def test_rates_lag_and_coasting_by_closed_forms():
    rates = RateMonitor()
    for k in range(400):
        rates.take("a", k * NS // 20)
        if k % 20 == 0:
            rates.take("g", (k - 4) * NS // 20, is_slow=True)
    assert (rates.rate_hz("a"), rates.rate_hz("g"), rates.lag_s) == pytest.approx((20.0, 1.0, 0.2))
    assert rates.rate_hz("none") == 0.0
    assert coast_time(33.0, 0.0, 0.0, 0.2192, 0.0) == pytest.approx(math.sqrt(2 * 33.0 / 0.2192), rel=1e-6)
    assert coast_time(1.0, 2.0, 0.0, 0.0, 0.0) == 0.0 and coast_time(1.0, 0.5, 0.0, 0.0, 0.0) == 3600.0
    assert coast_sigma(10.0, 3.0, 1.0, 0.1, 0.03) == pytest.approx(math.sqrt(9 + 100 + 25 + 10))


def test_a_reference_at_rest():
    rng, roll, pitch = np.random.default_rng(2), 0.03, -0.01
    rows = np.array([roll, pitch, 3.14, *np.zeros(3), *(gravity_b(roll, pitch) + BIAS)]) + 1e-3 * rng.standard_normal((4000, 9))
    found = reference_at_rest(rows)
    assert found.sign == GRAVITY_POSITIVE and found.accel_bias == pytest.approx(BIAS, abs=1e-3)
    rows[:, 6:9] *= -1.0
    assert reference_at_rest(rows).sign == SPECIFIC_FORCE and reference_at_rest(rows).accel_bias == pytest.approx(-BIAS, abs=1e-3)
    rows[:, 6:9] = 0.1
    assert reference_at_rest(rows).sign == ""
    with pytest.raises(ValueError, match="at least two"):
        reference_at_rest(np.zeros((1, len(CHANNELS))))


def test_the_node_publishes(ros, flown):
    node_module = pytest.importorskip("lowcostnav_ros.ros.navigator_node")
    node = ros.make(lambda **kwargs: node_module.navigator_node("mems_ins", **kwargs))
    for item in flown[0][:400]:
        node._feed(item)
    counts = {topic: output.count for topic, output in node.outputs.items()}
    assert counts["mems_ins/odometry_fused"] > 50 and counts["mems_ins/odometry"] > 20
    assert node.navigator.mode == "gps"


def test_every_signal_goes_into_a_table_with_tabs(flown):
    from lowcostnav_ros.cli.mems_log import logging_to

    file = io.StringIO()
    logged = logging_to(file)
    logged(from_mapping(MemsIns.Settings, {"filter": "cascade"})).feed_all(flown[0][:600])
    head, *rows = [line.split("\t") for line in file.getvalue().splitlines()]
    assert logged.rows == len(rows) > 150 and {len(row) for row in rows} == {len(head)}
    assert rows[-1][head.index("mode")] == "gps" and float(rows[-1][head.index("ins_n_ft")]) != 0.0


def test_receivers_and_references_at_rest_are_characterised_and_motion_is_refused(flown, capsys):
    from lowcostnav_ros.cli import calibrate_reference as rest

    rng, fixes = np.random.default_rng(1), [i for i in flown[0] if isinstance(i, GpsPosition)]
    still = [replace(fixes[0], stamp_ns=k * NS, height=800.0 + 3.0 * rng.standard_normal()) for k in range(400)]
    assert rest.fixes(still) == 0
    level = [Attitude(k, "imu/data", euler_to_quat(0.02, 0.0, 1.0), np.eye(3), np.zeros(3), gravity_b(0.02, 0.0)) for k in range(50)]
    assert rest.reference(level) == 0
    said = capsys.readouterr().out
    assert "gravity positive" in said and "down" in said
    for function, moving in ((rest.fixes, fixes), (rest.reference, [i for i in flown[0] if isinstance(i, Attitude)])):
        with pytest.raises(ValueError, match="not at rest"):
            function(moving)
