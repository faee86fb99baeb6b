"""What an attitude reference, a supervisor and dead reckoning doubt that no gate sees."""

from dataclasses import replace

import numpy as np
from ahrs_flights import DEG, PLACE_DEG, T0, Turn, settings
from dead_reckoning_flight import ORIGIN, START_NS, in_order, straight
from test_supervisor import DR, INS, fly, gps, solution
from test_supervisor import T0 as FIRST

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, Health, ImuBlock
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning
from lowcostnav_ros.navigators.supervisor.navigator import REFERENCE, Supervisor
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_euler, wrap

NOISE = np.random.default_rng(5)
DEAD_S = 20.0


def noisy(item, dead_s=np.inf):
    """Gyros with noise, the one about the vertical dead from a time on."""
    if not isinstance(item, ImuBlock):
        return item
    rate = item.angular_rate_b + NOISE.normal(0.0, 0.05 * DEG, item.angular_rate_b.shape)
    rate[item.stamps_ns > T0 + 1e9 * dead_s, 2] = 0.0
    return replace(item, angular_rate_b=rate)


def test_an_attitude_reference_holds_the_heading_by_vectors_where_a_gyro_is_dead():
    ahrs, turn = Ahrs(settings()), Turn(20.0)
    for item in turn.measurements(0.0, 40.0):
        out = ahrs.feed(noisy(item, DEAD_S))
        if not out or out[-1].stamp_ns < T0 + 1e9 * (DEAD_S - 5.0):
            continue
        off = wrap(quat_to_euler(out[-1].q_nb)[2] - turn.heading(1e-9 * (out[-1].stamp_ns - T0)))
        assert abs(off) < 4.0 * np.sqrt(out[-1].cov_att[2, 2]) and abs(off) < 10.0 * DEG  # 66 deg without them
    found = {c.name: c for c in ahrs.contradictions()}
    assert found["values never change"].suspect == "imu/data_raw" and "gyro z" in found["values never change"].advice


def test_a_heading_that_follows_a_compass_one_way_is_doubted():
    def swept(item):  # the field turns by 0.8 deg/s from 10 s on
        if item.source != "imu/mag":
            return item
        angle = 0.8 * DEG * max(1e-9 * (item.stamp_ns - T0) - 10.0, 0.0)
        c, s = np.cos(angle), np.sin(angle)
        return replace(item, field_b=np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ item.field_b)

    sigmas = []
    for change in (lambda item: item, swept):
        ahrs, out = Ahrs(settings()), []
        for item in Turn().measurements(0.0, 28.0, ("mag", "air")):
            out += ahrs.feed(change(noisy(item)))
        sigmas.append(np.sqrt(out[-1].cov_att[2, 2]) / DEG)
        off = wrap(quat_to_euler(out[-1].q_nb)[2] - 40.0 * DEG) / DEG
        assert abs(off) < 3.0 * sigmas[-1]
    assert off > 6.0 and sigmas[1] > 1.5 * sigmas[0]


def test_a_place_that_leaps_tells_no_declination_before_it_has_lasted():
    ahrs, place = Ahrs(settings()), np.array(PLACE_DEG) * DEG
    for item in Turn().measurements(0.0, 20.0, ("gps", "mag")):
        ahrs.feed(noisy(item))
        t = 1e-9 * (item.stamp_ns - T0)
        if item.source == "gps/vel":
            lon = place[1] if t < 5.0 else -place[1]
            ahrs.feed(GpsPosition(item.stamp_ns, "gps/fix", place[0], lon, 900.0, np.eye(3)))
        if t < 14.0:
            assert ahrs.magnetic.place[1] == place[1]
    assert ahrs.magnetic.place[1] == -place[1]


def attitude(t, heading_deg, sigma_deg=0.5):
    q_nb, cov = euler_to_quat(0.0, 0.0, heading_deg * DEG), (sigma_deg * DEG) ** 2 * np.eye(3)
    return Attitude(FIRST + round(1e9 * t), REFERENCE, q_nb, cov, np.zeros(3), None)


def test_a_supervisor_covers_attitudes_that_contradict_each_other_and_says_so():
    def flown(reference):
        supervisor = Supervisor()
        out = fly(supervisor, (0.0, 10.0), lambda t: solution(INS, t, 2.0), lambda t: solution(DR, t, 2.0), gps, reference)
        return out[-1].cov_att, {c.name for c in supervisor.contradictions()}, supervisor.reason

    agreeing, names, _ = flown(lambda t: attitude(t, 0.3))
    assert not names and agreeing[2, 2] < (1.0 * DEG) ** 2
    apart, names, reason = flown(lambda t: attitude(t, 10.0))
    assert names == {"attitudes disagree"} and "attitudes disagree" in reason
    assert apart[2, 2] > (9.5 * DEG) ** 2 > 100.0 * apart[0, 0]
    lost, _, _ = flown(lambda t: attitude(t, 0.0, 60.0))
    assert lost[0, 0] > (60.0 * DEG) ** 2


def test_reckoning_that_was_told_of_a_spoofer_covers_it_after_the_teller_is_silent():
    flight, rng = straight(150.0, dt=0.2), np.random.default_rng(3)
    begun_ns, rate = START_NS + 70_000_000_000, 2.0

    def spoofed(item):
        t = 1e-9 * (item.stamp_ns - begun_ns)
        if t < 0.0:
            return item
        if isinstance(item, GpsVelocity):
            return replace(item, vel_n=item.vel_n + [rate * min(t / 10.0, 1.0), 0.0, 0.0])
        ned = ORIGIN.to_ned(item.lat, item.lon, item.height) + [rate * (0.05 * t**2 if t < 10.0 else t - 5.0), 0.0, 0.0]
        return GpsPosition(item.stamp_ns, item.source, *ORIGIN.from_ned(ned), item.cov_n)

    def says(k):
        mode = "suspect" if 74 <= k <= 100 else "calibrating"
        return Health(START_NS + 1_000_000_000 * k, "ahrs/health", mode, 1, "says the test", 0, 0)

    stream = (spoofed(m) for m in flight.gps(rng, every=5))
    nav, out = DeadReckoning(), []
    for item in in_order(flight.attitudes(), flight.airspeeds(), stream, map(says, range(150))):
        out += nav.feed(item)
    t = np.array([1e-9 * (s.stamp_ns - START_NS) for s in out])
    apart = ORIGIN.to_ned(*(np.array([getattr(s, name) for s in out]) for name in ("lat", "lon", "height")))[:, :2]
    apart = np.linalg.norm(apart - flight.ned[np.searchsorted(flight.stamps_ns, [s.stamp_ns for s in out])][:, :2], axis=1)
    sigma = np.array([s.horizontal_sigma_m for s in out])
    assert apart[-1] > 100.0  # it was followed
    assert np.mean((apart / sigma)[t > 70.0] > 4.0) < 0.01
    assert sigma[t < 70.0].max() < 5.0 or sigma[(t > 40.0) & (t < 70.0)].max() < 3.0
