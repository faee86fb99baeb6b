"""One realisation of a flight, its wind and misalignment, and what the ten-state error estimator makes of it (Eggers 1995, section 8.2)."""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.studies.air_corrections import (
    CENTRE_KT,
    DECAY,
    GRAVITY_KT_S,
    REFERENCE_KT,
    Truth,
    markov,
    true_corrections,
    wind,
    with_gps,
)
from lowcostnav_ros.trajectory.load_factor import AirSeen, fly, fly_in_envelope

N = 2000
MRAD = 1e3
VARIATION = 0.1
TEXT_GPS, INFERRED_GPS = 0.49 * 3600.0 / 6080.0, 0.25
"""kt: 0.49 ft/s of the text, and what the published residuals differ by."""


def path(name: str, n: int = N) -> AirSeen:
    """One of the flights: slow sines, the same gentler, the listing's example, straight and level."""
    if name == "listing":
        t = np.arange(1, n + 1)
        roll = np.sin(2.0 * np.pi * t / 60.0) / 15.0
        return fly(np.full(n, 1.5), roll, np.array([0.0, 320.0, 0.0]), bank=-0.25, variation=VARIATION, gravity=GRAVITY_KT_S)
    if name == "straight":
        return fly(np.ones(n), np.zeros(n), np.array([REFERENCE_KT, 0.0, 0.0]), variation=VARIATION, gravity=GRAVITY_KT_S)
    scale = 0.6 if name.endswith("0.6") else 1.0
    return fly_in_envelope(n, gravity=GRAVITY_KT_S, speed=REFERENCE_KT, scale=scale, variation=VARIATION)


@dataclass(frozen=True)
class Setup:
    """One realisation: flight, wind (or the step of a Markov wind), variance of the true misalignment, sigma of GPS."""

    seed: int
    path: str
    wind: str = "markov 2"
    zeta_q: float = 4.03e-8
    gps: float = TEXT_GPS
    step: float = 0.0

    def make(self) -> tuple[Truth, np.ndarray]:
        """Truth and GPS velocity."""
        rng = stream(self.seed, f"eggers.{self.wind}.{self.step}")
        blows = wind(self.wind, N, rng) if not self.step else markov(N, math.sqrt(1.0 - self.step**2 / 25.0), self.step, rng, CENTRE_KT)
        zeta = markov(N, DECAY, math.sqrt(self.zeta_q), rng)
        truth = Truth.of(path(self.path), true_corrections(N, blows, zeta), VARIATION)
        return truth, with_gps(truth, self.gps, rng)


def row(values: np.ndarray, digits: int = 3) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)
