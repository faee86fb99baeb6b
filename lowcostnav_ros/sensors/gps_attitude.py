"""Multi-antenna GPS attitude simulator: roll, pitch and heading with white noise, free of drift, with latency, dropouts and outages.

0.25 deg on each angle at 2 Hz, as a triangle of antennas 36, 50 and 50 cm apart gives (Gebre-Egziabher 2004, sections 3.10 and 4.6).
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import euler_jacobian_n, euler_to_quat, quat_to_dcm, quat_to_euler
from lowcostnav_ros.sensors.reception import Reception, check_outages
from lowcostnav_ros.sensors.registry import simulator
from lowcostnav_ros.sensors.sampling import SampleClock

STEEPEST = np.radians(85.0)
"""Pitch beyond which the receiver, which reports Euler angles, gives no attitude."""


@dataclass(frozen=True)
class GpsAttitudeSimulatorSettings:
    """Settings of the GPS attitude simulator."""

    seed: int = setting(1, "Seed of all random numbers of this sensor.", minimum=0)
    rate_hz: float = setting(2.0, "Output rate.", unit="Hz", minimum=0.1, maximum=10.0)
    noise_deg: float = setting(0.25, "White error of roll, pitch and heading, 1 sigma.", unit="deg", minimum=0.001, maximum=10.0)
    latency_s: float = setting(0.0, "Time from validity to availability.", unit="s", minimum=0.0, maximum=10.0)
    dropout_probability: float = setting(0.0, "Probability that one epoch is missing.", minimum=0.0, maximum=1.0)
    outages_s: list = setting([], "Outages as start, end, start, end, ... from the first truth stamp.", unit="s", minimum=0.0)

    def __post_init__(self) -> None:
        check_outages(self.outages_s, "GPS attitude")


@simulator("gps_attitude", Settings=GpsAttitudeSimulatorSettings, truth=("truth/odometry",), topics=("gps/attitude",))
class GpsAttitudeSimulator:
    """Turn truth into attitudes; keeps what is still on its way from call to call.

    An epoch is handed over in the call whose newest truth stamp reaches its time of validity plus the latency.
    """

    def __init__(self, settings: GpsAttitudeSimulatorSettings, source: str = "gps/attitude") -> None:
        self.settings, self.source = settings, source
        self._clock = SampleClock(settings.rate_hz)
        self._reception: Reception[Attitude] = Reception(settings.latency_s, settings.outages_s)
        self._noise_rng = stream(settings.seed, "gps_attitude.noise")
        self._dropout_rng = stream(settings.seed, "gps_attitude.dropout")

    def simulate(self, truth: TruthBlock) -> list[Attitude]:
        """Return the attitudes that become available during ``truth``, in stamp order."""
        if len(truth) == 0:
            return []
        self._reception.begin(int(truth.stamps_ns[0]))
        rows = self._clock.rows(truth.stamps_ns)
        noise = np.radians(self.settings.noise_deg) * self._noise_rng.standard_normal((len(rows), 3))
        received = self._dropout_rng.random(len(rows)) >= self.settings.dropout_probability
        for row, error, ok in zip(rows, noise, received, strict=True):
            stamp_ns = int(truth.stamps_ns[row])
            angles = np.array(quat_to_euler(truth.q_nb[row]))
            if ok and abs(angles[1]) < STEEPEST and not self._reception.in_outage(stamp_ns):
                self._reception.send(self._epoch(stamp_ns, angles + error))
        return self._reception.arrived(int(truth.stamps_ns[-1]))

    def _epoch(self, stamp_ns: int, angles: np.ndarray) -> Attitude:
        """Rates are zero and specific force that of unaccelerated flight: the receiver measures neither."""
        q_nb = euler_to_quat(*angles)
        turned = np.linalg.inv(euler_jacobian_n(*angles))
        cov = turned @ turned.T * np.radians(self.settings.noise_deg) ** 2
        force = quat_to_dcm(q_nb).T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
        return Attitude(stamp_ns, self.source, q_nb, cov, np.zeros(3), force)
