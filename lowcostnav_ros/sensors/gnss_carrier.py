"""Simulator of GPS code and carrier of a rover against a base: differences of both receivers, the base's distance to the satellite added.

Satellite clock and atmosphere cancel but for what the troposphere does over the difference in height, which is left out here; noise and
multipath are those of both receivers together.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.gnss.constellation import constellation_named
from lowcostnav_ros.gnss.observables import azimuth_elevation, range_and_rate
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.receiver_clock import simulate as simulate_clock
from lowcostnav_ros.gnss.signals import L1_WAVELENGTH_M, name
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import quat_to_dcm
from lowcostnav_ros.sensors.carrier_errors import CarrierErrors, CarrierErrorSettings
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.sampling import SampleClock


@dataclass(frozen=True)
class GnssCarrierSimulatorSettings(SimulatorSettings):
    """Settings of the simulator of GPS carrier against a base."""

    rate_hz: float = setting(5.0, "Output rate.", unit="Hz", minimum=0.1, maximum=50.0)
    mask_deg: float = setting(10.0, "Lowest elevation, at the rover.", unit="deg", minimum=0.0, maximum=90.0)
    constellation_time_s: float = setting(10800.0, "Age of the constellation at the first truth stamp.", unit="s", minimum=0.0)
    clock: str = setting("compensated_crystal", "Oscillator of the rover, the base's being steered.", choices=tuple(CLOCKS))
    clock_bias_m: float = setting(3000.0, "Clock at switch-on, 1 sigma.", unit="m", minimum=0.0)
    clock_drift_mps: float = setting(30.0, "Clock drift at switch-on, 1 sigma.", unit="m/s", minimum=0.0)
    errors: CarrierErrorSettings = group(CarrierErrorSettings, code_noise_m=0.8, code_multipath_m=0.6, carrier_multipath_m=0.01)


@simulator("gnss_carrier", Settings=GnssCarrierSimulatorSettings, truth=("truth/odometry",), topics=("gnss/carrier",))
class GnssCarrierSimulator:
    """Turn truth into differenced epochs.

    Parameters
    ----------
    settings : GnssCarrierSimulatorSettings
    source : str
        Source name of the epochs.
    """

    def __init__(self, settings: GnssCarrierSimulatorSettings, source: str = "gnss/carrier") -> None:
        self.settings, self.source = settings, source
        self.constellation = constellation_named("gps")
        n = len(self.constellation)
        self._ident = np.array([name(s, k) for s, k in zip(self.constellation.system, self.constellation.sat_id, strict=True)])
        self.errors = CarrierErrors(settings.errors, n, settings.rate_hz, settings.seed, "gnss_carrier")
        self._clock, self._rng = SampleClock(settings.rate_hz), stream(settings.seed, "gnss_carrier.clock")
        self.clock_state = np.array([settings.clock_bias_m, settings.clock_drift_mps]) * self._rng.standard_normal(2)
        self._start_ns: int | None = None

    def simulate(self, truth: TruthBlock) -> list[CarrierEpoch]:
        """Return the epochs whose time falls in ``truth``."""
        if len(truth) == 0:
            return []
        self._start_ns = int(truth.stamps_ns[0]) if self._start_ns is None else self._start_ns
        rows = self._clock.rows(truth.stamps_ns)
        clocks = simulate_clock(CLOCKS[self.settings.clock], 1.0 / self.settings.rate_hz, len(rows), self._rng, self.clock_state)
        found = [self._epoch(truth, int(row), clock) for row, clock in zip(rows, clocks, strict=True)]
        return [epoch for epoch in found if epoch is not None]

    def _epoch(self, truth: TruthBlock, row: int, clock: np.ndarray) -> CarrierEpoch | None:
        stamp_ns, lat, lon = int(truth.stamps_ns[row]), float(truth.lat[row]), float(truth.lon[row])
        at_s = self.settings.constellation_time_s + 1e-9 * (stamp_ns - (self._start_ns or 0))
        pos, vel = self.constellation.states(at_s)
        place, velocity = geodetic_to_ecef(lat, lon, float(truth.height[row])), dcm_ne(lat, lon).T @ truth.vel_n[row]
        ranges, rates, los = range_and_rate(place, velocity, pos, vel)
        C = quat_to_dcm(truth.q_nb[row])
        errors = self.errors.draw(azimuth_elevation(lat, lon, los)[1] > np.radians(self.settings.mask_deg), bool(C[2, 2] < 0.95))
        used = errors.locked
        if not used.any():
            return None
        wave = np.full(int(np.count_nonzero(used)), L1_WAVELENGTH_M)
        whole, valid = ranges[used] + clock[0], np.ones(len(wave), dtype=bool)
        carrier = (whole + errors.carrier_m[used]) / wave + errors.cycles[used]
        doppler = -(rates[used] + clock[1]) / wave + errors.doppler_hz[used]
        observed = whole + errors.code_m[used], carrier, doppler, wave, 0.0 * wave
        return CarrierEpoch(stamp_ns, self.source, self._ident[used], *observed, valid, valid, pos[used], vel[used])
