"""Signals: names of the systems, carrier frequencies, and what the ionosphere does to a carrier (Solimeno 2007, section 2.3.3)."""

from lowcostnav_ros.base.units import SPEED_OF_LIGHT as SPEED_OF_LIGHT  # of this module too

L1_HZ = 1575.42e6
"""GPS L1 and Galileo E1 carrier, Hz."""
L2_HZ = 1227.60e6
"""GPS L2 carrier, Hz."""
L1_WAVELENGTH_M = SPEED_OF_LIGHT / L1_HZ
"""m."""
GPS, GALILEO = "G", "E"
"""Letters of the systems, as RINEX has them."""
SYSTEM_NAMES = {"G": "GPS", "E": "Galileo", "R": "GLONASS", "C": "BeiDou", "S": "SBAS", "J": "QZSS", "I": "NavIC"}
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


def name(system: str, sat_id: int) -> str:
    """Name of a satellite as RINEX writes it, ``G07``."""
    return f"{system}{int(sat_id):02d}"
