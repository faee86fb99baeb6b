"""What a receiver makes of code, carrier and Doppler of several transmitters: noise, multipath, slips, losses of lock.

Multipath is first-order Gauss-Markov on each code and each carrier.  A slip is a whole number of cycles, at least the smallest, then
geometric; slips, losses and false Dopplers are more frequent in a bank, where multipath and masking are.  Every error of every transmitter
has its own column of random numbers, so neither an outage nor another's loss changes them.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.physics.stochastic import GaussMarkov
from lowcostnav_ros.sensors.drift import DriftBank


def _probability(description: str) -> float:
    return setting(0.0, f"{description}, of one transmitter in one epoch.", minimum=0.0, maximum=1.0)


@dataclass(frozen=True)
class CarrierErrorSettings:
    """Errors of code, carrier and Doppler."""

    code_noise_m: float = setting(3.0, "White noise of a code, 1 sigma.", unit="m", minimum=0.001)
    carrier_noise_m: float = setting(0.01, "White noise of a carrier, 1 sigma.", unit="m", minimum=0.0001)
    doppler_noise_hz: float = setting(0.3, "White noise of a Doppler, 1 sigma.", unit="Hz", minimum=0.0001)
    code_multipath_m: float = setting(1.0, "Multipath of a code, 1 sigma.", unit="m", minimum=0.0)
    carrier_multipath_m: float = setting(0.03, "Multipath of a carrier, 1 sigma.", unit="m", minimum=0.0)
    multipath_tau_s: float = setting(20.0, "Correlation time of multipath.", unit="s", minimum=0.1)
    bank_deg: float = setting(18.0, "Bank beyond which slips and losses are more frequent.", unit="deg", minimum=0.0, maximum=90.0)
    slip: float = _probability("Probability of a cycle slip in level flight")
    slip_banked: float = _probability("Probability of a cycle slip in a bank")
    slip_least_cycles: int = setting(6, "Smallest slip.", unit="cycles", minimum=1, maximum=1000)
    slip_ratio: float = setting(0.787, "Ratio of the probabilities of one slip and the next larger.", minimum=0.0, maximum=0.999)
    loss: float = _probability("Probability of a loss of lock in level flight")
    loss_banked: float = _probability("Probability of a loss of lock in a bank")
    loss_s: float = setting(1.0, "Mean length of a loss of lock.", unit="s", minimum=0.1)
    false_doppler: float = _probability("Probability of a false Doppler in level flight")
    false_doppler_banked: float = _probability("Probability of a false Doppler in a bank")
    false_doppler_hz: float = setting(45.0, "Size of a false Doppler, within a quarter.", unit="Hz", minimum=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Disturbed:
    """Errors of one epoch, (n,): of the code and the carrier, m, of the Doppler, Hz; slipped cycles and which transmitters are locked."""

    code_m: np.ndarray
    carrier_m: np.ndarray
    doppler_hz: np.ndarray
    cycles: np.ndarray
    locked: np.ndarray


class CarrierErrors:
    """Errors of ``n`` transmitters, epoch by epoch; ``slipped`` counts true slips, losses and new locks among them.

    Parameters
    ----------
    settings : CarrierErrorSettings
    n : int
    rate_hz : float
    seed : int
    name : str
        Heads the names of its random streams.
    """

    def __init__(self, settings: CarrierErrorSettings, n: int, rate_hz: float, seed: int, name: str) -> None:
        self.settings, self._n, self._dt_s = settings, n, 1.0 / rate_hz
        sigmas = [settings.code_multipath_m] * n + [settings.carrier_multipath_m] * n
        processes = [GaussMarkov(sigma, settings.multipath_tau_s) for sigma in sigmas]
        self._multipath = DriftBank(processes, self._dt_s, stream(seed, f"{name}.multipath"))
        self._noise, self._events = stream(seed, f"{name}.noise"), stream(seed, f"{name}.events")
        self._turns = stream(seed, f"{name}.turns")
        self._cycles = np.round(1e5 * self._events.standard_normal(n))
        self._lost_s, self._locked = np.zeros(n), np.zeros(n, dtype=bool)
        self.slips = np.zeros(n, dtype=int)
        self.smallest_cycles = np.inf

    def draw(self, received: np.ndarray, banked: bool, slips_per_s: np.ndarray | None = None) -> Disturbed:
        """Return the errors of the next epoch; only those ``received`` (n,) can be locked.

        ``slips_per_s`` (n,) come on top, a cycle each, either way alike, several in an epoch where there are many.
        """
        own, n = self.settings, self._n
        noise, uniform = self._noise.standard_normal((3, n)), self._events.random((6, n))
        sizes = self._events.geometric(1.0 - own.slip_ratio, n)
        multipath = self._multipath.draw(1)[0]
        self._lost_s = np.maximum(self._lost_s - self._dt_s, 0.0)
        loses = uniform[0] < (own.loss_banked if banked else own.loss)
        self._lost_s = np.where(loses & (self._lost_s == 0.0), -own.loss_s * np.log(1.0 - uniform[1]), self._lost_s)
        locked = received & (self._lost_s == 0.0)
        slips = locked & self._locked & (uniform[2] < (own.slip_banked if banked else own.slip))
        size = np.where(uniform[3] < 0.5, 1.0, -1.0) * (own.slip_least_cycles - 1 + sizes)
        size = np.where(slips, size, 0.0)
        if slips_per_s is not None:
            forth, back = self._turns.poisson(np.outer((0.5, 0.5), slips_per_s * self._dt_s))
            size = size + np.where(locked & self._locked, forth - back, 0.0)
            slips = size != 0.0
        self._cycles = self._cycles + size
        fresh = locked & ~self._locked
        self._cycles = np.where(fresh, np.round(1e5 * (2.0 * uniform[3] - 1.0)), self._cycles)
        self.slips += slips
        self.smallest_cycles = min(self.smallest_cycles, float(np.abs(size[slips]).min())) if slips.any() else self.smallest_cycles
        self._locked = locked
        false = uniform[4] < (own.false_doppler_banked if banked else own.false_doppler)
        spike = np.where(false, own.false_doppler_hz * (1.0 + 0.5 * (uniform[5] - 0.5)) * np.where(uniform[3] < 0.5, 1.0, -1.0), 0.0)
        code, carrier = own.code_noise_m * noise[0] + multipath[:n], own.carrier_noise_m * noise[1] + multipath[n:]
        return Disturbed(code, carrier, own.doppler_noise_hz * noise[2] + spike, self._cycles, locked)
