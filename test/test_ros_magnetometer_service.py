"""Magnetometer calibration in flight: what the services answer and the file they leave."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from std_srvs.srv import Trigger

from lowcostnav_ros.base.measurements import MagneticField, NavSolution
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.navigators.ahrs.navigator import AhrsSettings
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace, MagneticReference
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm
from lowcostnav_ros.ros.magnetometer_service import MagnetometerService

PLACE = (0.6578, -2.1262, 500.0)
HARD_IRON_T = np.array([8e-6, -5e-6, 3e-6])


class Node:
    """Stands in for a node: keeps the services."""

    def __init__(self):
        self.services = {}

    def create_service(self, kind, name, callback):
        self.services[name] = callback

    def get_name(self):
        return "ahrs"

    def call(self, name):
        return self.services[name](Trigger.Request(), Trigger.Response())


@pytest.fixture
def flight(tmp_path):
    node = Node()
    navigator = SimpleNamespace(magnetic=FieldAtPlace(MagneticReference(2026.5, []), PLACE), q_nb=None)
    navigator.output = lambda: NavSolution(1, "ahrs", q_nb=navigator.q_nb)
    return node, navigator, MagnetometerService(node, navigator, tmp_path), tmp_path


def turn(navigator, service, banks_deg, seed=0):
    rng = np.random.default_rng(seed)
    field_n = navigator.magnetic.reference.model.field_n(*PLACE)
    for bank in banks_deg:
        for heading in np.arange(0.0, 360.0, 2.0):
            navigator.q_nb = euler_to_quat(np.radians(bank), np.radians(0.2 * bank), np.radians(heading))
            field_b = quat_to_dcm(navigator.q_nb).T @ field_n + HARD_IRON_T + 2e-7 * rng.standard_normal(3)
            service.take(MagneticField(1, "imu/mag", field_b, np.eye(3) * 1e-14))


def test_a_turn_with_banks_ends_in_a_file_that_the_ahrs_loads(flight):
    node, navigator, service, folder = flight
    answer = node.call("~/calibrate_start")
    assert answer.success and "Turn through all headings" in answer.message or "level turn" in answer.message
    turn(navigator, service, (0.0, 30.0, -30.0, 45.0, -45.0))
    assert "share" in next(iter(service.rows())).values
    answer = node.call("~/calibrate_stop")
    assert answer.success, answer.message
    (path,) = folder.glob("*.yaml")
    assert str(path) in answer.message
    calibration = load_settings(AhrsSettings, path, "ahrs").magnetometer
    field_n = navigator.magnetic.reference.model.field_n(*PLACE)
    corrected = calibration.apply(field_n + HARD_IRON_T)
    assert corrected == pytest.approx(field_n, abs=0.02 * np.linalg.norm(field_n))
    assert np.array(calibration.hard_iron_ut) == pytest.approx(1e6 * HARD_IRON_T, abs=0.5)


def test_what_cannot_be_done_is_said(flight):
    node, navigator, service, folder = flight
    assert "calibrate_start first" in node.call("~/calibrate_stop").message
    node.call("~/calibrate_start")
    answer = node.call("~/calibrate_stop")
    assert not answer.success and answer.message.endswith((".", "attitudes."))
    navigator.magnetic.place = None
    answer = node.call("~/calibrate_start")
    assert not answer.success and "wait for a GPS fix" in answer.message
    assert not list(folder.iterdir())
