"""The heading and attitude reference, the axial pitot tube, the receiver that repeats and the periodic winds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sensors_truth import cuts, flat, steady_truth

from lowcostnav_ros.base.measurements import AirVelocity, GpsPosition
from lowcostnav_ros.messages.decode import decode
from lowcostnav_ros.messages.encode import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import spec
from lowcostnav_ros.physics.rotation import quat_to_dcm, quat_to_euler
from lowcostnav_ros.sensors.airdata import AirDataSimulator, AirDataSimulatorSettings
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings
from lowcostnav_ros.sensors.hars import DEGREE_PER_HOUR, HarsSimulator, HarsSimulatorSettings
from lowcostnav_ros.trajectory.truth_settings import WindSettings
from lowcostnav_ros.trajectory.wind import Wind, triangle

QUIET = {"noise_mrad": 0.0, "rate_noise_deg_s": 0.0, "random_drift_deg_h": 0.0, "pitch_error_mrad": 0.0, "bank_error_mrad": 0.0}


def test_erection_ends_at_drift_times_its_time_constant():
    hars = HarsSimulator(HarsSimulatorSettings(rate_hz=10.0, **QUIET))
    truth = steady_truth(1500.0, 10, heading=0.7)
    last = hars.simulate(truth)[-1]
    zeta = 150.0 * hars.drift
    assert 0.02 < math.degrees(np.abs(zeta).max()) < 0.5
    C_true, C_seen = quat_to_dcm(truth.q_nb[-1]), quat_to_dcm(last.q_nb)
    assert C_true @ C_seen.T == pytest.approx(np.eye(3) + np.cross(np.eye(3), zeta), abs=1e-5)  # V = (I + Z) V~ : it is the correction


def test_without_erection_the_drift_adds_up():
    hars = HarsSimulator(HarsSimulatorSettings(rate_hz=10.0, cutout_g=0.1, **QUIET))
    truth = steady_truth(100.0, 10)
    turning = replace(truth, specific_force_b=1.3 * truth.specific_force_b)
    hars.simulate(turning)
    assert hars.misalignment == pytest.approx(100.0 * hars.drift, rel=1e-9)
    assert np.abs(hars.drift / DEGREE_PER_HOUR).max() < 12.0


def test_a_markov_misalignment_has_the_sigma_that_is_set():
    settings = HarsSimulatorSettings(rate_hz=1.0, drift_deg_h=0.0, misalignment_deg=0.1, seed=4, **(QUIET | {"random_drift_deg_h": 0.0}))
    seen = HarsSimulator(settings).simulate(steady_truth(20_000.0, 1, heading=0.7))
    tilt = np.array([quat_to_euler(m.q_nb) for m in seen])
    assert math.degrees(tilt.std(axis=0).mean()) == pytest.approx(0.1, rel=0.2)


def test_it_reads_magnetic_heading_low_pitch_and_low_bank():
    settings = HarsSimulatorSettings(drift_deg_h=0.0, variation_deg=6.0, **(QUIET | {"pitch_error_mrad": 0.6, "bank_error_mrad": 0.5}))
    roll, pitch, heading = quat_to_euler(HarsSimulator(settings).simulate(steady_truth(0.1, heading=1.0))[0].q_nb)
    assert [roll, pitch, heading] == pytest.approx([-0.5e-3, -0.6e-3, 1.0 - math.radians(6.0)], abs=1e-6)


def test_cutting_changes_no_bit_and_the_message_comes_back():
    make = lambda: HarsSimulator(HarsSimulatorSettings(misalignment_deg=0.1, cutout_g=0.05))  # noqa: E731
    truth = steady_truth(5.0)
    whole, parts = make().simulate(truth), make()
    assert flat([m for block in cuts(truth, [7, 1, 13]) for m in parts.simulate(block)]) == flat(whole)
    sent = whole[3]
    received = decode(sent.source, spec(sent.source).msgtype, to_cdr(encode(sent)))
    assert received.q_nb == pytest.approx(sent.q_nb, abs=1e-12)
    assert np.linalg.norm(received.specific_force_b) == pytest.approx(9.80665)  # none was sent: that of unaccelerated flight


def test_an_axial_tube_sees_the_forward_component():
    """3 deg of sideslip and incidence: V = Vx / (cos a cos b); with vanes the whole comes back."""
    a, b, speed = math.radians(4.0), math.radians(3.0), 60.0
    air_b = speed * np.array([math.cos(a) * math.cos(b), math.sin(b), math.sin(a) * math.cos(b)])
    perfect = {"airspeed_error_mps": 0.0, "altitude_error_m": 0.0, "airspeed_noise_mps": 0.01, "static_noise_pa": 0.01}
    perfect |= {"temperature_noise_k": 0.01, "vane_noise_deg": 0.0, "vane_offset_deg": 0.0}
    truth = steady_truth(0.1)
    truth = replace(truth, vel_n=np.tile(air_b, (len(truth), 1)))
    settings = AirDataSimulatorSettings(axial=True, vanes=True, scale=-0.02, offset_mps=1.0, **perfect)
    seen = [m for m in AirDataSimulator(settings).simulate(truth) if isinstance(m, AirVelocity)][0]
    assert seen.vel_b / seen.vel_b[0] == pytest.approx(air_b / air_b[0], abs=1e-6)
    assert seen.vel_b[0] == pytest.approx(0.98 * air_b[0] + 1.0, abs=0.05)
    bare = AirDataSimulator(AirDataSimulatorSettings(computer=False)).simulate(truth)
    assert {m.source for m in bare} == {"air/static_pressure", "air/dynamic_pressure", "air/temperature"}


def test_a_receiver_that_fixes_once_a_second_and_puts_out_more():
    settings = GpsSimulatorSettings(rate_hz=1.0, repeat_hz=12.5, outages_s=[3.0, 5.0])
    truth = steady_truth(8.0)
    fixes = [m for m in GpsSimulator(settings).simulate(truth) if isinstance(m, GpsPosition)]
    assert len({m.stamp_ns for m in fixes}) == len(fixes) == pytest.approx(6 * 13, abs=6)
    assert len({m.lat for m in fixes}) == 6
    parts = GpsSimulator(settings)
    assert flat([m for block in cuts(truth, [7, 1, 13]) for m in parts.simulate(block)]) == flat(GpsSimulator(settings).simulate(truth))


def test_periodic_winds():
    assert triangle(np.array([0.0, 0.25, 0.5, 0.75, 1.0])).tolist() == [0.0, 1.0, 0.0, -1.0, 0.0]
    t = np.arange(0.0, 240.0, 1.0)
    for pattern, largest_step in (("sinusoidal", 2.0 * math.pi * 10.3 / 160.0), ("triangle", 4.0 * 10.3 / 160.0)):
        wind = Wind(WindSettings(pattern=pattern, pattern_mps=10.3), 1, 0.0, 50.0).steady(t, np.zeros(len(t)))
        assert np.abs(wind[:, 0]).max() == pytest.approx(10.3, rel=0.02)
        assert np.abs(np.diff(wind[:, 0])).max() == pytest.approx(largest_step, rel=0.01)
        assert wind[60, 1] == pytest.approx(10.3, rel=1e-9)  # a quarter of 240 s
