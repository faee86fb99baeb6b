"""Heading and attitude reference simulator: a gyro platform that is erected to the vertical and slaved to a magnetic compass.

Misalignment per axis, north, east and down, a rotation that corrects (Eggers 1995, sections 2.2 and 7.2.1):

    d(zeta)/dt = -s zeta / tau + d + w,      s = 1 while erecting, 0 while cut out

with the drift d constant for a flight (3 deg/h, so that d tau = 0.1 deg), and w white.  The erection is cut out while the specific force
differs from gravity by more than a threshold: a pendulum in a turn does not show the vertical.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import eulers_to_quat, quat_apply_phi_n, quats_to_euler
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.sampling import SampleClock

DEGREE_PER_HOUR = math.radians(1.0) / 3600.0


@dataclass(frozen=True)
class HarsSimulatorSettings(SimulatorSettings):
    """Settings of the heading and attitude reference simulator."""

    rate_hz: float = setting(50.0, "Output rate.", unit="Hz", minimum=0.1, maximum=200.0)
    drift_deg_h: float = setting(3.0, "Gyro drift of a flight, 1 sigma per axis.", unit="deg/h", minimum=0.0, maximum=100.0)
    random_drift_deg_h: float = setting(0.05, "Random drift, white, 1 sigma at 1 Hz.", unit="deg/h", minimum=0.0, maximum=100.0)
    misalignment_deg: float = setting(0.0, "Further misalignment, Markov with the time constant, 1 sigma.", unit="deg", minimum=0.0)
    erection_tau_s: float = setting(150.0, "Time constant of erection and slaving.", unit="s", minimum=1.0, maximum=1e4)
    cutout_g: float = setting(0.0, "Specific force off gravity by more cuts the erection out; 0 never.", unit="g", minimum=0.0, maximum=5.0)
    pitch_error_mrad: float = setting(0.6, "Constant pitch error: it reads lower by this.", unit="mrad", minimum=-100.0, maximum=100.0)
    bank_error_mrad: float = setting(0.5, "Constant bank error: it reads lower by this.", unit="mrad", minimum=-100.0, maximum=100.0)
    variation_deg: float = setting(0.0, "Magnetic variation where it flies: it reads magnetic heading.", unit="deg", minimum=-180.0)
    noise_mrad: float = setting(0.5, "White noise of heading, pitch and bank, 1 sigma.", unit="mrad", minimum=0.0, maximum=100.0)
    rate_noise_deg_s: float = setting(0.1, "White noise of the rates of turn, 1 sigma.", unit="deg/s", minimum=0.0, maximum=10.0)
    stated_deg: float = setting(0.2, "Sigma it states, every axis.", unit="deg", minimum=0.01, maximum=10.0)


@simulator("hars", Settings=HarsSimulatorSettings, truth=("truth/imu",), topics=("hars/attitude",))
class HarsSimulator:
    """Turn truth into attitude and magnetic heading; keeps its misalignment from call to call."""

    def __init__(self, settings: HarsSimulatorSettings, source: str = "hars/attitude") -> None:
        self.settings, self.source = settings, source
        self._clock = SampleClock(settings.rate_hz)
        start = stream(settings.seed, "hars.drift")
        self.drift = settings.drift_deg_h * DEGREE_PER_HOUR * start.standard_normal(3)
        self.misalignment = math.radians(settings.misalignment_deg) * start.standard_normal(3)
        self._walk_rng, self._noise_rng = stream(settings.seed, "hars.walk"), stream(settings.seed, "hars.noise")
        tau = settings.erection_tau_s
        markov = 2.0 * math.radians(settings.misalignment_deg) ** 2 / tau
        self._density = math.sqrt(markov + (settings.random_drift_deg_h * DEGREE_PER_HOUR) ** 2)

    def simulate(self, truth: TruthBlock) -> list[Attitude]:
        """Return the attitudes that fall into ``truth``."""
        rows = self._clock.rows(truth.stamps_ns)
        if len(rows) == 0:
            return []
        settings = self.settings
        walk = self._density * self._walk_rng.standard_normal((len(rows), 3))
        zeta = np.empty((len(rows), 3))
        off_g = np.abs(np.sqrt((truth.specific_force_b[rows] ** 2).sum(axis=1)) / STANDARD_GRAVITY - 1.0)
        erecting = (off_g < settings.cutout_g) if settings.cutout_g > 0.0 else np.ones(len(rows), bool)
        _erect(self.misalignment, self.drift, erecting, walk, 1.0 / settings.rate_hz, settings.erection_tau_s, zeta)
        noise = self._noise_rng.standard_normal((len(rows), 6))
        tilted = np.array([quat_apply_phi_n(q, -z) for q, z in zip(truth.q_nb[rows], zeta, strict=True)])
        euler = quats_to_euler(tilted) + 1e-3 * settings.noise_mrad * noise[:, 0:3]
        euler -= [1e-3 * settings.bank_error_mrad, 1e-3 * settings.pitch_error_mrad, math.radians(settings.variation_deg)]
        rate = truth.angular_rate_b[rows] + math.radians(settings.rate_noise_deg_s) * noise[:, 3:6]
        cov, unknown = math.radians(settings.stated_deg) ** 2 * np.eye(3), np.zeros(3)
        columns = zip(truth.stamps_ns[rows].tolist(), eulers_to_quat(euler), rate, strict=True)
        return [Attitude(stamp, self.source, q, cov, w, unknown) for stamp, q, w in columns]


@kernel
def _erect(zeta, drift, erecting, walk, dt, tau, out):
    """Carry the misalignment (3,) over each step, in place: exact while it erects, integration while it is cut out."""
    decay = math.exp(-dt / tau)
    for k in range(walk.shape[0]):
        for i in range(3):
            out[k, i] = zeta[i]
            if erecting[k]:
                zeta[i] = decay * zeta[i] + tau * (1.0 - decay) * drift[i] + math.sqrt(0.5 * tau * (1.0 - decay * decay)) * walk[k, i]
            else:
                zeta[i] += dt * drift[i] + math.sqrt(dt) * walk[k, i]
