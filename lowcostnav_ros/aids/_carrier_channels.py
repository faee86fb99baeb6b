"""What a receiver's channels do from epoch to epoch: slips, gaps, clock steps (Kawecki 2015, section 3.6).

    slip = phase - phase before + (Doppler + Doppler before)/2 dt      (3.20), cycles

What all channels show alike is the receiver's clock, which no channel has slipped by: it is taken off while four or more are tracked, and
where it is larger than the threshold it is a clock step.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import CarrierEpoch

MOST = 64
"""Transmitters that can be told apart."""
COMMON = 4
"""Channels from which a common step can be told from slips."""
NEW, GAP, SLIP = "new", "time slip", "threshold slip"
KINDS = "", NEW, GAP, SLIP


@dataclass(frozen=True, slots=True, eq=False)
class Slips:
    """What became of the carriers of an epoch: rows that cannot go on counting, by kind; ``step_m`` of the clock; ``size`` (n,) cycles."""

    kinds: dict[int, str]
    step_m: float
    size: np.ndarray


class Channels:
    """Last phase, Doppler and stamp of each channel.

    Parameters
    ----------
    threshold_cycles : float
        Of a slip.
    gap_s : float
        A carrier that was away for longer has slipped.
    """

    def __init__(self, threshold_cycles: float, gap_s: float) -> None:
        self._threshold, self._gap_ns = threshold_cycles, round(1e9 * gap_s)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._stamp, self._phase, self._doppler, self._wave = np.zeros(MOST, np.int64), np.zeros(MOST), np.zeros(MOST), np.zeros(MOST)

    def look(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray) -> Slips:
        """Compare carriers with those before.

        Parameters
        ----------
        epoch : CarrierEpoch
        rows : ndarray of int (m,)
            With a valid carrier.
        channel : ndarray of int (m,)
            Number of the channel of each.
        """
        now = epoch.carrier_cycles[rows], epoch.doppler_hz[rows], epoch.wavelength_m[rows]
        before, limits = (self._stamp, self._phase, self._doppler, self._wave), (self._gap_ns, self._threshold)
        kinds, size, step_m = compared(before, epoch.stamp_ns, channel, now, limits)
        marked = np.flatnonzero(kinds)
        return Slips({int(rows[k]): KINDS[kinds[k]] for k in marked}, step_m, size)


@kernel
def compared(before, stamp_ns, channel, now, limits):
    """Compare the carriers of an epoch with those before, which they take the place of.

    Parameters
    ----------
    before : tuple of ndarray
        Stamps, phases, Dopplers and wavelengths of all channels, changed in place.
    stamp_ns : int
    channel : ndarray of int (m,)
    now : tuple of ndarray (m,)
        Phases, Dopplers and wavelengths.
    limits : (int, float)
        Longest gap, ns, and the threshold, cycles.

    Returns
    -------
    kinds : ndarray of int (m,)
        Number in :data:`KINDS`.
    size : ndarray (m,)
        Of the slips, cycles.
    step_m : float
        Of the clock.
    """
    (stamps, phases, dopplers, waves), (phase, doppler, wave), m = before, now, channel.shape[0]
    kinds, size, counted = np.zeros(m, dtype=np.int64), np.zeros(m), np.zeros(m, dtype=np.bool_)
    for k in range(m):
        c = channel[k]
        dt_ns = stamp_ns - stamps[c]
        if not (stamps[c] > 0 and dt_ns > 0 and wave[k] == waves[c]):
            kinds[k] = 1
        elif dt_ns > limits[0]:
            kinds[k] = 2
        else:
            counted[k] = True
            size[k] = phase[k] - phases[c] + 0.5e-9 * (doppler[k] + dopplers[c]) * dt_ns
    common = np.median(size[counted]) if np.count_nonzero(counted) >= COMMON else 0.0
    for k in range(m):
        c = channel[k]
        size[k] -= common
        if counted[k] and abs(size[k]) > limits[1]:
            kinds[k] = 3
        stamps[c], phases[c], dopplers[c], waves[c] = stamp_ns, phase[k], doppler[k], wave[k]
    return kinds, size, common * wave[0] if abs(common) > limits[1] else 0.0
