"""One filter with all aids: the compass calibrated in flight, air data that creep away, and the wind's variability learned."""

import dataclasses
import math

import numpy as np
import pytest
from ahrs_flights import DEG, T0, Turn, settings

from lowcostnav_ros.aids._hard_iron import UNPROVEN
from lowcostnav_ros.base.measurements import AirVelocity, MagneticField
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.calibration.magnetometer_full import full_fit
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.estimation.error_state import Kind, Layout, random_walk
from lowcostnav_ros.estimation.growth import Growth
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs, AhrsSettings
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.rotation import quat_to_euler, wrap
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

IRON_UT = np.array([25.0, -28.0, 14.0])
LOAD_UT = np.array([10.0, 8.0, -5.0])


def flown(turn, end_s, iron_ut, gps_until_s, from_s=0.0):
    """An attitude reference after a turn with a field that ``iron_ut`` is added to from ``from_s`` on."""
    navigator = Ahrs(settings(airdata__enabled=False))
    for start, end, sources in ((0.0, min(gps_until_s, end_s), ("gps", "mag")), (gps_until_s, end_s, ("mag",))):
        for m in turn.measurements(start, max(end, start), sources):
            if isinstance(m, MagneticField) and m.stamp_ns - T0 >= 1e9 * from_s:
                m = dataclasses.replace(m, field_b=m.field_b + 1e-6 * iron_ut)
            navigator.feed(m)
    return navigator


def heading_error(navigator, turn):
    seconds = 1e-9 * (navigator.core.t_ns - T0)
    return abs(wrap(quat_to_euler(navigator.core.nav[6:10])[2] - turn.heading(seconds))) / DEG


def test_a_compass_with_40_microtesla_of_hard_iron_is_of_use_after_a_turn():
    turn = Turn(20.0)
    navigator = flown(turn, 100.0, IRON_UT, gps_until_s=80.0)
    rows = navigator.layout["hard_iron"]
    error, sigma = navigator.core.estimate[rows] - IRON_UT, np.sqrt(navigator.P.diagonal()[rows])
    assert np.all(np.abs(error) < 3.0 * sigma) and sigma.max() < 1.5
    assert heading_error(navigator, turn) < 1.0 and navigator.aid("magnetic_heading").status.accepted


def test_straight_flight_shows_no_heading_to_an_uncalibrated_compass():
    straight = Turn(0.0)
    navigator = flown(straight, 60.0, IRON_UT, gps_until_s=60.0)
    assert navigator.P[8, 8] > (5.0 * DEG) ** 2  # that of the track it began with; the gyro bias is all it has learned
    C, rows = navigator.core.C_nb(), navigator.layout["hard_iron"]
    east = (C @ navigator.P[rows, rows] @ C.T)[1, 1]
    level_ut = 1e6 * math.hypot(*straight.field_n[:2])
    assert east > 0.5 * navigator.P[8, 8] * (level_ut * math.cos(13.0 * DEG)) ** 2  # an error of the heading and iron across are one


@pytest.mark.parametrize("gps_until_s", [90.0, 30.0])
def test_a_load_that_is_switched_on_is_named_and_not_followed(gps_until_s):
    turn = Turn(15.0)
    navigator = flown(turn, 66.0, LOAD_UT, gps_until_s, from_s=60.0)
    assert {c.suspect for c in navigator.contradictions()} == {"imu/mag"}
    assert not navigator.aid("magnetic_heading").status.accepted
    assert heading_error(navigator, turn) < 1.5
    for m in turn.measurements(66.0, 90.0, ("gps", "mag") if gps_until_s > 66.0 else ("mag",)):
        loaded = isinstance(m, MagneticField)
        navigator.feed(dataclasses.replace(m, field_b=m.field_b + 1e-6 * LOAD_UT) if loaded else m)
    assert navigator.core.estimate[navigator.layout["hard_iron"]] == pytest.approx(LOAD_UT, abs=2.5)
    assert heading_error(navigator, turn) < 3.0


def test_a_compass_that_no_hard_iron_explains_shows_no_heading():
    turn, navigator = Turn(20.0), Ahrs(settings(airdata__enabled=False))
    for m in turn.measurements(0.0, 90.0, ("gps", "mag")):
        if isinstance(m, MagneticField):
            m = dataclasses.replace(m, field_b=np.array([m.field_b[1], -m.field_b[0], m.field_b[2]]))
        navigator.feed(m)
    assert navigator.aid("magnetic_heading").status.rejected[UNPROVEN] > 50
    assert navigator.contradictions()
    assert heading_error(navigator, turn) < 4.0 * math.sqrt(navigator.P[8, 8]) / DEG + 1.0


def test_settings_of_recordings_with_two_air_data_sensors_are_read():
    old = {"aids": ["gps", "magnetic", "airflow", "level"], "airflow.noise_mps": 0.7}
    assert from_mapping(AhrsSettings, old).airdata.noise_mps == 0.7
    assert from_mapping(InsGps.Settings, {"airdata": {"sideslip_deg": 2.5}}).airdata.sideslip_sigma_deg == 2.5


@pytest.mark.parametrize(("true", "low", "high"), [(4.0, 2.0, 5.0), (0.2, 0.0, 0.6)])
def test_how_fast_a_state_walks_is_learned(true, low, high):
    layout = Layout([random_walk("wind", ["n", "e"], Kind.WIND, 10.0, 0.1)])
    growth = Growth(layout, np.ones(2, bool), slice(0, 2), 2.0)
    rng, x = np.random.default_rng(3), np.array([3.0, -4.0])
    for k in range(300):
        x = x + true * 0.1 * rng.standard_normal(2)
        y = x + 0.5 * rng.standard_normal(2)
        growth.take(1_000_000_000 * (k + 1), y, np.eye(2), 0.25 * np.eye(2), np.zeros(2), np.zeros((2, 2)))
    assert low < growth.factor < high
    assert layout.psd == pytest.approx([(0.1 * growth.factor) ** 2] * 2)
    growth.restart()
    assert layout.psd == pytest.approx([0.01, 0.01]) and growth.factor == 1.0


def test_a_walk_measured_without_noise_begins_anew_instead_of_ending_the_flight():
    layout = Layout([random_walk("wind", ["n", "e"], Kind.WIND, 10.0, 0.0)])
    growth = Growth(layout, np.ones(2, bool), slice(0, 2), 2.0)
    for k in range(3):
        growth.take(10**9 * (k + 1), np.ones(2), np.eye(2), np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)))
        assert np.isfinite(growth.factor) and np.isfinite(layout.psd).all()


SCENARIO = """
name: outage
sensors: [imu, air_data, gps, magnetometer]
truth:
  kind: segments
  rate_hz: 50
  duration_s: 110.0
  mission: [straight duration_s=20, turn by_deg=150 bank_deg=20, straight duration_s=600]
  start: {lat_deg: 37.69, lon_deg: -121.82, height_m: 1500.0, heading_deg: 250.0, airspeed_mps: 50.0}
imu: {profile: automotive, rate_hz: 50.0}
air_data: {airspeed_error_mps: 0.5, rate_hz: 2.0}
magnetometer: {rate_hz: 5.0}
gps: {rate_hz: 2.0, outages_s: [[60.0, 200.0]]}
"""


def test_an_airspeed_that_creeps_away_in_an_outage_is_named_and_costs_little():
    truth, measurements = Simulation(scenario_from_text(SCENARIO, "outage")).whole()
    navigator = InsGps(from_mapping(InsGps.Settings, {"aids": ["gps", "magnetic", "airdata"]}))
    named = False
    for m in measurements:
        late_s = 1e-9 * (m.stamp_ns - truth.stamps_ns[0]) - 65.0
        if isinstance(m, AirVelocity) and late_s > 0.0:
            m = dataclasses.replace(m, vel_b=m.vel_b * max(0.4, 1.0 - 0.02 * late_s))
        navigator.feed(m)
        named = named or "airspeed and inertial motion disagree" in {c.name for c in navigator.contradictions()}
    assert named
    true = truth.vel_n[np.searchsorted(truth.stamps_ns, navigator.core.t_ns)]
    error, P = (navigator.core.nav[3:6] - true)[:2], navigator.P[3:5, 3:5]
    assert error @ np.linalg.solve(P, error) < 16.0
    assert np.hypot(*error) < 12.0  # of the 30 m/s that the airspeed has lost


def cloud(seed, factors=(1.0, 1.0, 1.0), xy=0.0):
    rng = np.random.default_rng(seed)
    unit = rng.standard_normal((300, 3))
    field = 48.0 * unit / np.linalg.norm(unit, axis=1, keepdims=True)
    soft = np.diag(factors)
    soft[0, 1] = soft[1, 0] = xy
    measured = field @ soft + IRON_UT + 0.2 * rng.standard_normal((300, 3))
    measured[:15] += rng.uniform(-30.0, 30.0, (15, 3))  # one in twenty is wrong
    return measured


def test_the_simplest_model_that_the_data_carry():
    bias, scale, cross = full_fit(cloud(1), 48.0), full_fit(cloud(2, (1.04, 0.97, 1.0)), 48.0), full_fit(cloud(3, xy=0.05), 48.0)
    np.testing.assert_array_equal(bias.matrix, np.eye(3))
    assert bias.scale_sigma.max() > 0.0  # what was left out is not claimed to be none
    assert scale.scale == pytest.approx([1.04, 0.97, 1.0], abs=0.005) and scale.matrix[0, 1] == 0.0
    assert cross.matrix[0, 1] == pytest.approx(-0.05, abs=0.005)
    for fit in (bias, scale, cross):
        assert np.all(np.abs(fit.hard_iron - IRON_UT) < 4.0 * fit.hard_iron_sigma) and fit.hard_iron_sigma.max() < 0.2


def test_a_factor_that_no_magnetometer_has_is_refused():
    with pytest.raises(CalibrationError, match="is no magnetometer's"):
        full_fit(cloud(4), 33.0)
