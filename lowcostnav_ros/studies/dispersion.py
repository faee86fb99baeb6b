"""What free electrons do to the code and the carrier of a signal (Solimeno 2007, section 2.3.3)."""

from lowcostnav_ros.gnss.signals import L1_HZ

L2_HZ = 1227.60e6
"""GPS L2 carrier, Hz."""
TEC_UNIT = 1.0e16
"""Electrons per square metre in one TECU."""
_REFRACTION = 40.3
"""m^3/s^2; second-order refractivity of free electrons."""


def group_delay_m(electrons_per_m2: float, frequency_hz: float = L1_HZ) -> float:
    """Range by which the code comes late through ``electrons_per_m2`` of total electron content: 40.3 TEC/f^2, m."""
    return _REFRACTION * electrons_per_m2 / frequency_hz**2


def phase_delay_m(electrons_per_m2: float, frequency_hz: float = L1_HZ) -> float:
    """Range by which the carrier comes late, m: minus the group delay (it comes early)."""
    return -group_delay_m(electrons_per_m2, frequency_hz)
