"""Multi-antenna GPS attitude simulator: roll, pitch and heading with white noise, free of drift, with latency, dropouts and outages.

0.25 deg on each angle at 2 Hz, as a triangle of antennas 36, 50 and 50 cm apart gives (Gebre-Egziabher 2004, sections 3.10 and 4.6).  With
``antennas_m`` the receiver itself is simulated: carrier phases of the satellites in view between the antennas, their integers known, are
solved for the attitude, so that the sigmas are those of the triangle and of the sky: unlike on roll, pitch and heading, and correlated.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.gnss.attitude_antennas import attitude_from_phases, isosceles_array, phase_differences
from lowcostnav_ros.gnss.constellation import gps_24
from lowcostnav_ros.gnss.dop import to_ned
from lowcostnav_ros.gnss.observables import line_of_sight, states_at_reception
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import euler_jacobian_n, euler_to_quat, quat_from_rotvec, quat_multiply, quat_to_dcm, quat_to_euler
from lowcostnav_ros.sensors.reception import ReceiverSettings, Reception
from lowcostnav_ros.sensors.registry import simulator
from lowcostnav_ros.sensors.sampling import SampleClock

CHANNEL_M, GYROS_RAD = 0.1, 0.03
"""Delay between two receiver channels, and error of the attitude that the search starts from, 1 sigma."""
STEEPEST = np.radians(85.0)
"""Pitch beyond which the receiver, which reports Euler angles, gives no attitude."""


@dataclass(frozen=True)
class GpsAttitudeSimulatorSettings(ReceiverSettings):
    """Settings of the GPS attitude simulator."""

    receiver = "GPS attitude"
    rate_hz: float = setting(2.0, "Output rate.", unit="Hz", minimum=0.1, maximum=10.0)
    noise_deg: float = setting(0.25, "White error of roll, pitch and heading, 1 sigma.", unit="deg", minimum=0.001, maximum=10.0)
    antennas_m: list = setting(
        [], "Rear and front sides of the triangle; empty: white angles.", unit="m", minimum=0.05, maximum=50.0
    )
    phase_mm: float = setting(2.0, "Noise of a phase difference, with antennas_m.", unit="mm", minimum=0.01, maximum=50.0)
    mask_deg: float = setting(10.0, "Lowest elevation, with antennas_m.", unit="deg", minimum=0.0, maximum=89.0)
    constellation_time_s: float = setting(10800.0, "Age of the constellation at the first truth stamp.", unit="s", minimum=0.0)
    latency_s: float = setting(0.0, "Time from validity to availability.", unit="s", minimum=0.0, maximum=10.0)
    dropout_probability: float = setting(0.0, "Probability that one epoch is missing.", minimum=0.0, maximum=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.antennas_m) not in (0, 2):
            raise SettingsError(f"GPS attitude: 'antennas_m' takes two sides, rear and front, or none, got {self.antennas_m}.")
        if self.antennas_m:
            try:
                isosceles_array(*self.antennas_m)
            except ValueError as error:
                raise SettingsError(f"GPS attitude: {error}") from None


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
        self._start_ns: int | None = None
        if settings.antennas_m:
            self._baselines, self._satellites = isosceles_array(*settings.antennas_m), gps_24()
            self._channel_m = stream(settings.seed, "gps_attitude.channels").normal(0.0, CHANNEL_M, 2)

    def simulate(self, truth: TruthBlock) -> list[Attitude]:
        """Return the attitudes that become available during ``truth``, in stamp order."""
        if len(truth) == 0:
            return []
        self._reception.begin(int(truth.stamps_ns[0]))
        self._start_ns = int(truth.stamps_ns[0]) if self._start_ns is None else self._start_ns
        rows = self._clock.rows(truth.stamps_ns)
        drawn = 2 * len(self._satellites) + 3 if self.settings.antennas_m else 3
        noise = self._noise_rng.standard_normal((len(rows), drawn))
        received = self._dropout_rng.random(len(rows)) >= self.settings.dropout_probability
        for row, error, ok in zip(rows, noise, received, strict=True):
            stamp_ns = int(truth.stamps_ns[row])
            angles = np.array(quat_to_euler(truth.q_nb[row]))
            if ok and abs(angles[1]) < STEEPEST and not self._reception.in_outage(stamp_ns):
                epoch = self._solved(truth, int(row), error) if self.settings.antennas_m else self._epoch(stamp_ns, angles, error)
                if epoch is not None:
                    self._reception.send(epoch)
        return self._reception.arrived(int(truth.stamps_ns[-1]))

    def _epoch(self, stamp_ns: int, angles: np.ndarray, error: np.ndarray) -> Attitude:
        """White angles."""
        sigma = np.radians(self.settings.noise_deg)
        angles = angles + sigma * error
        turned = np.linalg.inv(euler_jacobian_n(*angles))
        return self._attitude(stamp_ns, euler_to_quat(*angles), turned @ turned.T * sigma**2)

    def _solved(self, truth: TruthBlock, row: int, normals: np.ndarray) -> Attitude | None:
        """Attitude from the phases between the antennas; None with fewer than three satellites above the mask."""
        stamp_ns, sigma_m = int(truth.stamps_ns[row]), 1e-3 * self.settings.phase_mm
        lat, lon = float(truth.lat[row]), float(truth.lon[row])
        position_e = geodetic_to_ecef(lat, lon, float(truth.height[row]))
        at_s = self.settings.constellation_time_s + (stamp_ns - (self._start_ns or 0)) * 1e-9
        sat_pos, _ = states_at_reception(self._satellites.states, at_s, position_e)
        sight_n = to_ned(lat, lon, line_of_sight(position_e, sat_pos)[1])
        seen = -sight_n[:, 2] >= math.sin(math.radians(self.settings.mask_deg))
        white = normals[3:].reshape(-1, 2)[seen]
        phases_m = phase_differences(truth.q_nb[row], sight_n[seen], self._baselines, self._channel_m) + sigma_m * white
        carried = quat_multiply(truth.q_nb[row], quat_from_rotvec(GYROS_RAD * normals[:3]))
        try:
            return self._attitude(stamp_ns, *attitude_from_phases(phases_m, sight_n[seen], self._baselines, carried, sigma_m))
        except ValueError:
            return None

    def _attitude(self, stamp_ns: int, q_nb: np.ndarray, cov: np.ndarray) -> Attitude:
        """Rates are zero and specific force that of unaccelerated flight: the receiver measures neither."""
        force = quat_to_dcm(q_nb).T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
        return Attitude(stamp_ns, self.source, q_nb, cov, np.zeros(3), force)
