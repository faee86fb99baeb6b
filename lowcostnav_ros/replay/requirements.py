"""A flight against the requirements on a position: how long there was one, and integrity by alert limits.

The errors are those against the reference; whether a user was *warned* is judged by the navigator's own sigmas at the time.
So an alert here is one that a pilot would have had; it does not need the truth.
"""

import numpy as np

from lowcostnav_ros.gnss.accuracy import SERVICES, Service
from lowcostnav_ros.replay.metrics import Errors
from lowcostnav_ros.replay.result import Exceedance, ServiceErrors

HOLE_NS = 3_000_000_000
"""Errors farther apart than this do not belong to one exceedance."""
PRESENT_NS = 1_100_000_000
"""Positions no farther apart than this, one a second, are a solution without a hole."""
LISTED = 20
"""Exceedances that are listed one by one; all are counted."""


class Coverage:
    """How long there was a position, in s: time between errors that are no farther apart than :data:`PRESENT_NS`."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._last_ns: int | None = None

    def add(self, errors: Errors) -> None:
        """Take errors in, in order of stamps."""
        stamps = errors.stamps_ns[np.isfinite(errors.values[:, :3]).all(axis=1)]
        if len(stamps) == 0:
            return
        steps = np.diff(stamps, prepend=stamps[0] if self._last_ns is None else self._last_ns)
        self.seconds += float(steps[steps <= PRESENT_NS].sum()) / 1e9
        self._last_ns = int(stamps[-1])


class IntegrityMonitor:
    """Alarms of one service along a flight, in fixed memory.

    The navigator raises its alert while a protection level (its own sigma times :meth:`Service.protection_factors`) is beyond the alert
    limit.  A navigator that states no sigma never does.

    Parameters
    ----------
    service : Service
    """

    def __init__(self, service: Service) -> None:
        self.service = service
        self.listed: list[Exceedance] = []
        self._to_alert_ns = round(1e9 * service.time_to_alert_s)
        self._factors = service.protection_factors()
        self._counts = {"warned": 0, "brief": 0, "missed": 0}
        self._beyond_ns = self._alert_total_ns = self._misled_ns = self._longest_ns = 0
        self._open: tuple[int, int, int | None] | None = None  # start, end, begin of the navigator's own alert
        self._alert_since_ns: int | None = None
        self._last: tuple[int, bool, bool] | None = None

    def add(self, errors: Errors) -> None:
        """Take errors in, in order of stamps; rows without a position are skipped."""
        position = errors.values[:, :3]
        known = np.isfinite(position).all(axis=1)
        horizontal, vertical = np.hypot(position[:, 0], position[:, 1]), np.abs(position[:, 2])
        beyond = (horizontal > self.service.horizontal_m) | (vertical > self.service.vertical_m)
        levels = self._factors[0] * errors.sigma_horizontal, self._factors[1] * errors.sigmas[:, 2]
        alert = (levels[0] > self.service.horizontal_m) | (levels[1] > self.service.vertical_m)
        for stamp, is_beyond, is_alert in zip(errors.stamps_ns[known].tolist(), beyond[known].tolist(), alert[known].tolist(), strict=True):
            self._step(stamp, is_beyond, is_alert)

    def _step(self, stamp: int, beyond: bool, alert: bool) -> None:
        if self._last is not None:
            before, was_beyond, was_alert = self._last
            if stamp - before > HOLE_NS:
                self._close()
                self._alert_since_ns = None
            else:
                self._beyond_ns += was_beyond * (stamp - before)
                self._alert_total_ns += was_alert * (stamp - before)
                self._misled_ns += (was_beyond and not was_alert) * (stamp - before)
        self._last = (stamp, beyond, alert)
        self._alert_since_ns = None if not alert else self._alert_since_ns or stamp
        if not beyond:
            self._close()
            return
        start_ns, _, alert_ns = self._open or (stamp, stamp, None)
        self._open = start_ns, stamp, self._alert_since_ns if alert_ns is None else alert_ns

    def _close(self) -> None:
        if self._open is None:
            return
        (start_ns, end_ns, alert_ns), self._open = self._open, None
        due_ns = start_ns + self._to_alert_ns
        verdict = "warned" if alert_ns is not None and alert_ns <= due_ns else "brief" if end_ns < due_ns else "missed"
        self._counts[verdict] += 1
        self._longest_ns = max(self._longest_ns, end_ns - start_ns)
        if len(self.listed) < LISTED:
            alarm_s = None if alert_ns is None else alert_ns / 1e9
            self.listed.append(Exceedance(start_ns / 1e9, end_ns / 1e9, due_ns / 1e9, alarm_s, verdict))

    def result(self) -> ServiceErrors | None:
        """What was found, None when no position ever came; an exceedance still open ends here."""
        self._close()
        if self._last is None:
            return None
        return ServiceErrors(
            self.service.horizontal_m,
            self.service.vertical_m,
            self.service.time_to_alert_s,
            sum(self._counts.values()),
            **self._counts,
            longest_s=self._longest_ns / 1e9,
            beyond_limit_s=self._beyond_ns / 1e9,
            alert_s=self._alert_total_ns / 1e9,
            beyond_without_alert_s=self._misled_ns / 1e9,
            listed=tuple(self.listed),
        )


def monitors() -> dict[str, IntegrityMonitor]:
    """A monitor for each service that promises integrity."""
    return {name: IntegrityMonitor(service) for name, service in SERVICES.items()}
