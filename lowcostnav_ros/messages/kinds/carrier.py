"""``pseudolite/raw`` and ``gnss/carrier``: code, carrier and Doppler of several transmitters as a point cloud, one point a signal.

The fields, little-endian, 110 bytes a point:

=========== ======== ====== ========================================================================================
field       type     unit   meaning
=========== ======== ====== ========================================================================================
x y z       float64  m      transmitter, ECEF; all zero where the station table says it
vx vy vz    float64  m/s    its velocity, ECEF
code        float64  m      pseudorange
carrier     float64  cycles carrier phase, counted since lock, positive with the range
doppler     float64  Hz     positive closing
wavelength  float64  m
cn0         float64  dB-Hz  carrier to noise density, 0 where unknown
ident       uint8[4]        ident in the station table in ASCII, or a satellite such as G07; zeros after it
flags       uint8           bit 0: the code is valid, bit 1: carrier and Doppler are
=========== ======== ====== ========================================================================================

``gnss/carrier`` holds GPS carrier from a rover and a base: the difference of the two receivers' observations, to which the base's own
distance to the satellite, at the same instant, is added back.  What satellite and atmosphere add cancels; the clock left is the difference
of both.  A transmitter that appears twice is taken out, whatever its points say: which of them is it cannot be told.
"""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.messages import clouds
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import ANTENNA_FRAMES, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.samples import PLACE, VELOCITY, Instant
from lowcostnav_ros.messages.topics import POINT_CLOUD
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef

_REALS = ("x", "y", "z", "vx", "vy", "vz", "code", "carrier", "doppler", "wavelength", "cn0")
POINT = np.dtype([*((name, "<f8") for name in _REALS), ("ident", "S4"), ("flags", "u1")])
"""One point as it lies in the data of the message."""
MOST = 100
CARRIER_FRAMES = ANTENNA_FRAMES | {"pseudolite"}
FARTHEST_M, MOST_CYCLES, MOST_HZ = 6.0e7, 1.0e12, 1.0e6
"""Bounds beyond which a code (a clock may make it negative), a carrier and a Doppler mean nothing."""
WAVELENGTHS_M = (0.01, 2.0)
FASTEST_MPS = 1.0e5


def _encode(epoch: CarrierEpoch) -> Any:
    points = np.zeros(len(epoch), POINT)
    if epoch.pos_e is not None and epoch.vel_e is not None:
        for k, name in enumerate("xyz"):
            points[name], points[f"v{name}"] = epoch.pos_e[:, k], epoch.vel_e[:, k]
    columns = epoch.code_m, epoch.carrier_cycles, epoch.doppler_hz, epoch.wavelength_m, epoch.cn0
    for name, column in zip(_REALS[6:], columns, strict=True):
        points[name] = column
    points["ident"], points["flags"] = epoch.ident.astype("S4"), epoch.code_valid + 2 * epoch.carrier_valid
    return clouds.cloud_of(epoch.stamp_ns, "gps", points)


def _decode(message: Any, received: Received) -> CarrierEpoch:
    """Turn a PointCloud2 message object into an epoch; what cannot be is kept as not valid and counted in ``notes``."""
    received.frame(message.header.frame_id)
    points = _once_each(clouds.points_of(message, POINT, MOST, "transmitters"), received)
    place, velocity = (np.column_stack([points[f"{v}{name}"] for name in "xyz"]) for v in ("", "v"))
    with np.errstate(invalid="ignore", over="ignore"):
        shortest, longest = WAVELENGTHS_M
        placed = (np.abs(place) < FARTHEST_M).all(axis=1) & (np.abs(velocity) < FASTEST_MPS).all(axis=1)
        good_code = placed & (np.abs(points["code"]) < FARTHEST_M)
        good_wave = (points["wavelength"] >= shortest) & (points["wavelength"] <= longest)
        good_carrier = placed & good_wave & (np.abs(points["carrier"]) < MOST_CYCLES) & (np.abs(points["doppler"]) < MOST_HZ)
    stated_code, stated_carrier = (points["flags"] & 1) != 0, (points["flags"] & 2) != 0
    for what, wrong in (("code", stated_code & ~good_code), ("carrier", stated_carrier & ~good_carrier)):
        if wrong.any():
            received.notes[f"{received.kind.name}: implausible {what} not used"] += int(np.count_nonzero(wrong))
    code = np.where(good_code, points["code"], 0.0)
    carrier, doppler = (np.where(good_carrier, points[name], 0.0) for name in ("carrier", "doppler"))
    columns = code, carrier, doppler, np.where(good_wave, points["wavelength"], 1.0), np.where(points["cn0"] >= 0.0, points["cn0"], 0.0)
    valid = stated_code & good_code, stated_carrier & good_carrier
    moving = (np.where(placed[:, None], place, 0.0), np.where(placed[:, None], velocity, 0.0)) if place.any() else (None, None)
    ident = np.char.upper(np.char.decode(points["ident"], "ascii", "replace"))
    return CarrierEpoch(*received.head, ident, *columns, *valid, *moving)


def _once_each(points: np.ndarray, received: Received) -> np.ndarray:
    _, place, counts = np.unique(points["ident"], return_inverse=True, return_counts=True)
    single = counts[place] == 1
    if not single.any():
        raise Refusal("every transmitter appears twice")
    if not single.all():
        received.notes[f"{received.kind.name}: transmitter appears twice, not used"] += int(np.count_nonzero(~single))
    return points[single]


def _sample(at: Instant) -> CarrierEpoch:
    """Noise-free observations of five transmitters on the ground that say themselves where they are, for the warm-up."""
    wavelength, C = 0.19, dcm_ne(*PLACE[:2])
    around = 5000.0 * np.array([[1.0, 0.0, 0.1], [-1.0, 1.0, 0.1], [-1.0, -1.0, 0.1], [0.0, 0.3, 0.1], [3.0, 0.5, 0.1]])
    pos_e, place_e = geodetic_to_ecef(*PLACE) + around @ C, geodetic_to_ecef(*at.place)
    away = pos_e - place_e
    ranges = np.linalg.norm(away, axis=1)
    closing = (away / ranges[:, None]) @ (dcm_ne(*at.place[:2]).T @ VELOCITY)
    ones, idents = np.ones(5), np.array(["W1", "W2", "W3", "W4", "W5"])
    observed = ranges, ranges / wavelength, closing / wavelength, ones * wavelength, 0.0 * ones
    return at.of(CarrierEpoch, idents, *observed, ones > 0.0, ones > 0.0, pos_e, np.zeros((5, 3)))


describe(
    __name__,
    TopicSpec("pseudolite/raw", POINT_CLOUD, "Code, carrier and Doppler of ground transmitters; see messages.kinds.carrier.", "gps", "m"),
    TopicSpec("gnss/carrier", POINT_CLOUD, "GPS code and carrier against a base; see messages.kinds.carrier.", "gps", "m"),
    measurement=CarrierEpoch,
    decode=_decode,
    encode=_encode,
    frames=CARRIER_FRAMES,
    sample=_sample,
    sensed=True,
)
