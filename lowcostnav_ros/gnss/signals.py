"""Signals: names of the systems and carrier frequencies."""

from lowcostnav_ros.base.units import SPEED_OF_LIGHT as SPEED_OF_LIGHT  # of this module too

L1_HZ = 1575.42e6
"""GPS L1 and Galileo E1 carrier, Hz."""
L1_WAVELENGTH_M = SPEED_OF_LIGHT / L1_HZ
"""m."""
GPS, GALILEO = "G", "E"
"""Letters of the systems, as RINEX has them."""
SYSTEM_NAMES = {"G": "GPS", "E": "Galileo", "R": "GLONASS", "C": "BeiDou", "S": "SBAS", "J": "QZSS", "I": "NavIC"}


def name(system: str, sat_id: int) -> str:
    """Name of a satellite as RINEX writes it, ``G07``."""
    return f"{system}{int(sat_id):02d}"
