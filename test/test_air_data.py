"""The air data computer: the standard's numbers, corrections, order of arrival, and pitot tubes blocked in every phase of flight."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import AirTemperature, Attitude, GpsPosition, GpsVelocity, Pressure
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.estimation.air_data import pitot
from lowcostnav_ros.estimation.air_data.computer import (
    AIR,
    BACKWARDS,
    GPS_VELOCITY,
    IMPACT,
    NO_STATIC,
    STANDARD_DAY,
    STATIC,
    TEMPERATURE,
    AirDataComputer,
    AirDataComputerSettings,
)
from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.wiring import completed
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.encode import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import spec
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag

NS, T0 = 1_000_000_000, 1_000_000_000_000


def epoch(t_s, altitude, tas, kelvin=None, vel_n=None):
    """Pressures (temperature, GPS velocity) of one instant."""
    stamp, p = T0 + round(t_s * NS), float(atmosphere.pressure(altitude))
    t = kelvin if kelvin is not None else float(atmosphere.temperature(altitude))
    out = [Pressure(stamp, STATIC, p, 4.0), Pressure(stamp, IMPACT, float(atmosphere.impact_from_tas(tas, p, t)), 100.0)]
    out += [AirTemperature(stamp, TEMPERATURE, kelvin, 0.25)] if kelvin is not None else []
    return out + ([GpsVelocity(stamp, GPS_VELOCITY, np.array(vel_n, float), 0.01 * np.eye(3))] if vel_n is not None else [])


def fed(computer, measurements):
    return [velocity for m in measurements for velocity in computer.feed(m)]


def test_airspeeds_of_the_standard():
    """ICAO atmosphere at 25 000 ft (37 601 Pa, 238.62 K), Mach 0.8: a = 309.67 m/s; the definitions of CAS and EAS."""
    altitude, mach = 7620.0, 0.8
    tas = mach * math.sqrt(1.4 * 287.05287 * 238.62)
    computer = AirDataComputer()
    (velocity,) = fed(computer, [replace(epoch(0.0, altitude, tas, 238.62)[2], stamp_ns=T0 - NS), *epoch(0.0, altitude, tas)])
    data = computer.latest
    impact = 37600.9 * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    cas = 340.294 * math.sqrt(5.0 * ((impact / 101325.0 + 1.0) ** (2.0 / 7.0) - 1.0))
    assert (data.mach, data.tas) == (pytest.approx(0.8, abs=1e-6), pytest.approx(tas, rel=1e-6))
    assert data.cas == pytest.approx(cas, rel=1e-4)
    assert data.eas == pytest.approx(mach * 340.294 * math.sqrt(37600.9 / 101325.0), rel=1e-4)
    assert data.pressure_altitude == pytest.approx(altitude, abs=0.1)
    assert velocity.source == AIR
    assert velocity.stamp_ns == T0


def test_a_missing_temperature_is_the_standard_atmosphere_and_said_so():
    computer = AirDataComputer(from_mapping(AirDataComputerSettings, {"temperature_timeout_s": 10.0}))
    fed(computer, epoch(-1.0, 3000.0, 60.0, 280.0))
    (with_probe,) = fed(computer, epoch(0.0, 3000.0, 60.0, 280.0))
    assert "standard" not in computer.sentence()
    (without,) = fed(computer, epoch(20.0, 3000.0, 60.0))
    assert STANDARD_DAY in computer.sentence()
    assert computer.remarks()[STANDARD_DAY] == 2
    assert without.cov_b[0, 0] > with_probe.cov_b[0, 0] + 1.0  # 15 K of 269 are 1.7 m/s of 60


def test_order_of_arrival_does_not_matter():
    flight = [m for k in range(40) for m in epoch(0.1 * k, 1000.0 + 0.5 * k, 50.0 + 0.1 * k, 280.0)]
    by_source = sorted(flight, key=lambda m: (m.stamp_ns, m.source))
    other = sorted(flight, key=lambda m: (m.stamp_ns, m.source), reverse=True)[::-1]
    late = sorted(flight, key=lambda m: m.stamp_ns + (150_000_000 if m.source == STATIC else 0))
    results = [fed(AirDataComputer(), order) for order in (by_source, other, late)]
    for one in results[1:]:
        for a, b in zip(results[0], one, strict=False):
            assert (a.stamp_ns, a.vel_b.tobytes()) == (b.stamp_ns, b.vel_b.tobytes())


def test_position_error_and_lag_are_taken_out():
    tas, altitude = 80.0, 2000.0
    static, impact = epoch(0.0, altitude, tas)
    error_pa = 60.0  # a port that reads high: both pressures carry it
    wrong = [replace(static, pressure_pa=static.pressure_pa + error_pa), replace(impact, pressure_pa=impact.pressure_pa - error_pa)]
    ias, cas = (float(atmosphere.cas_from_impact(m.pressure_pa)) for m in (wrong[1], impact))
    computer = AirDataComputer(from_mapping(AirDataComputerSettings, {"position_error_mps": [20.0, 0.0, ias, cas - ias]}))
    fed(computer, wrong)
    assert computer.latest.tas == pytest.approx(tas, rel=1e-6)
    assert computer.latest.pressure_altitude == pytest.approx(altitude, abs=0.01)
    lag_s, lagging = 0.4, AirDataComputer(from_mapping(AirDataComputerSettings, {"lag_s": 0.4}))
    for k in range(60):  # a steady climb: a first-order lag shows the pressures of tau ago
        fed(lagging, [replace(m, stamp_ns=m.stamp_ns + round(lag_s * NS)) for m in epoch(0.05 * k, 1000.0 + 0.5 * k, 60.0)])
    assert lagging.latest.pressure_altitude == pytest.approx(1000.0 + 0.5 * (59 + lag_s / 0.05), abs=0.3)


@pytest.mark.parametrize(
    ("table", "sentence"),
    [([10.0], "pairs of numbers"), ([20.0, 1.0, 10.0, 1.0], "increasing order"), ([20.0, math.nan], "finite")],
)
def test_a_table_that_is_none_is_one_sentence(table, sentence):
    with pytest.raises(SettingsError, match=sentence):
        from_mapping(AirDataComputerSettings, {"position_error_mps": table})


def flight(climb, duration_s=40.0, gps=True, wind=6.0, tas=60.0):
    """A straight flight with a climb rate: measurements at 10 Hz."""
    for k in range(round(10 * duration_s)):
        t = 0.1 * k
        yield t, epoch(t, 2000.0 + climb * t, tas, 275.0, (tas + wind, 0.01 * math.sin(k), -climb) if gps and k % 10 == 0 else None)


def changed(measurements, impact_of):
    return [replace(m, pressure_pa=impact_of(m.pressure_pa)) if m.source == IMPACT else m for m in measurements]


@pytest.mark.parametrize("climb", [5.0, -5.0])
@pytest.mark.parametrize("gps", [True, False])
def test_a_blocked_tube_is_found_in_climb_and_descent(climb, gps):
    computer, total, refused_at = AirDataComputer(), None, None
    for t, measurements in flight(climb, 60.0, gps):
        if t >= 20.0:
            static = measurements[0].pressure_pa
            total = static + measurements[1].pressure_pa if total is None else total
            measurements = changed(measurements, lambda _, held=total - static: held)
        computed = fed(computer, measurements)
        if t > 1.0 and not computed and refused_at is None:
            refused_at = t
    assert refused_at is not None
    assert 20.0 < refused_at < (40.0 if gps else 36.0)
    assert pitot.BLOCKED in computer.rejected or pitot.UNMOVED in computer.rejected


def test_an_iced_tube_is_found_in_cruise():
    computer, refused_at = AirDataComputer(), None
    for t, measurements in flight(0.0, 60.0):
        ice = max(0.0, 1.0 - max(t - 20.0, 0.0) / 40.0)
        computed = fed(computer, changed(measurements, lambda q, left=ice: q * left))
        if t > 1.0 and not computed and refused_at is None:
            refused_at = t
    assert refused_at is not None
    assert 20.0 < refused_at < 40.0
    assert computer.reason.phrase == pitot.UNMOVED


def test_a_tube_emptied_at_once_and_cleared_again():
    computer, refused, back = AirDataComputer(), None, None
    for t, measurements in flight(0.0, 60.0):
        blocked = 20.0 <= t < 35.0
        computed = fed(computer, changed(measurements, lambda q, gone=blocked: 0.0 if gone else q))
        refused = t if not computed and refused is None and t > 1.0 else refused
        back = t if computed and refused is not None and back is None else back
    assert refused == pytest.approx(20.0, abs=0.2)
    assert back == pytest.approx(40.0, abs=1.5)


@pytest.mark.parametrize("gps", [True, False])
def test_healthy_manoeuvres_raise_no_doubt(gps):
    """Climbs at constant airspeed, zooms at constant energy, accelerations, turns, a gust front of 6 m/s."""
    computer, altitude, tas, heading = AirDataComputer(), 1500.0, 50.0, 0.0
    rng = np.random.default_rng(3)
    for k in range(2400):
        t = 0.1 * k
        climb = 8.0 if 20 < t < 60 else -8.0 if 160 < t < 200 else 6.0 * math.sin(t / 7.0)
        tas += 0.1 * (1.5 if 60 < t < 75 else -9.8 * climb / tas if 75 < t < 150 else 0.0)
        altitude, heading = altitude + 0.1 * climb, heading + (0.02 if t > 100 else 0.0)
        wind = 6.0 if t > 130 else 0.0
        vel_n = (tas * math.cos(heading) + wind, tas * math.sin(heading), -climb)
        out = epoch(t, altitude, tas + 0.3 * rng.standard_normal(), 280.0, vel_n if gps and k % 2 == 0 else None)
        fed(computer, out)
    assert not computer.rejected, computer.rejected


def test_bad_input_is_counted_by_name():
    computer = AirDataComputer()
    fed(computer, epoch(0.0, 1000.0, 50.0))
    fed(computer, epoch(-1.0, 1000.0, 50.0))
    assert computer.rejected[BACKWARDS] == 2
    fed(computer, [Pressure(T0 + k * NS, IMPACT, 1500.0, 100.0) for k in range(3, 9)])
    assert computer.rejected[NO_STATIC] > 3
    for k in range(20, 30):
        fed(computer, changed(epoch(float(k), 1000.0, 50.0), lambda q: -q))
    assert computer.rejected[pitot.SWAPPED] > 3
    fed(computer, epoch(-100.0, 1000.0, 50.0))  # a recording that starts again
    assert fed(computer, epoch(-99.0, 1000.0, 50.0))


def test_a_replay_computes_the_airspeed_that_a_recording_lacks(tmp_path):
    """A flight recorded with its pressures and without its airspeed: dead reckoning runs, and the result says on what."""
    bag, place = tmp_path / "bag", (math.radians(37.0), math.radians(-122.0))
    level = np.array([1.0, 0.0, 0.0, 0.0])
    with BagWriter(bag) as writer:
        for t, measurements in flight(0.0, 12.0):
            stamp = measurements[0].stamp_ns
            measurements.append(Attitude(stamp, "imu/data_fused", level, 1e-4 * np.eye(3), np.zeros(3), np.zeros(3)))
            if len(measurements) > 4:
                measurements.append(GpsPosition(stamp, "gps/fix", place[0] + 66.0 * t / 6.37e6, place[1], 2000.0, np.eye(3)))
            for m in measurements:
                writer.write(m.source, spec(m.source).msgtype, stamp, to_cdr(encode(m)))
    result = replay_bag(bag, ReplayOptions(("dead_reckoning",)))
    assert result.navigators["dead_reckoning"].solutions > 50
    assert result.recording.assumed[f"{AIR} computed from pressures"] == 120
    assert STANDARD_DAY in result.recording.assumed


def test_up_adds_the_computer_where_nothing_publishes_an_airspeed():
    simulated = completed(load_graph("livermore"))
    assert "air_data_computer" not in [node.name for node in simulated.nodes]
    of_drivers = completed(load_graph("navigators_only"))
    assert [node.name for node in of_drivers.nodes][-1] == "air_data_computer"
    assert of_drivers.nodes[-1].config.name == "air_data_computer.yaml"


def test_the_node_computes_and_is_quiet_beside_another_publisher(ros):
    node_module = pytest.importorskip("lowcostnav_ros.nodes.air_data_computer")
    from geometry_msgs.msg import TwistWithCovarianceStamped
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import FluidPressure

    table, heard = ros.diagnostics(), []
    node = ros.make(node_module.AirDataComputerNode)
    senders = {name: ros.probe.create_publisher(FluidPressure, name, 50) for name in (STATIC, IMPACT)}
    ros.probe.create_subscription(TwistWithCovarianceStamped, AIR, heard.append, qos_profile_sensor_data)
    assert ros.spin_until(lambda: all(s.get_subscription_count() == 1 for s in senders.values()) and node.count_subscribers(AIR) == 1)

    def send(t_s):
        for m in epoch(t_s, 1000.0, 50.0):
            senders[m.source].publish(to_cdr(encode(m)))

    send(1.0)
    assert ros.spin_until(lambda: heard)
    assert heard[0].twist.twist.linear.x == pytest.approx(50.0, rel=1e-6)
    row = "air_data_computer: air data"
    assert ros.spin_until(lambda: row in table and "standard atmosphere" in table[row].message)
    other = ros.probe.create_publisher(TwistWithCovarianceStamped, AIR, 5)
    assert ros.spin_until(lambda: node.count_publishers(AIR) == 2)
    send(2.0)
    assert ros.spin_until(lambda: node.computer.computed == 2 and table[row].message.startswith("quiet"))
    assert len(heard) == 1
    ros.probe.destroy_publisher(other)
