"""Modes: text and level in one, and further ones that a navigator outside the package brings."""

import json

import pytest

from lowcostnav_ros.base import modes
from lowcostnav_ros.base.modes import Level, Mode, level_of, register_modes
from lowcostnav_ros.navigators.supervisor.modes import MODES


def test_a_mode_is_its_name_and_knows_its_level():
    assert Mode.GPS == "gps" and f"{Mode.GPS}" == "gps" and json.dumps({Mode.GPS: Mode.GPS}) == '{"gps": "gps"}'
    assert {"gps": 1.0}[Mode.GPS] == 1.0
    assert (Mode.CALIBRATING.level, Mode.COASTING.level, Mode.NO_GO.level) == (Level.OK, Level.WARN, Level.ERROR)
    assert (int(Level.OK), int(Level.WARN), int(Level.ERROR)) == (0, 1, 2)  # as diagnostic_msgs numbers them
    with pytest.raises(AttributeError):
        _ = Mode.CALIBRATNG


def test_the_supervisor_has_no_mode_of_its_own():
    assert set(MODES) <= set(Mode)


def test_further_modes_are_registered_with_their_level(monkeypatch):
    monkeypatch.setattr(modes, "_LEVELS", dict(modes._LEVELS))
    assert level_of("gliding") is Level.WARN
    register_modes({"gliding": Level.OK, "gps": Level.OK})
    register_modes({"gliding": Level.OK})
    assert level_of("gliding") is Level.OK and level_of("failed") is Level.ERROR
    with pytest.raises(ValueError, match="'gps' exists with the level OK"):
        register_modes({"gps": Level.ERROR})
    with pytest.raises(ValueError, match="choose another name"):
        register_modes({"gliding": Level.ERROR})
