"""What a receiver's channels do from epoch to epoch: slips, gaps, clock steps (Kawecki 2015, section 3.6).

    slip = phase - phase before + (Doppler + Doppler before)/2 dt      (3.20), cycles

What all channels show alike is the receiver's clock, which no channel has slipped by: it is taken off while four or more are tracked, and
where it is larger than the threshold it is a clock step.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import CarrierEpoch

MOST = 64
"""Transmitters that can be told apart."""
COMMON = 4
"""Channels from which a common step can be told from slips."""
NEW, GAP, SLIP = "new", "time slip", "threshold slip"


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
        phase, doppler, wave = epoch.carrier_cycles[rows], epoch.doppler_hz[rows], epoch.wavelength_m[rows]
        before = self._stamp[channel]
        dt_ns = epoch.stamp_ns - before
        known = (before > 0) & (dt_ns > 0) & (wave == self._wave[channel])
        gap = known & (dt_ns > self._gap_ns)
        counted = known & ~gap
        size = np.zeros(len(rows))
        size[counted] = (phase - self._phase[channel] + 0.5e-9 * (doppler + self._doppler[channel]) * dt_ns)[counted]
        common = float(np.median(size[counted])) if np.count_nonzero(counted) >= COMMON else 0.0
        slipped = counted & (np.abs(size - common) > self._threshold)
        self._stamp[channel], self._phase[channel], self._doppler[channel], self._wave[channel] = epoch.stamp_ns, phase, doppler, wave
        kinds = {int(row): NEW for row in rows[~known]} | {int(row): GAP for row in rows[gap]} | {int(row): SLIP for row in rows[slipped]}
        step = common * float(wave[0]) if abs(common) > self._threshold else 0.0
        return Slips(kinds, step, size - common)
