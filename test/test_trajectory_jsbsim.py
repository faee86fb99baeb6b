"""The flight-dynamics aircraft: it flies what it is told, and its truth agrees with the library's own accelerometer and gyros."""

import dataclasses
import math

import numpy as np
import pymap3d
import pytest

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.physics.rotation import euler_to_quat, eulers_to_quat, quat_conjugate, quat_rotate, quats_to_euler
from lowcostnav_ros.physics.strapdown import ideal_increments, strapdown_step
from lowcostnav_ros.trajectory import StartSettings, TruthSettings, WindSettings, build, standard
from lowcostnav_ros.trajectory.jsbsim_flight import _SCALES, FOOT, Aircraft

WINDY = WindSettings(north_mps=-4.0, east_mps=6.0, variation_sigma_mps=3.0, turbulence_sigma_mps=0.7)


def settings(*mission: str, wind: WindSettings = WindSettings(), **changes) -> TruthSettings:  # noqa: B008 - frozen
    return TruthSettings(kind="jsbsim", mission=list(mission), wind=wind, start=StartSettings(height_m=900.0, heading_deg=90.0), **changes)


@pytest.fixture(scope="module")
def demo():
    return build(dataclasses.replace(standard("demo", kind="jsbsim"), wind=WINDY, duration_s=600.0), 1).table()


def test_still_air_flight_is_steady_before_the_first_manoeuvre():
    truth = build(settings("straight duration_s=30")).table()
    angles = np.degrees(quats_to_euler(truth.q_nb))
    assert np.ptp(angles[:, 0]) < 0.5
    assert np.ptp(angles[:, 1]) < 0.2
    assert np.abs(truth.height - 900.0).max() < 1.0
    np.testing.assert_allclose(np.linalg.norm(truth.vel_n, axis=1), 50.0, atol=0.2)
    assert np.abs(truth.angular_rate_b[:50]).max() < math.radians(0.2)


def test_manoeuvres_are_flown_without_hunting():
    mission = ("turn by_deg=180 bank_deg=25", "climb to_height_m=1000 rate_mps=2.5", "speed to_mps=55", "straight duration_s=60")
    truth = build(settings(*mission)).table()
    angles = np.degrees(quats_to_euler(truth.q_nb))
    assert angles[:, 0].max() == pytest.approx(25.0, abs=2.5)
    assert angles[-1, 2] == pytest.approx(270.0, abs=1.0)
    assert truth.height[-1] == pytest.approx(1000.0, abs=2.0)
    assert truth.height.max() < 1012.0
    assert np.linalg.norm(truth.vel_n[-1]) == pytest.approx(55.0, abs=0.5)
    assert np.ptp(angles[-2000:, 1]) < 0.3  # pitch over the last 20 s: no porpoising
    assert np.ptp(truth.specific_force_b[-2000:, 2]) < 0.15


def test_orbit_keeps_its_radius_over_ground_in_wind():
    north = 37.69 + math.degrees(900.0 / 6.36e6)
    circle = f"orbit lat_deg={north} lon_deg=-121.82 radius_m=900 laps=2 side=left"
    truth = build(settings(circle, wind=dataclasses.replace(WINDY, north_mps=8.0))).table()
    east, north_m, _ = pymap3d.geodetic2enu(np.degrees(truth.lat), np.degrees(truth.lon), truth.height, north, -121.82, 900.0)
    radius = np.hypot(east, north_m)[3000:]
    assert np.abs(radius - 900.0).max() < 120.0


def test_imu_agrees_with_the_forces_and_rates_of_the_library():
    """Specific force is the total of aerodynamic and propulsive force over mass, and the gyros see the inertial body rate."""
    flight = settings("straight duration_s=1", duration_s=3.0)
    aircraft = Aircraft(flight, 0, np.zeros(3))
    aircraft.control((0.05, -0.15, 0.1, 0.6))  # a doublet's worth of everything, no autopilot
    truth, force, rate = _fly_open_loop(aircraft, 300)
    middle = (force[1:] + force[:-1]) / 2, (rate[1:] + rate[:-1]) / 2
    scale = np.abs(force).max(axis=0)
    assert scale[1] > 0.1 and np.abs(rate).max() > 0.1
    np.testing.assert_allclose(truth[0][20:], middle[0][20:], atol=0.1)
    np.testing.assert_allclose(truth[1][20:], middle[1][20:], atol=2e-3)


def _fly_open_loop(aircraft: Aircraft, steps: int):
    rows, force, rate = [], [], []
    for _ in range(steps):
        fdm = aircraft.fdm
        rows.append(np.array(aircraft.sample()) * _SCALES)
        force.append([fdm[f"forces/fb{axis}-total-lbs"] / fdm["inertia/mass-slugs"] * FOOT for axis in "xyz"])
        rate.append([fdm[f"velocities/{axis}i-rad_sec"] for axis in "pqr"])
        fdm.run()
    x = np.array(rows)
    stamps_ns = np.arange(steps) * 10_000_000
    quats = eulers_to_quat(np.ascontiguousarray(x[:, 6:9]))
    imu = ideal_increments(stamps_ns, x[:, 0], x[:, 1], x[:, 2], np.ascontiguousarray(x[:, 3:6]), quats)
    return [column[1:] for column in imu], np.array(force), np.array(rate)


def test_air_relative_velocity_agrees_with_the_airspeed_and_flow_angles_of_the_library():
    flight = settings("straight duration_s=1", wind=dataclasses.replace(WINDY, turbulence_sigma_mps=2.0))
    aircraft = Aircraft(flight, 0, np.array([-4.0, 6.0, 0.0]))
    for _ in range(500):
        aircraft.fdm.run()
    fdm = aircraft.fdm
    names = "atmosphere/total-wind-{}-fps", "velocities/v-{}-fps"
    wind, vel = (np.array([fdm[name.format(axis)] for axis in ("north", "east", "down")]) for name in names)
    assert np.linalg.norm(wind - np.array([-4.0, 6.0, 0.0]) / FOOT) > 1.0  # turbulence is part of it
    assert np.linalg.norm(vel - wind) == pytest.approx(fdm["velocities/vt-fps"], rel=1e-3)
    q_nb = euler_to_quat(fdm["attitude/phi-rad"], fdm["attitude/theta-rad"], fdm["attitude/psi-rad"])
    u, v, w = quat_rotate(quat_conjugate(q_nb), vel - wind)
    assert math.atan2(w, u) == pytest.approx(fdm["aero/alpha-rad"], abs=1e-3)
    assert math.asin(v / math.hypot(u, v, w)) == pytest.approx(fdm["aero/beta-rad"], abs=1e-3)


def test_ideal_imu_reintegrates_to_the_flight_over_ten_minutes(demo):
    """The library integrates in inertial coordinates over its own ellipsoid; position here comes from the IMU alone."""
    nav = np.concatenate(([demo.lat[0], demo.lon[0], demo.height[0]], demo.vel_n[0], demo.q_nb[0]))
    dv, dtheta = demo.specific_force_b * 0.01, demo.angular_rate_b * 0.01
    for k in range(1, len(demo)):
        strapdown_step(nav, dv[k], dtheta[k], dv[k - 1], dtheta[k - 1], 0.01)
    missed = pymap3d.geodetic2enu(*nav[:3], demo.lat[-1], demo.lon[-1], demo.height[-1], deg=False)
    assert np.abs(missed).max() < 0.05


def test_demo_flight_is_one_a_pilot_would_fly(demo):
    angles = np.degrees(quats_to_euler(demo.q_nb))
    airspeed = np.linalg.norm(demo.vel_n - demo.wind_n, axis=1)
    assert np.abs(angles[:, 0]).max() < 32.0
    assert np.abs(angles[:, 1]).max() < 12.0
    assert airspeed.min() > 44.0 and airspeed.max() < 60.0
    assert np.ptp(demo.wind_n[:, 2]) > 0.5  # turbulence is there


def test_same_seed_same_bits_whatever_the_blocks():
    trajectory = build(settings("straight duration_s=8", wind=WINDY), 5)
    whole, parts = trajectory.table(), list(trajectory.blocks(0.3))
    for name in ("stamps_ns", "lat", "q_nb", "specific_force_b", "wind_n"):
        np.testing.assert_array_equal(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name))
    other = build(settings("straight duration_s=8", wind=WINDY), 6).table()
    assert not np.array_equal(other.vel_n, whole.vel_n)


def test_impossible_start_is_refused_and_the_library_is_silent(capfd):
    with pytest.raises(SettingsError, match="cannot fly level at 250 m/s"):
        build(TruthSettings(kind="jsbsim", start=StartSettings(airspeed_mps=250.0)))
    build(settings("straight duration_s=1")).table()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("height", "sigma"), [(400.0, 1.0), (1200.0, 1.0), (1200.0, 2.0)])
def test_turbulence_has_about_the_sigma_asked_for(height, sigma):
    start = StartSettings(height_m=height)
    flight = TruthSettings(kind="jsbsim", mission=["straight duration_s=200"], start=start, wind=WindSettings(turbulence_sigma_mps=sigma))
    wind = np.concatenate([block.wind_n for block in build(flight, 1).blocks()])
    np.testing.assert_allclose(wind.std(axis=0), sigma, rtol=0.35)
