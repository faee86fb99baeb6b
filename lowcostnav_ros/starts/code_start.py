"""First position and velocity from the code and the Dopplers of transmitters."""

import numpy as np

from lowcostnav_ros.aids._carrier import CarrierAid
from lowcostnav_ros.base.measurements import CarrierEpoch, GpsPosition, GpsVelocity
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic
from lowcostnav_ros.radionav.network import NoFix, fix_from_code

ABOVE_M = 3000.0
"""Where the search begins over a network on the ground, which has a mirror image of every place below it."""
BELOW_M = 300.0
FAR_M = 1e7
RATE_SIGMA = 0.1
"""Of a range rate, m/s."""


def code_solution(receiver: CarrierAid, epoch: CarrierEpoch) -> tuple[GpsPosition, GpsVelocity] | str:
    """Position and velocity of one epoch, or the reason why there are none."""
    rows, pos_e, _ = receiver.located(epoch)
    good = epoch.code_valid[rows] & epoch.carrier_valid[rows]
    rows, pos_e = rows[good], pos_e[good]
    if not len(rows):
        return "no usable transmitter"
    centre, is_sky = pos_e.mean(axis=0), bool(np.linalg.norm(pos_e, axis=1).min() > FAR_M)
    first = np.zeros(3) if is_sky else centre + ABOVE_M * centre / np.linalg.norm(centre)
    code = epoch.code_m[rows]
    try:
        fix = fix_from_code(pos_e, code, first)
        for _ in range(2):  # the delays hang on the place, hardly
            height, ranges = float(ecef_to_geodetic(fix.place)[2]), np.linalg.norm(pos_e - fix.place, axis=1)
            fix = fix_from_code(pos_e, code - receiver.delays(epoch, rows, height, ranges), fix.place)
    except NoFix as error:
        return str(error)
    lat, lon, height = (float(x) for x in ecef_to_geodetic(fix.place))
    lowest = min(float(ecef_to_geodetic(place)[2]) for place in pos_e)
    if height < lowest - BELOW_M:
        return "the code gives a place below the transmitters"
    C, away = dcm_ne(lat, lon), pos_e - fix.place
    e = away / np.linalg.norm(away, axis=1)[:, None]
    H = np.column_stack([-e @ C.T, np.ones(len(e))])
    rates = -epoch.doppler_hz[rows] * epoch.wavelength_m[rows] + np.einsum("ij,ij->i", e, _speed(epoch, rows))
    spread = np.linalg.inv(H.T @ H)
    velocity = spread @ (H.T @ rates)
    cov = C @ fix.covariance[:3, :3] @ C.T * receiver.settings.code_sigma_m**2
    head = epoch.stamp_ns, epoch.source
    return GpsPosition(*head, lat, lon, height, cov), GpsVelocity(*head, velocity[:3], spread[:3, :3] * RATE_SIGMA**2)


def _speed(epoch: CarrierEpoch, rows: np.ndarray) -> np.ndarray:
    """Minus what the transmitters' own motion adds to the range rates, as velocities (m, 3)."""
    return np.zeros((len(rows), 3)) if epoch.vel_e is None else -epoch.vel_e[rows]
