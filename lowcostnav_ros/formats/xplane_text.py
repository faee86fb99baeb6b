"""The text that a flight simulator sends to tablets: ``XGPS`` once a second, ``XATT`` as often as asked for.

The format has no way to say that something is not valid, so what is not given is not sent; it has none to say how good it is, so GDL 90 is
the better choice wherever a tablet takes it.

References
----------
ForeFlight, Network GPS: ``XGPSname,lon,lat,height above sea level m,track,speed m/s`` and ``XATTname,heading,pitch,roll``, UDP port 49002.
"""

from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.formats.cockpit import Picture

NAME = "lowcostnav"


class XPlaneText:
    """Lines of one aircraft."""

    def frames(self, picture: Picture, is_second: bool) -> list[bytes]:
        """Return what is given of position and attitude."""
        lines = []
        p = picture
        if is_second and p.lat is not None and p.lon is not None and p.height is not None and p.speed_mps is not None:
            track = (p.track if p.track is not None else p.heading or 0.0) / DEGREE  # an aircraft that stands points somewhere
            height = p.height - p.sea_level
            lines.append(f"XGPS{NAME},{p.lon / DEGREE:.6f},{p.lat / DEGREE:.6f},{height:.1f},{track:.2f},{p.speed_mps:.1f}")
        if p.roll is not None and p.pitch is not None and p.heading is not None:
            lines.append(f"XATT{NAME},{p.heading / DEGREE:.1f},{p.pitch / DEGREE:.1f},{p.roll / DEGREE:.1f}")
        return [line.encode("ascii") for line in lines]
