"""A device's clock against this computer's: offset and drift, from when its messages came.

What lies between the two delays a message and never hastens it, so the truth is the lower edge of what is seen: the least delay of each
second of the device, a straight line through those of the last minute that agree, lowered to their edge.  What remains is the shortest
delay of the way itself, which a driver's ``latency_s`` takes off.
"""

import numpy as np

BUCKET_NS = 10**9
BUCKETS = 60
STEP_NS = 5 * 10**8
FAR_BUCKETS, FAR_SPREAD_NS = 5, 10**8
"""Offsets this far from the fitted one, in five seconds that agree, are a clock that was set; after a stall they shrink instead."""
MOST_DRIFT = 5.0e-4
"""500 parts per million: no crystal is worse."""
SLEW = 0.05
"""Share of the time that passes by which the offset may follow: mapped stamps go on rising."""
EDGE = 5.0
"""Percentile of the residuals that is taken for the lower edge."""
_AGREE, _LEAST_NS = 3.0, 1.0e6


class ClockFit:
    """Maps stamps of one device; fed with every message in the order in which they come."""

    def __init__(self) -> None:
        self.steps = 0
        self._begin()

    def _begin(self) -> None:
        self._buckets: list[tuple[int, int]] = []
        self._least: tuple[int, int] | None = None
        self._far: list[int] = []
        self._bucket = 0
        self._line: tuple[int, float, float] | None = None
        self._offset: float | None = None
        self._last_ns = 0

    @property
    def drift_ppm(self) -> float:
        """Parts per million by which this computer's clock gains on the device's."""
        return 0.0 if self._line is None else 1e6 * self._line[2]

    def map(self, device_ns: int, received_ns: int) -> int:
        """Return the time of a stamp of the device by this computer's clock, ns."""
        delta = received_ns - device_ns
        if self._offset is None or device_ns < self._last_ns - STEP_NS:
            if self._offset is not None:
                self.steps += 1
            self._begin()
            self._offset, self._last_ns, self._bucket = float(delta), device_ns, device_ns // BUCKET_NS
        if self._least is None or delta < self._least[1]:
            self._least = device_ns, delta
        if device_ns // BUCKET_NS > self._bucket:
            self._close(device_ns)
        self._follow(device_ns)
        return device_ns + round(self._offset)

    def _close(self, device_ns: int) -> None:
        """A second of the device is over: fit anew."""
        self._bucket = device_ns // BUCKET_NS
        least, self._least = self._least, None
        if least is None:
            return
        is_far = self._line is not None and abs(least[1] - self._target(least[0])) > STEP_NS
        self._far = [*self._far[1 - FAR_BUCKETS :], least[1]] if is_far else []
        if len(self._far) == FAR_BUCKETS and max(self._far) - min(self._far) < FAR_SPREAD_NS:
            self._buckets, self._line, self._offset, self._far = [], None, float(least[1]), []
            self.steps += 1
        self._buckets = [*self._buckets[1 - BUCKETS :], least]
        self._fit()

    def _fit(self) -> None:
        time, delta = (np.array(column, dtype=np.int64) for column in zip(*self._buckets, strict=True))
        x, y, base = 1e-9 * (time - time[-1]), (delta - delta[0]).astype(float), int(delta[0])
        slope, good = 0.0, np.ones(len(x), bool)
        for _ in range(3):
            if good.sum() >= 5:
                slope = float(np.clip(np.polyfit(x[good], y[good], 1)[0], -1e9 * MOST_DRIFT, 1e9 * MOST_DRIFT))
            residual = y - slope * x
            middle = np.median(residual[good])
            spread = max(1.4826 * float(np.median(np.abs(residual[good] - middle))), _LEAST_NS)
            good = residual < middle + _AGREE * spread
        level = float(np.percentile((y - slope * x)[good], EDGE))
        self._line = int(time[-1]), level + base, 1e-9 * slope

    def _target(self, device_ns: int) -> float:
        if self._line is None:
            return float(self._least[1]) if self._least is not None else self._offset or 0.0
        at, level, slope = self._line
        return level + slope * (device_ns - at)

    def _follow(self, device_ns: int) -> None:
        """Move towards the fitted offset, no faster than the time allows."""
        assert self._offset is not None
        off, room = self._target(device_ns) - self._offset, SLEW * max(device_ns - self._last_ns, 0)
        self._offset += off if abs(off) > STEP_NS else max(-room, min(room, off))
        self._last_ns = max(self._last_ns, device_ns)
