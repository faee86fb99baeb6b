"""Simulator of satellite observations: pseudoranges and Dopplers of simulated constellations, receiver clock and range errors included.

    pseudorange = |r_sat - r| + clock + noise + slow error + fault,     doppler = e . (v_sat - v) + clock drift + noise

What it hands over is a corrected epoch, as a receiver with ephemerides would: satellite states are those the observations were made
with, and the range noise is the budget of what corrections leave (Solimeno 2007, sections 2.3, 5.2.1 and 6.3).
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.almanac_constellation import Almanac
from lowcostnav_ros.gnss.canyon import CanyonSettings
from lowcostnav_ros.gnss.constellation import Satellites, constellation_named, together
from lowcostnav_ros.gnss.error_budget import COMMON_SHARE, obliquity, range_noise
from lowcostnav_ros.gnss.gps_time import gps_ns
from lowcostnav_ros.gnss.observables import azimuth_elevation, range_and_rate, states_at_reception
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.receiver_clock import simulate as simulate_clock
from lowcostnav_ros.gnss.signals import GALILEO, SPEED_OF_LIGHT
from lowcostnav_ros.gnss.visibility import Schedule, choose
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef
from lowcostnav_ros.physics.stochastic import GaussMarkov
from lowcostnav_ros.sensors.drift import DriftBank
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.sampling import SampleClock

MILLISECOND_M = SPEED_OF_LIGHT * 1e-3


@dataclass(frozen=True)
class GnssRawSimulatorSettings(SimulatorSettings):
    """Settings of the simulator of satellite observations."""

    rate_hz: float = setting(10.0, "Output rate.", unit="Hz", minimum=0.1, maximum=50.0)
    constellation: str = setting("gps", "Satellites to simulate.", choices=("gps", "galileo", "gps_galileo"))
    constellation_time_s: float = setting(10800.0, "Age of the constellation at the first truth stamp.", unit="s", minimum=0.0)
    almanac_file: str = setting("", "YUMA almanac to take the GPS satellites from; stamps then count as dates. Empty: Table 6.1.")
    light_time: bool = setting(False, "Take satellites where they were at transmission and turn with the earth.")
    mask_deg: float = setting(5.0, "Lowest elevation.", unit="deg", minimum=0.0, maximum=90.0)
    canyon: CanyonSettings = group(CanyonSettings)
    max_satellites: int = setting(0, "Channels; satellites of smallest GDOP are used.  0 uses all in view.", minimum=0)
    schedule: list = setting([], "Number of satellites as start (s), number, start, number, ... from the first stamp.", minimum=0.0)
    select_every_s: float = setting(30.0, "Time between selections.", unit="s", minimum=0.1)
    noise: str = setting("white", "White range noise, or one that grows to the horizon, partly common.", choices=("white", "elevation"))
    gps_sigma_m: float = setting(5.5, "Range noise of GPS, 1 sigma.", unit="m", minimum=0.001)
    galileo_sigma_m: float = setting(4.18, "Range noise of Galileo, 1 sigma.", unit="m", minimum=0.001)
    slow_sigma_m: float = setting(0.0, "Slow range error of each satellite, 1 sigma.", unit="m", minimum=0.0)
    slow_tau_s: float = setting(600.0, "Correlation time of the slow range error.", unit="s", minimum=0.1)
    doppler_sigma_mps: float = setting(0.2, "Noise of a Doppler, 1 sigma.", unit="m/s", minimum=0.001)
    clock: str = setting("compensated_crystal", "Receiver oscillator.", choices=tuple(CLOCKS))
    clock_bias_m: float = setting(3000.0, "Receiver clock at switch-on, 1 sigma.", unit="m", minimum=0.0)
    clock_drift_mps: float = setting(30.0, "Receiver clock drift at switch-on, 1 sigma.", unit="m/s", minimum=0.0)
    clock_reset_ms: float = setting(0.0, "The receiver sets its clock back by a millisecond beyond this; 0 never.", unit="ms", minimum=0.0)
    range_faults: list = setting([], "Range faults as start (s), satellite number (of either system), step (m), start, ...")
    range_ramps: list = setting([], "Range faults that grow, as start (s), satellite number, rate (m/s), start, ...")
    spoofing: list = setting([], "A false place for all satellites: start (s), north, east, down, clock (m/s), time to get so fast (s).")
    faults_in_doppler: bool = setting(True, "Ramps and false places show in the Dopplers, too; off: in the code alone.")

    def __post_init__(self) -> None:
        for key, what in (("range_faults", "step"), ("range_ramps", "rate")):
            if len(getattr(self, key)) % 3:
                raise SettingsError(f"GNSS: '{key}' needs start, satellite number and {what} of each fault; add what is missing.")
        if len(self.spoofing) not in (0, 6):
            raise SettingsError("GNSS: 'spoofing' needs start, north, east, down and clock rate, and the time to reach them; give all six.")
        if 0 < self.max_satellites < 4:
            raise SettingsError("GNSS: 'max_satellites' must be 0 or at least 4; use 'schedule' for fewer.")
        if 0.0 < self.clock_reset_ms < 0.5:
            raise SettingsError("GNSS: 'clock_reset_ms' must be 0 or at least 0.5, or every reset causes the next.")
        if self.almanac_file and "gps" not in self.constellation:
            raise SettingsError("GNSS: 'almanac_file' gives GPS satellites; set 'constellation' to gps or gps_galileo.")
        try:
            Schedule.of(self.schedule)
        except GnssError as error:
            raise SettingsError(f"GNSS: 'schedule': {error}") from error


def constellation_of(settings: GnssRawSimulatorSettings, almanac: Almanac | None = None, start_gps: int | None = None) -> Satellites:
    """The satellites that exist in a simulation.

    Parameters
    ----------
    settings : GnssRawSimulatorSettings
    almanac : Almanac, optional
        Of the GPS satellites.
    start_gps : int, optional
        GPS time, ns, of the first stamp; that of the almanac where None.

    Raises
    ------
    GnssError
        For an almanac too far from the start.
    """
    if almanac is None:
        return constellation_named(settings.constellation)
    gps = almanac.constellation(almanac.reference_gps if start_gps is None else start_gps, settings.constellation_time_s)
    return gps if settings.constellation == "gps" else together(gps, constellation_named("galileo"))


@simulator("gnss", Settings=GnssRawSimulatorSettings, truth=("truth/odometry",), topics=("gnss/raw",), needs="almanac_file")
class GnssRawSimulator:
    """Turn truth into epochs of observations; keeps clock, slow errors and selection from call to call.

    No epoch is handed over while no satellite is in use.  Every satellite has its own column of random numbers whether in view or not,
    so neither the schedule nor the mask changes the errors of the others.

    Parameters
    ----------
    settings : GnssRawSimulatorSettings
    almanac : Almanac, optional
        What ``settings.almanac_file`` names, read.
    source : str
        Source name of the epochs.

    Attributes
    ----------
    notes : list of str
        Notes on the satellites, one sentence each.
    """

    def __init__(self, settings: GnssRawSimulatorSettings, almanac: Almanac | None = None, source: str = "gnss/raw") -> None:
        self.settings, self.source = settings, source
        self.constellation, self._almanac = constellation_of(settings, almanac), almanac
        self.notes = [] if almanac is None else almanac.notes()
        self._canyon = settings.canyon.canyon()
        self._clock = SampleClock(settings.rate_hz)
        self._schedule = Schedule.of(settings.schedule)
        self._sigma_m = np.where(self.constellation.system == GALILEO, settings.galileo_sigma_m, settings.gps_sigma_m)
        self._noise_rng = stream(settings.seed, "gnss.noise")
        slow = [GaussMarkov(settings.slow_sigma_m, settings.slow_tau_s)] * len(self.constellation)
        self._slow = DriftBank(slow, 1.0 / settings.rate_hz, stream(settings.seed, "gnss.slow"))
        self._clock_rng = stream(settings.seed, "gnss.clock")
        switch_on = np.array([settings.clock_bias_m, settings.clock_drift_mps])
        self.clock_state = switch_on * self._clock_rng.standard_normal(2)
        self._reset_m = 0.0
        self._start_ns = 0
        self._begun = False
        self._selection: np.ndarray | None = None
        self._selected_for: tuple = ()

    def simulate(self, truth: TruthBlock) -> list[GnssEpoch]:
        """Return the epochs whose time falls in ``truth``."""
        if len(truth) == 0:
            return []
        if not self._begun:
            self._date(int(truth.stamps_ns[0]))
            self._start_ns, self._begun = int(truth.stamps_ns[0]), True  # after it: what is refused once is refused again
        rows, n = self._clock.rows(truth.stamps_ns), len(self.constellation)
        normals = self._noise_rng.standard_normal((len(rows), 2 * n + 1))
        slow = self._slow.draw(len(rows))
        clock = simulate_clock(CLOCKS[self.settings.clock], 1.0 / self.settings.rate_hz, len(rows), self._clock_rng, self.clock_state)
        epochs = [self._epoch(truth, int(row), z, s, c) for row, z, s, c in zip(rows, normals, slow, clock, strict=True)]
        return [epoch for epoch in epochs if epoch is not None]

    def _date(self, start_ns: int) -> None:
        """Put the satellites of an almanac where they are at the first stamp."""
        if self._almanac is None:
            return
        try:
            start_gps = gps_ns(start_ns)
            self.constellation = constellation_of(self.settings, self._almanac, start_gps)
        except GnssError as error:
            raise SettingsError(f"GNSS: {error}") from error
        self.notes.append(self._almanac.dated(start_gps))

    def _epoch(self, truth: TruthBlock, row: int, normals: np.ndarray, slow: np.ndarray, clock: np.ndarray) -> GnssEpoch | None:
        settings, n = self.settings, len(self.constellation)
        stamp_ns = int(truth.stamps_ns[row])
        elapsed_s = (stamp_ns - self._start_ns) * 1e-9
        lat, lon = float(truth.lat[row]), float(truth.lon[row])
        position_e = geodetic_to_ecef(lat, lon, float(truth.height[row]))
        velocity_e = dcm_ne(lat, lon).T @ truth.vel_n[row]
        at_s = settings.constellation_time_s + elapsed_s
        sat_pos, sat_vel = states_at_reception(self.constellation.states, at_s, position_e, light_time=settings.light_time)
        ranges, rates, los = range_and_rate(position_e, velocity_e, sat_pos, sat_vel)
        azimuth, elevation = azimuth_elevation(lat, lon, los)
        used = self._used(los, elevation, self._lowest(azimuth, float(truth.height[row])), elapsed_s)
        clock_m = clock[0] + self._set_clock(float(clock[0]))
        if not used.size:
            return None
        if settings.spoofing:
            offset, rate = false_place(settings.spoofing, elapsed_s)
            C_en = dcm_ne(lat, lon).T
            ranges, spoofed, _ = range_and_rate(position_e + C_en @ offset[:3], velocity_e + C_en @ rate[:3], sat_pos, sat_vel)
            ranges, rates = ranges + offset[3], spoofed + rate[3] if settings.faults_in_doppler else rates
        error, sigma = self._range_errors(elevation, normals, used)
        fault, growth = self._faults(elapsed_s)
        pseudorange = ranges[used] + clock_m + error + slow[used] + fault[used]
        doppler = rates[used] + growth[used] + clock[1] + settings.doppler_sigma_mps * normals[n + 1 + used]
        sigmas = np.hypot(sigma, settings.slow_sigma_m), np.full(used.size, settings.doppler_sigma_mps)
        names, states = (self.constellation.system[used], self.constellation.sat_id[used]), (sat_pos[used], sat_vel[used])
        valid = np.ones(used.size, dtype=bool)
        return GnssEpoch(stamp_ns, self.source, *names, pseudorange, doppler, *sigmas, np.zeros(used.size), *states, valid, valid)

    def _lowest(self, azimuth: np.ndarray, height: float) -> np.ndarray:
        """Lowest visible elevation (n,), rad: the mask, or the cliffs where they are higher."""
        mask = np.full(azimuth.size, math.radians(self.settings.mask_deg))
        return mask if self._canyon is None else np.maximum(mask, self._canyon.lowest(height - self.settings.canyon.floor_m, azimuth))

    def _used(self, los: np.ndarray, elevation: np.ndarray, lowest: np.ndarray, elapsed_s: float) -> np.ndarray:
        """Satellites in use: chosen anew at times, and whenever those in view or the wanted number change."""
        visible = np.flatnonzero(elevation >= lowest)
        limits = [c for c in (self.settings.max_satellites or None, self._schedule.at(elapsed_s)) if c is not None]
        count = min(limits) if limits else None
        due = math.floor(elapsed_s / self.settings.select_every_s + 1e-6)
        wanted = (visible.tobytes(), count, due)
        if self._selection is None or wanted != self._selected_for:
            self._selection = visible[choose(los[visible], elevation[visible], count)]
            self._selected_for = wanted
        return self._selection

    def _range_errors(self, elevation: np.ndarray, normals: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """White range errors and their sigmas, m, of the satellites in use; columns of ``normals``: own noise, common noise, Doppler."""
        own, common, sigma = normals[used], float(normals[len(self.constellation)]), self._sigma_m[used]
        if self.settings.noise == "white":
            return sigma * own, sigma
        f = obliquity(elevation[used])
        return sigma * range_noise(elevation[used], 1.0, own, common), sigma * np.sqrt(1.0 - COMMON_SHARE + COMMON_SHARE * f * f)

    def _set_clock(self, bias_m: float) -> float:
        """Sum of the resets up to now, m: a millisecond back each time the clock as shown passes the limit."""
        limit_m = self.settings.clock_reset_ms * MILLISECOND_M
        if limit_m > 0.0 and abs(bias_m + self._reset_m) > limit_m:
            self._reset_m -= math.copysign(MILLISECOND_M, bias_m + self._reset_m)
        return self._reset_m

    def _faults(self, elapsed_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Range faults, m, of all satellites at a time, and what of their growth the Dopplers show, m/s."""
        fault, growth = np.zeros(len(self.constellation)), np.zeros(len(self.constellation))
        for listed, is_ramp in ((self.settings.range_faults, False), (self.settings.range_ramps, True)):
            for start_s, sat_id, size in zip(listed[0::3], listed[1::3], listed[2::3], strict=True):
                if elapsed_s >= start_s:
                    these = self.constellation.sat_id == int(sat_id)
                    fault[these] += size * (elapsed_s - start_s) if is_ramp else size
                    growth[these] += size if is_ramp and self.settings.faults_in_doppler else 0.0
        return fault, growth


def false_place(spoofing: list[float], elapsed_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a spoofer has dragged the receiver: north, east, down and clock (4,) m, and their rates (4,) m/s; from rest, evenly faster."""
    start_s, *rates, rise_s = spoofing
    since, final = max(elapsed_s - start_s, 0.0), np.array(rates)
    if since < rise_s:
        return final * 0.5 * since * since / rise_s, final * since / rise_s
    return final * (since - 0.5 * rise_s), final if since > 0.0 else np.zeros(4)
