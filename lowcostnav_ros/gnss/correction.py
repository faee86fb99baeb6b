"""From raw observations and ephemerides to a :class:`GnssEpoch`: satellite states at transmission, clocks, atmosphere, expected errors.

The time of transmission is the receiver's time of reception minus pseudorange over c, whatever the receiver's clock error, since that
error is in both; minus the satellite's own clock error it is system time (IS-GPS-200, 20.3.3.3.3).
"""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.gnss import ionosphere, troposphere
from lowcostnav_ros.gnss.ephemeris import Ephemeris, SatelliteState, satellite_state
from lowcostnav_ros.gnss.gps_time import SECOND, unix_ns
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight, turned
from lowcostnav_ros.gnss.raw_epoch import RawEpoch, screened
from lowcostnav_ros.gnss.rinex_nav import Navigation
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT
from lowcostnav_ros.physics.earth import EARTH_RATE, ecef_to_geodetic

UNCORRECTED_SIGMA_M = 30.0
"""Stated where the atmosphere is not corrected because the position is not yet known, m."""


@dataclass(frozen=True)
class CorrectionSettings:
    """How raw observations are corrected."""

    mask_deg: float = setting(10.0, "Lowest elevation used.", unit="deg", minimum=2.0, maximum=60.0)
    ionosphere: bool = setting(True, "Take off the broadcast ionosphere model where the ephemerides come with one.")
    integrity_sigmas: bool = setting(False, "State the ionosphere's error with the bounds of integrity, some times the usual error.")
    troposphere: bool = setting(True, "Take off the standard troposphere.")
    doppler_sigma_mps: float = setting(0.2, "1-sigma of a Doppler.", unit="m/s", minimum=0.001)


def code_sigma_m(elevation: np.ndarray) -> np.ndarray:
    """1-sigma of receiver noise and airframe multipath, m: 0.36 m and 0.13 + 0.53 exp(-El/10 deg) (RTCA DO-229, appendix J.2.4)."""
    return np.hypot(0.36, 0.13 + 0.53 * np.exp(-np.degrees(elevation) / 10.0))


def corrected(
    raw: RawEpoch,
    navigation: Navigation,
    position_e: np.ndarray | None,
    settings: CorrectionSettings,
    rejected: Counter,
    clock_m: float = 0.0,
    source: str = "gnss/raw",
) -> GnssEpoch:
    """Correct an epoch.

    Parameters
    ----------
    raw : RawEpoch
    navigation : Navigation
        Ephemerides, and the ionosphere model if there is one.
    position_e : ndarray, shape (3,), or None
        Receiver to a few kilometres, ECEF, m; None where nothing is known: then neither atmosphere nor mask is applied.
    settings : CorrectionSettings
    rejected : Counter
        Gets a count for every excluded satellite, by reason.
    clock_m : float
        Receiver clock of the last fix, m: the receiver's time of reception is late by so much, which goes off the stamp.

    Returns
    -------
    GnssEpoch
        May be empty.
    """
    raw = screened(raw, rejected)
    kept, used, states = _with_states(raw, navigation, rejected)
    raw = raw.rows(np.array(kept, dtype=int))
    position = np.array([s.position_e for s in states]).reshape(-1, 3)
    velocity = np.array([s.velocity_e for s in states]).reshape(-1, 3)
    flight_s = raw.pseudorange_m / SPEED_OF_LIGHT if position_e is None else line_of_sight(position_e, position)[0] / SPEED_OF_LIGHT
    position, velocity = turned(position, EARTH_RATE * flight_s), turned(velocity, EARTH_RATE * flight_s)
    pseudorange = raw.pseudorange_m + SPEED_OF_LIGHT * np.array([s.clock_s for s in states])
    doppler = raw.doppler_mps + SPEED_OF_LIGHT * np.array([s.clock_rate for s in states])
    sigma = np.full(len(raw), UNCORRECTED_SIGMA_M)
    rows = np.arange(len(raw))
    if position_e is not None and len(raw):
        delay, sigma, elevation = _atmosphere(raw.gps_ns, position_e, position, navigation, settings)
        pseudorange = pseudorange - delay
        sigma = np.hypot(sigma, [ephemeris.ura_m for ephemeris in used])
        rows = _above_mask(elevation, math.radians(settings.mask_deg), rejected)
    measured = np.isfinite(doppler)
    observed = (pseudorange, np.where(measured, doppler, 0.0), sigma, np.full(len(raw), settings.doppler_sigma_mps), raw.cn0)
    columns = (raw.system, raw.sat_id, *observed, position, velocity, np.ones(len(raw), dtype=bool), measured)
    valid_ns = raw.gps_ns - round(clock_m / SPEED_OF_LIGHT * SECOND)
    return GnssEpoch(unix_ns(valid_ns), source, *(column[rows] for column in columns))


def _with_states(raw: RawEpoch, navigation: Navigation, rejected: Counter) -> tuple[list[int], list[Ephemeris], list[SatelliteState]]:
    """Rows that have an ephemeris, those ephemerides, and the satellites' states at transmission in the frame of that time."""
    kept, used, states = [], [], []
    for row, (system, sat_id) in enumerate(raw.satellites()):
        sent_ns = raw.gps_ns - round(float(raw.pseudorange_m[row]) / SPEED_OF_LIGHT * SECOND)
        ephemeris, reason = navigation.store.find(system, sat_id, sent_ns)
        if ephemeris is None:
            rejected[reason] += 1
            continue
        clock_s = satellite_state(ephemeris, sent_ns).clock_s
        kept.append(row)
        used.append(ephemeris)
        states.append(satellite_state(ephemeris, sent_ns - round(clock_s * SECOND)))
    return kept, used, states


def _atmosphere(
    gps: int, position_e: np.ndarray, sat_position_e: np.ndarray, navigation: Navigation, settings: CorrectionSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Delays (n,) m to take off, 1-sigma (n,) of what remains and of the code noise, and elevations (n,) rad."""
    lat, lon, height = ecef_to_geodetic(position_e)
    azimuth, elevation = azimuth_elevation(lat, lon, line_of_sight(position_e, sat_position_e)[1])
    usable = np.maximum(elevation, troposphere.LOWEST_ELEVATION)  # lower ones go at the mask
    delay, variance = np.zeros(elevation.size), code_sigma_m(usable) ** 2
    if settings.ionosphere and navigation.klobuchar is not None:
        delay += navigation.klobuchar.delay_m(lat, lon, azimuth, usable, gps)
        variance += ionosphere.residual_sigma_m(delay, lat, usable, settings.integrity_sigmas) ** 2
    else:
        variance += (2.0 * ionosphere.residual_sigma_m(delay, lat, usable, bound=True)) ** 2  # nothing taken off
    if settings.troposphere:
        delay += troposphere.delay_m(lat, height, usable, troposphere.day_of_year(gps))
        variance += troposphere.residual_sigma_m(usable) ** 2
    else:
        variance += (2.5 * troposphere.mapping(usable)) ** 2
    return delay, np.sqrt(variance), elevation


def _above_mask(elevation: np.ndarray, mask: float, rejected: Counter) -> np.ndarray:
    below, low = elevation < 0.0, (elevation >= 0.0) & (elevation < mask)
    for reason, bad in (("below the horizon", below), ("below the elevation mask", low)):
        if np.any(bad):
            rejected[reason] += int(np.count_nonzero(bad))
    return np.flatnonzero(elevation >= mask)
