"""Motion drawn at random from the model a filter assumes: on it a filter without defect is consistent, whatever its numbers.

    tau_s = 0:  dv/dt = w                      velocity a random walk of density psd, m^2/s^3
    tau_s > 0:  dv/dt = a,  da/dt = -a/tau + w  acceleration Gauss-Markov of driving density psd, m^2/s^5

each relative to space, so that v_n also turns with n.  No attitude is modelled: level, north, without inertial data.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics.earth import displace, transport_rate_n

LAT_DEG, LON_DEG, HEIGHT_M = 38.7, -9.1, 500.0
"""Start, as of the datasets."""


def drawn_motion(
    rng: np.random.Generator, duration_s: float, psd: float, tau_s: float = 0.0, start_mps2: float = 0.0, rate_hz: int = 100
) -> TruthBlock:
    """Draw a flight that starts at 50 m/s to the north.

    Parameters
    ----------
    rng : numpy.random.Generator
    duration_s : float
    psd : float
        Driving density, m^2/s^3 or m^2/s^5; see the module head.
    tau_s : float
        Correlation time of the acceleration, s; 0 for a velocity that walks.
    start_mps2 : float
        Sigma of the acceleration at the start, m/s^2.
    rate_hz : int
        Rate of the truth.

    Returns
    -------
    TruthBlock
        Stamps from one interval on, ns.
    """
    count, dt = round(duration_s * rate_hz), 1.0 / rate_hz
    if tau_s > 0.0:
        decay, kick = math.exp(-dt / tau_s), math.sqrt(-0.5 * psd * tau_s * math.expm1(-2.0 * dt / tau_s))
    else:
        decay, kick = 0.0, math.sqrt(psd / dt)  # the mean acceleration of an interval: white
    start = start_mps2 * rng.standard_normal(3)
    nav = np.array([math.radians(LAT_DEG), math.radians(LON_DEG), HEIGHT_M, 50.0, 0.0, 0.0])
    path = _integrate(nav, start, decay, kick, tau_s > 0.0, dt, rng.standard_normal((count, 3)))
    stamps_ns = np.round(np.arange(1, count + 1) * (1e9 * dt)).astype(np.int64)
    none = np.zeros((count, 3))
    level = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    lat, lon, height = path[:, :3].T.copy()
    return TruthBlock(stamps_ns, lat, lon, height, path[:, 3:6].copy(), level, none, none, none)


@kernel
def _integrate(nav, acceleration, decay, kick, lasting, dt, normals):
    """Latitude, longitude [rad], height [m] and velocity NED [m/s] after each interval, (n, 6)."""
    out = np.empty((normals.shape[0], 6))
    for k in range(normals.shape[0]):
        following = decay * acceleration + kick * normals[k]
        mean = 0.5 * (acceleration + following) if lasting else following
        acceleration = following
        v0 = nav[3:6].copy()
        turn = transport_rate_n(nav[0], nav[2], v0)
        half = v0 + 0.5 * dt * mean
        nav[3] += dt * (mean[0] - turn[1] * half[2] + turn[2] * half[1])
        nav[4] += dt * (mean[1] - turn[2] * half[0] + turn[0] * half[2])
        nav[5] += dt * (mean[2] - turn[0] * half[1] + turn[1] * half[0])
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], 0.5 * dt * (v0 + nav[3:6]))
        out[k] = nav
    return out
