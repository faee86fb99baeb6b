"""``gnss/raw``: an epoch of satellite observations as a point cloud, one point per signal, to the last bit and back.

Any tool that shows a PointCloud2 shows the satellites: x, y, z are their ECEF positions.  The fields, little-endian, 91 bytes a point:

============= ======= ===== ==========================================================================================
field         type    unit  meaning
============= ======= ===== ==========================================================================================
x y z         float64 m     satellite position, ECEF, at the time of reception
vx vy vz      float64 m/s   satellite velocity, ECEF
pseudorange   float64 m     corrected for satellite clock, relativity, group delay, ionosphere and troposphere
doppler       float64 m/s   range rate, positive receding, corrected for the drift of the satellite clock
sigma         float64 m     1-sigma of the pseudorange
sigma_doppler float64 m/s   1-sigma of the range rate
cn0           float64 dB-Hz carrier to noise density, 0 where unknown
system        uint8         letter of the system in ASCII: G GPS, E Galileo
sat_id        uint8         number of the satellite within its system
flags         uint8         bit 0: the pseudorange is valid, bit 1: the range rate is
============= ======= ===== ==========================================================================================

The header's stamp is the time of reception; its frame is ``gps``, the antenna.

A navigator takes one observation of a satellite.  Where valid points of one satellite agree within their sigmas, as two signals of it do,
the one of the smallest sigma is taken.  Where they contradict each other none can be shown right, and all are excluded.
"""

from collections import Counter
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.gnss.signals import name as name_of
from lowcostnav_ros.messages import clouds
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import ANTENNA_FRAMES, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.samples import FLIGHT_S, VELOCITY, Instant
from lowcostnav_ros.messages.topics import POINT_CLOUD
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef

_REALS = ("x", "y", "z", "vx", "vy", "vz", "pseudorange", "doppler", "sigma", "sigma_doppler", "cn0")
_BYTES = ("system", "sat_id", "flags")
_FORMATS = dict.fromkeys(_REALS, np.dtype("<f8")) | dict.fromkeys(_BYTES, np.dtype("u1"))
POINT = np.dtype(list(_FORMATS.items()))
"""One point as it lies in the data of the message."""

NEAREST_M, FARTHEST_M = 1.5e7, 6.0e7
"""Pseudoranges outside are impossible for a navigation satellite; its distance from the earth's centre is held to the same."""

FASTEST_MPS = 1.0e5
"""No navigation satellite is faster, nor a range rate."""

LEAST_SIGMA_M, LEAST_SIGMA_MPS, ABSURD_SIGMA = 0.3, 0.01, 1.0e6
"""No code is measured and no satellite known better; a smaller sigma that is stated is raised, one beyond the last is no sigma."""

SAME_SIGMAS = 5.0
"""Two points of one satellite agree when they differ by less than this many sigmas of their difference."""

_MOST_SATELLITES = 200


def cloud_of(epoch: GnssEpoch) -> Any:
    """Build the PointCloud2 message of an epoch."""
    points = np.zeros(len(epoch), POINT)
    for k, name in enumerate("xyz"):
        points[name], points[f"v{name}"] = epoch.sat_pos_e[:, k], epoch.sat_vel_e[:, k]
    columns = (epoch.pseudorange_m, epoch.doppler_mps, epoch.sigma_m, epoch.sigma_mps, epoch.cn0)
    for name, column in zip(_REALS[6:], columns, strict=True):
        points[name] = column
    points["system"] = [ord(letter) for letter in epoch.system]
    points["sat_id"] = epoch.sat_id
    points["flags"] = epoch.range_valid + 2 * epoch.doppler_valid
    return clouds.cloud_of(epoch.stamp_ns, "gps", points)


def _decode(message: Any, received: Received) -> GnssEpoch:
    """Turn a PointCloud2 message object into an epoch.

    An observation that cannot be (not finite, impossible range, no sigma) is kept as not valid, and ``notes`` counts it; so it does the
    points not used of satellites that appear more than once.

    Raises
    ------
    Refusal
        For a wrong frame, missing fields, a length that does not fit, or when satellites that contradict themselves are all there is.
    """
    received.frame(message.header.frame_id)
    points = clouds.points_of(message, POINT, _MOST_SATELLITES, "satellites")
    position, velocity = (np.column_stack([points[f"{v}{name}"] for name in "xyz"]) for v in ("", "v"))
    with np.errstate(invalid="ignore", over="ignore"):
        placed = (np.abs(velocity) < FASTEST_MPS).all(axis=1) & _between(np.linalg.norm(position, axis=1))
        good_range = placed & _between(points["pseudorange"]) & _is_sigma(points["sigma"])
        good_rate = placed & (np.abs(points["doppler"]) < FASTEST_MPS) & _is_sigma(points["sigma_doppler"])
    stated_range, stated_rate = (points["flags"] & 1) != 0, (points["flags"] & 2) != 0
    for what, stated, good in (("pseudorange", stated_range, good_range), ("doppler", stated_rate, good_rate)):
        if np.any(stated & ~good):
            received.notes[f"{received.kind.name}: implausible {what} not used"] += int(np.count_nonzero(stated & ~good))
    pseudorange, doppler = np.where(good_range, points["pseudorange"], 0.0), np.where(good_rate, points["doppler"], 0.0)
    sigma = _raised(points["sigma"], LEAST_SIGMA_M, good_range, received)
    sigma_doppler = _raised(points["sigma_doppler"], LEAST_SIGMA_MPS, good_rate, received)
    columns = pseudorange, doppler, sigma, sigma_doppler, np.where(np.isfinite(points["cn0"]), points["cn0"], 0.0)
    system = np.array([chr(code) for code in points["system"]], dtype="<U1")
    states = np.where(placed[:, None], position, 0.0), np.where(placed[:, None], velocity, 0.0)
    valid = stated_range & good_range, stated_rate & good_rate
    epoch = GnssEpoch(*received.head, system, points["sat_id"].astype(np.int64), *columns, *states, *valid)
    return _once_each(epoch, received.notes)


def _once_each(epoch: GnssEpoch, notes: Counter) -> GnssEpoch:
    """Leave one observation of each satellite, or none where several contradict each other."""
    rows_of: dict[tuple[str, int], list[int]] = {}
    for row, satellite in enumerate(zip(epoch.system.tolist(), epoch.sat_id.tolist(), strict=True)):
        rows_of.setdefault(satellite, []).append(row)
    if len(rows_of) == len(epoch):
        return epoch
    kept: list[int] = []
    for satellite, rows in rows_of.items():
        best = rows if len(rows) == 1 else _best(epoch, rows)
        kept += best
        if len(rows) > 1:
            what = "second signal not used" if best else "contradictory copies excluded"
            notes[f"{epoch.source}: {name_of(*satellite)}: {what}"] += len(rows) - len(best)
    if not kept:
        raise Refusal("every satellite appears twice and contradicts itself")
    return epoch.rows(np.array(kept))


def _best(epoch: GnssEpoch, rows: list[int]) -> list[int]:
    """The row to use of the copies of one satellite: valid, and of the smallest sigma; none where valid ones contradict each other."""
    copies = np.array(rows)
    for valid, value, sigma in (
        (epoch.range_valid, epoch.pseudorange_m, epoch.sigma_m),
        (epoch.doppler_valid, epoch.doppler_mps, epoch.sigma_mps),
    ):
        usable = copies[valid[copies]]
        if usable.size > 1:
            apart = np.abs(value[usable][:, None] - value[usable])
            if np.any(apart > SAME_SIGMAS * np.hypot(sigma[usable][:, None], sigma[usable])):
                return []
    order = np.lexsort((epoch.sigma_m[copies], ~epoch.doppler_valid[copies], ~epoch.range_valid[copies]))
    return [int(copies[order[0]])]


def _between(metres: np.ndarray) -> np.ndarray:
    return (metres >= NEAREST_M) & (metres <= FARTHEST_M)


def _is_sigma(column: np.ndarray) -> np.ndarray:
    return (column > 0.0) & (column <= ABSURD_SIGMA)


def _raised(sigma: np.ndarray, least: float, good: np.ndarray, received: Received) -> np.ndarray:
    """Sigmas of good observations, none smaller than a sensor can have; zero of the others."""
    low = good & (sigma < least)
    if low.any():
        received.notes[f"{received.kind.name}: sigma raised to what a receiver can have"] += int(np.count_nonzero(low))
    return np.where(good, np.maximum(sigma, least), 0.0)


_FAULT_S, _FAULT_M = 5.0, 1000.0


def _sample(at: Instant) -> GnssEpoch:
    """Noise-free observations of the simulated satellites in view; in the last seconds the first has a fault, to be found and excluded."""
    from lowcostnav_ros.gnss.constellation import gps_24  # only a warm-up needs a constellation
    from lowcostnav_ros.gnss.observables import range_and_rate

    place_e, velocity_e = geodetic_to_ecef(*at.place), dcm_ne(*at.place[:2]).T @ VELOCITY
    constellation = gps_24()
    sat_pos, sat_vel = constellation.states(at.since_s)
    ranges, rates, los = range_and_rate(place_e, velocity_e, sat_pos, sat_vel)
    seen = los @ place_e > 0.1 * np.linalg.norm(place_e)
    ranges[np.flatnonzero(seen)[0]] += _FAULT_M if at.since_s > FLIGHT_S - _FAULT_S else 0.0
    n = int(np.count_nonzero(seen))
    columns = ranges[seen], rates[seen], np.full(n, 5.0), np.full(n, 0.2), np.zeros(n), sat_pos[seen], sat_vel[seen]
    names = constellation.system[seen], constellation.sat_id[seen]
    return at.of(GnssEpoch, *names, *columns, np.ones(n, bool), np.ones(n, bool))


_MEANING = (
    "Satellite observations; fields: see messages.kinds.gnss_raw. One point a satellite is used: of two signals that agree the one of "
    "the smaller sigma; copies that contradict each other are all excluded, the other satellites are used."
)
describe(
    __name__,
    TopicSpec("gnss/raw", POINT_CLOUD, _MEANING, "gps", "m, m/s"),
    measurement=GnssEpoch,
    decode=_decode,
    encode=cloud_of,
    frames=ANTENNA_FRAMES,
    sample=_sample,
    sensed=True,
)
