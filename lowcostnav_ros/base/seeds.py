"""Random streams by name: each error source of each sensor has its own, so adding one never changes another."""

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random generator of one named error source.

    Parameters
    ----------
    seed : int
        Seed of the scenario, not negative.
    name : str
        Dotted name such as ``imu.gyro.noise``; equal seed and name give equal numbers, different names independent ones.
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *name.encode()])))
