"""One window judged: errors at every second since the loss and at the ends of the lengths, and where they come from."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, Measurement
from lowcostnav_ros.replay.columns import NavColumns, columns_of, interpolate
from lowcostnav_ros.replay.evaluation import MAX_GAP_NS, Track, Truth, fix_columns, in_order
from lowcostnav_ros.replay.metrics import AXES, Errors, errors_between
from lowcostnav_ros.replay.outages import GAP_NS
from lowcostnav_ros.replay.withhold import NS
from lowcostnav_ros.studies.outages.flight import Loss
from lowcostnav_ros.studies.outages.parts import parts_of
from lowcostnav_ros.studies.outages.result import End, Outage

FIX_GAP_NS = GAP_NS
"""Between fixes as far apart as this the way is taken as straight."""
TRACK_POINTS = 1500
HEADING = AXES.index("heading_deg")


@dataclass
class Reference:
    """What is true: the true states, else the recorded fixes, else the solution with GPS; the last for what neither of them has.

    Parameters
    ----------
    truth : Truth or None
    """

    truth: Truth | None
    sources: set[str] = field(default_factory=set)
    _fixes: Track = field(default_factory=Track)

    def watch(self, measurement: Measurement) -> Measurement:
        """Note a fix that passes, when there is no truth; return the measurement."""
        if self.truth is None and isinstance(measurement, GpsPosition):
            self.sources.add(measurement.source)
            self._fixes.add(fix_columns(measurement))
        return measurement

    def at(self, stamps_ns: np.ndarray, kept: NavColumns) -> NavColumns:
        """State at some stamps; ``kept`` is the navigator's solution with GPS."""
        own = interpolate(kept, stamps_ns, MAX_GAP_NS)
        true = self._fixes.at(stamps_ns, FIX_GAP_NS) if self.truth is None else self.truth.at(stamps_ns)
        if true is None:
            return own
        pairs = {name: (getattr(true, name), getattr(own, name)) for name in ("vel_n", "q_nb", "wind_n")}
        return replace(true, **{name: np.where(np.isfinite(known), known, instead) for name, (known, instead) in pairs.items()})

    @property
    def is_whole(self) -> bool:
        """Whether the truth has all that is asked of it."""
        if self.truth is None or self.truth.newest_ns is None:
            return False
        middle = self.truth.states.whole().stamps_ns[[len(self.truth.states.whole()) // 2]]
        true = self.truth.at(middle)
        return true is not None and all(np.isfinite(getattr(true, name)).all() for name in ("position", "vel_n", "q_nb", "wind_n"))

    @property
    def words(self) -> str:
        """In words."""
        own = "the navigator's own solution with GPS"
        if self.truth is not None:
            return f"the recording's truth; for what it lacks, {own}"
        fixes = f"the recorded fixes ({', '.join(sorted(self.sources))})"
        return f"{fixes}; for velocity, heading and wind, {own}" if self.sources else f"{own} (there is neither truth nor fix)"

    def track_deg(self) -> tuple[tuple[float, float], ...]:
        """Return the way over ground, latitude and longitude, at most :data:`TRACK_POINTS`."""
        track = self._fixes if self.truth is None else self.truth.states
        position = np.degrees(track.whole().position[:, :2]) if track.newest_ns is not None else np.empty((0, 2))
        return tuple((float(lat), float(lon)) for lat, lon in position[:: max(1, -(-len(position) // TRACK_POINTS))])


def judge(loss: Loss, reference: Reference, lengths_s: Sequence[float], first_ns: int) -> dict[str, Outage]:
    """Judge every navigator that had a position when GPS was lost.

    Parameters
    ----------
    loss : Loss
        A window that is over.
    reference : Reference
    lengths_s : sequence of float
    first_ns : int
        First stamp of the recording.
    """
    found = {}
    for name, solutions in loss.lost.items():
        columns = columns_of(solutions)
        placed = columns[np.isfinite(columns.position[:, 0]) & np.isfinite(columns.cov_pos[:, 0, 0])]
        if len(placed) and placed.stamps_ns[0] <= loss.window.start_ns and name in loss.kept:
            outage = _judged(loss, placed, columns_of(loss.kept[name]), reference, lengths_s, first_ns)
            if outage is not None:
                found[name] = outage
    return found


def _judged(
    loss: Loss, lost: NavColumns, kept: NavColumns, reference: Reference, lengths_s: Sequence[float], first_ns: int
) -> Outage | None:
    start_ns = loss.window.start_ns
    ends_ns = {length_s: start_ns + round(NS * length_s) for length_s in lengths_s}
    ends_ns = {length_s: end_ns for length_s, end_ns in ends_ns.items() if end_ns <= loss.window.end_ns}
    seconds = np.arange(start_ns, max(ends_ns.values()) + 1, NS)
    grid = np.unique([*seconds, *ends_ns.values()])
    estimate, with_gps = in_order(lost), in_order(kept)
    true = reference.at(grid, with_gps)
    errors = _errors(interpolate(estimate, grid, MAX_GAP_NS), true)
    horizontal = np.hypot(errors.axis("north_m"), errors.axis("east_m"))
    if not np.isfinite(horizontal[0]):
        return None
    known, ends, silent = np.isfinite(true.position[:, 0]), [], []
    for length_s, end_ns in ends_ns.items():
        row = int(np.searchsorted(grid, end_ns))
        if known[row] and np.isfinite(horizontal[row]):
            rows = (estimate.stamps_ns >= start_ns) & (estimate.stamps_ns <= end_ns)
            moved = reference.at(estimate.stamps_ns[rows], with_gps)
            motion = parts_of(estimate[rows], moved, errors.values[0, :2], errors.values[row, :2])
            ends.append(_end(errors, row, length_s, motion))
        elif known[row] and loss.is_whole:
            silent.append(length_s)
    whole = np.searchsorted(grid, seconds)
    lat, lon = np.degrees(true.position[0, :2])
    curves = (tuple(round(v, 2) if np.isfinite(v) else None for v in of[whole].tolist()) for of in (horizontal, errors.sigma_horizontal))
    return Outage(start_ns / NS, (start_ns - first_ns) / NS, float(lat), float(lon), tuple(ends), tuple(silent), *curves)


def _errors(estimate: NavColumns, true: NavColumns) -> Errors:
    """Errors at every stamp, NaN where there is none."""
    some = errors_between(estimate, true)
    rows = np.searchsorted(estimate.stamps_ns, some.stamps_ns)
    n = len(estimate)
    whole = [np.full((n, len(AXES)), np.nan), np.full((n, len(AXES)), np.nan), np.full(n, np.nan), np.full(n, np.nan)]
    for column, part in zip(whole, (some.values, some.sigmas, some.nees_horizontal, some.sigma_horizontal), strict=True):
        column[rows] = part
    return Errors(estimate.stamps_ns, *whole)


def _end(errors: Errors, row: int, length_s: float, motion: tuple[dict[str, float], dict[str, float]]) -> End:
    north, east, down = errors.values[row, :3].tolist()
    ratio = float(np.sqrt(np.mean((errors.values[row, :2] / errors.sigmas[row, :2]) ** 2)))
    heading, sigma = (float(v) if np.isfinite(v) else None for v in (errors.values[row, HEADING], errors.sigmas[row, HEADING]))
    size = float(np.hypot(north, east)), float(errors.sigma_horizontal[row])
    return End(length_s, north, east, down, *size, ratio, heading, sigma, *motion)
