"""What the airframe does to a carrier: the aircraft shadows its own antenna, and in the shadow the reflections turn the phase round.

The antenna lies flush in the middle of a plate, whose edge shadows what is beyond its plane.  A carrier with reflections and noise about it
slips a cycle where their sum turns the whole vector about the origin (the clicks of a frequency discriminator).  No number here knows of
bank: where the transmitters stand as seen from the antenna decides.

References
----------
ITU-R P.526, section 4.1: loss at a knife edge, equations (26) and (31).
S. O. Rice, Noise in FM receivers, in Time Series Analysis, Wiley, 1963: a carrier of power ratio K to the noise about it is carried round
the origin r erfc(sqrt(K)) times a second, either way alike, r the radius of gyration of the noise's spectrum.
W. Khawaja et al., A survey of air-to-ground propagation channel modeling for unmanned aerial vehicles, 2018: K of 12 to 14 dB at L band in
flights over hills, suburbs and desert.
D. W. Matolak et al., on airframe shadowing of a medium-sized aircraft: more than 30 dB, for tens of seconds.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.settings import setting


@dataclass(frozen=True)
class AirframeSettings:
    """The antenna on the airframe, and what surrounds the carrier."""

    antenna: str = setting("free", "Where the antenna is; free: nothing shadows it.", choices=("free", "belly", "roof"))
    edge_m: float = setting(8.3, "From the antenna to the edge that shadows it: half the span.", unit="m", minimum=0.1, maximum=50.0)
    k_factor_db: float = setting(13.0, "Power of an unshadowed carrier over its reflections.", unit="dB", minimum=-20.0, maximum=60.0)
    loop_hz: float = setting(18.0, "Noise bandwidth of the carrier loop: faster ones do not show.", unit="Hz", minimum=0.1, maximum=100.0)


def shadow_db(beyond: np.ndarray, edge_m: float, wavelength_m: float) -> np.ndarray:
    """Loss, dB, at an angle ``beyond`` (n,), rad, the plane of the edge; negative angles are in sight."""
    v = np.asarray(beyond) * math.sqrt(2.0 * edge_m / wavelength_m)
    lost = np.maximum(v, -0.78) - 0.1
    return np.maximum(6.9 + 20.0 * np.log10(np.sqrt(lost**2 + 1.0) + lost), 0.0)


def turns_per_s(ratio: np.ndarray, loop_hz: float) -> np.ndarray:
    """How often reflections carry a carrier round the origin, 1/s, at power ratios (n,); their spectrum is that of the loop, flat."""
    return loop_hz / math.sqrt(3.0) * np.array([math.erfc(math.sqrt(k)) for k in ratio])


def slips_per_s(settings: AirframeSettings, sight_b: np.ndarray, wavelength_m: float) -> np.ndarray | None:
    """Slips of each carrier, 1/s, from the lines of sight (n, 3) to the transmitters in body axes; None where nothing shadows."""
    if settings.antenna == "free":
        return None
    down = np.arcsin(np.clip(sight_b[:, 2], -1.0, 1.0))
    beyond = -down if settings.antenna == "belly" else down
    ratio = 10.0 ** (0.1 * (settings.k_factor_db - shadow_db(beyond, settings.edge_m, wavelength_m)))
    return turns_per_s(ratio, settings.loop_hz)
