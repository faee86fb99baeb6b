"""GPS receiver simulator: position and velocity with white and time-correlated error, latency, dropouts and outages.

Position error 2 m horizontal, 5 m vertical (Gebre-Egziabher 2004, section 3.10, GPS with WAAS).  The source gives no velocity
figure; 0.1 m/s is usual for a receiver that uses carrier Doppler.
"""

from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.stochastic import GaussMarkov
from lowcostnav_ros.sensors.drift import DriftBank
from lowcostnav_ros.sensors.reception import ReceiverSettings, Reception
from lowcostnav_ros.sensors.registry import simulator
from lowcostnav_ros.sensors.sampling import SampleClock


@dataclass(frozen=True)
class GpsSimulatorSettings(ReceiverSettings):
    """Settings of the GPS simulator."""

    receiver = "GPS"
    rate_hz: float = setting(5.0, "Output rate.", unit="Hz", minimum=0.1, maximum=50.0)
    horizontal_noise_m: float = setting(2.0, "White position error per horizontal axis, 1 sigma.", unit="m", minimum=0.01)
    vertical_noise_m: float = setting(5.0, "White height error, 1 sigma.", unit="m", minimum=0.01)
    horizontal_drift_m: float = setting(0.0, "Correlated position error per horizontal axis, 1 sigma.", unit="m", minimum=0.0)
    vertical_drift_m: float = setting(0.0, "Correlated height error, 1 sigma.", unit="m", minimum=0.0)
    drift_tau_s: float = setting(300.0, "Correlation time of the correlated error.", unit="s", minimum=0.1)
    velocity_noise_mps: float = setting(0.1, "White velocity error per axis, 1 sigma.", unit="m/s", minimum=0.001)
    repeat_hz: float = setting(0.0, "Puts each fix out again at this rate until the next; 0: once.", unit="Hz", minimum=0.0, maximum=50.0)
    latency_s: float = setting(0.0, "Time from validity to availability.", unit="s", minimum=0.0, maximum=10.0)
    dropout_probability: float = setting(0.0, "Probability that one epoch is missing.", minimum=0.0, maximum=1.0)



@simulator("gps", Settings=GpsSimulatorSettings, truth=("truth/odometry",), topics=("gps/fix", "gps/vel"), usual=4)
class GpsSimulator:
    """Turn truth into fixes; keeps its errors and what is still on its way from call to call.

    An epoch is handed over in the call whose newest truth stamp reaches its time of validity plus the latency; its stamp is
    the time of validity.  No measurement is made during an outage or a dropout.
    """

    def __init__(self, settings: GpsSimulatorSettings, position_source: str = "gps/fix", velocity_source: str = "gps/vel") -> None:
        self.settings = settings
        self.position_source, self.velocity_source = position_source, velocity_source
        self._clock = SampleClock(settings.rate_hz)
        self._repeats = SampleClock(settings.repeat_hz) if settings.repeat_hz > 0.0 else None
        self._epoch_now: list[GpsPosition | GpsVelocity] = []
        self._reception: Reception[GpsPosition | GpsVelocity] = Reception(settings.latency_s, settings.outages_s)
        drift = np.array([settings.horizontal_drift_m, settings.horizontal_drift_m, settings.vertical_drift_m])
        processes = [GaussMarkov(float(sigma), settings.drift_tau_s) for sigma in drift]
        self._drift = DriftBank(processes, 1.0 / settings.rate_hz, stream(settings.seed, "gps.drift"))
        self._noise_rng = stream(settings.seed, "gps.noise")
        self._dropout_rng = stream(settings.seed, "gps.dropout")
        white = np.array([settings.horizontal_noise_m, settings.horizontal_noise_m, settings.vertical_noise_m])
        self._noise_sigma = np.concatenate((white, np.full(3, settings.velocity_noise_mps)))
        self._cov_position = np.diag(white**2 + drift**2)
        self._cov_velocity = np.eye(3) * settings.velocity_noise_mps**2

    def simulate(self, truth: TruthBlock) -> list[GpsPosition | GpsVelocity]:
        """Return the fixes and velocities that become available during ``truth``, in stamp order."""
        if len(truth) == 0:
            return []
        self._reception.begin(int(truth.stamps_ns[0]))
        rows = self._clock.rows(truth.stamps_ns)
        noise = self._noise_rng.standard_normal((len(rows), 6)) * self._noise_sigma
        noise[:, 0:3] += self._drift.draw(len(rows))
        received = self._dropout_rng.random(len(rows)) >= self.settings.dropout_probability
        fixes = {int(row): error if ok else None for row, error, ok in zip(rows, noise, received, strict=True)}
        again = () if self._repeats is None else self._repeats.rows(truth.stamps_ns).tolist()
        for row in sorted({*fixes, *again}):
            stamp_ns, is_lost = int(truth.stamps_ns[row]), self._reception.in_outage(int(truth.stamps_ns[row]))
            error = fixes.get(row)
            if is_lost or (row in fixes and error is None):
                self._epoch_now = []
            elif error is not None:
                self._epoch_now = self._epoch(truth, row, error)
                self._reception.send(*self._epoch_now)
            else:
                self._reception.send(*(replace(m, stamp_ns=stamp_ns) for m in self._epoch_now))
        return self._reception.arrived(int(truth.stamps_ns[-1]))

    def _epoch(self, truth: TruthBlock, row: int, error: np.ndarray) -> list[GpsPosition | GpsVelocity]:
        stamp_ns = int(truth.stamps_ns[row])
        lat, lon, height = displace(truth.lat[row], truth.lon[row], truth.height[row], error[0:3])
        velocity = truth.vel_n[row] + error[3:6]
        return [
            GpsPosition(stamp_ns, self.position_source, float(lat), float(lon), float(height), self._cov_position),
            GpsVelocity(stamp_ns, self.velocity_source, velocity, self._cov_velocity),
        ]
