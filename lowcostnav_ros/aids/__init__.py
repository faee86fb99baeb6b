"""Aids: one file a sensor, with its settings, state blocks, inputs, innovation and recovery, shared by all navigators.

An aid sees its host through the views of :mod:`lowcostnav_ros.cores.views` and knows no navigator.
"""

from lowcostnav_ros.base.registry import Registry
from lowcostnav_ros.estimation.aiding import Sensor

AIDS: Registry[Sensor] = Registry("aid", "lowcostnav_ros.aids")
"""Sensors by name: the name is that of the module, of the group of settings, and of the entry in a navigator's list."""
