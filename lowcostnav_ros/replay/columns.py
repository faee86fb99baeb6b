"""States as columns: what statistics, result files and plots work on.

Solutions, truth and withheld fixes become the same columns; a datum that is absent is NaN here and blank in a file.
"""

import dataclasses
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.cores.rows import Rows
from lowcostnav_ros.messages.columns import Columns
from lowcostnav_ros.navigators.solutions import Solutions
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.rotation import euler_jacobian_n, quat_to_euler, quats_to_euler, wrap

_SHAPES: dict[str, tuple[int, ...]] = {"position": (3,), "vel_n": (3,), "q_nb": (4,), "wind_n": (2,)}
_SHAPES |= {"cov_pos": (3, 3), "cov_vel": (3, 3), "cov_att": (3, 3), "cov_wind": (2, 2)}
"""Columns beside the stamps and the shape of one row."""
_FIELDS = [field.name for field in dataclasses.fields(NavSolution)][2:]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class NavColumns:
    """States at n stamps.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        Not decreasing.
    position : ndarray, shape (n, 3)
        Latitude, longitude (rad), height above the ellipsoid (m).
    vel_n : ndarray, shape (n, 3)
        m/s, NED.
    q_nb : ndarray, shape (n, 4)
    wind_n : ndarray, shape (n, 2)
        m/s, north and east.
    cov_pos, cov_vel, cov_att : ndarray, shape (n, 3, 3)
        NED; m^2, (m/s)^2, rad^2.
    cov_wind : ndarray, shape (n, 2, 2)
    """

    stamps_ns: np.ndarray
    position: np.ndarray
    vel_n: np.ndarray
    q_nb: np.ndarray
    wind_n: np.ndarray
    cov_pos: np.ndarray
    cov_vel: np.ndarray
    cov_att: np.ndarray
    cov_wind: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, rows: slice | np.ndarray) -> "NavColumns":
        return NavColumns(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @property
    def euler(self) -> np.ndarray:
        """Roll, pitch, heading, shape (n, 3), rad."""
        return quats_to_euler(np.ascontiguousarray(self.q_nb))

    @property
    def sigma_euler(self) -> np.ndarray:
        """One-sigma of roll, pitch, heading, shape (n, 3), rad, from the covariance of the small rotation resolved in n."""
        return _sigma_euler(self.q_nb, self.cov_att)


@kernel
def _sigma_euler(q_nb: np.ndarray, cov_att: np.ndarray) -> np.ndarray:
    out = np.full((len(q_nb), 3), np.nan)
    for k in range(len(q_nb)):
        if np.isfinite(q_nb[k, 0]):
            roll, pitch, heading = quat_to_euler(q_nb[k])
            jacobian = euler_jacobian_n(roll, pitch, heading)
            for i in range(3):
                variance = 0.0
                for j in range(3):
                    for m in range(3):
                        variance += jacobian[i, j] * cov_att[k, j, m] * jacobian[i, m]
                out[k, i] = np.sqrt(variance)
    return out


@kernel
def _position_difference(position: np.ndarray, reference: np.ndarray) -> np.ndarray:
    out = np.empty((len(position), 3))
    for k in range(len(position)):
        out[k] = difference_n(position[k, 0], position[k, 1], position[k, 2], reference[k, 0], reference[k, 1], reference[k, 2])
    return out


def position_difference_n(position: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Position minus reference, shape (n, 3), metres north, east, down; rows of latitude, longitude (rad), height (m)."""
    return _position_difference(np.ascontiguousarray(position), np.ascontiguousarray(reference))


def columns_of(solutions: Sequence[NavSolution]) -> NavColumns:
    """Turn solutions into columns; what a navigator does not estimate is NaN."""
    if not isinstance(solutions, Solutions):
        return _columns_of_objects(solutions)
    columns = []
    for _, run in groupby(solutions.parts, lambda part: part.wind if isinstance(part, Rows) else None):
        parts = list(run)
        rows, objects = [p for p in parts if isinstance(p, Rows)], [p for p in parts if isinstance(p, NavSolution)]
        columns.append(_columns_of_rows(rows) if rows else _columns_of_objects(objects))
    return concatenate(columns) if columns else _columns_of_objects([])


def _columns_of_rows(parts: list[Rows]) -> NavColumns:
    stamps, table = np.concatenate([part.stamps_ns for part in parts]), np.concatenate([part.table for part in parts])
    known, first = {"position": table[:, :3], "vel_n": table[:, 3:6], "q_nb": table[:, 6:10]}, parts[0].first_of_wind
    known |= {name: table[:, at : at + 9].reshape(-1, 3, 3) for name, at in (("cov_pos", 10), ("cov_vel", 19), ("cov_att", 28))}
    if first is not None:
        known |= {"wind_n": table[:, first : first + 2], "cov_wind": table[:, -4:].reshape(-1, 2, 2)}
    return blank_columns(stamps, **known)


def _columns_of_objects(solutions: Sequence[NavSolution]) -> NavColumns:
    def rows(name: str, shape: tuple[int, ...]) -> np.ndarray:
        absent = np.full(shape, np.nan)
        values = ((s.lat, s.lon, s.height) if name == "position" and s.lat is not None else getattr(s, name, None) for s in solutions)
        return np.array([absent if v is None else v for v in values], dtype=float).reshape(-1, *shape)

    stamps = np.array([s.stamp_ns for s in solutions], dtype=np.int64)
    return NavColumns(stamps, **{name: rows(name, shape) for name, shape in _SHAPES.items()})


def columns_of_messages(found: Sequence[Columns], rest: Sequence[tuple[int, Measurement]]) -> NavColumns:
    """Turn those of the messages that :func:`.messages.decode.decode_many` decoded that are solutions into columns, by their rows."""
    found = [columns for columns in found if columns.kind.measurement is NavSolution]
    singles = [(row, one) for row, one in rest if isinstance(one, NavSolution)]
    parts = [_columns_of_fields(columns) for columns in found] + ([columns_of([one for _, one in singles])] if singles else [])
    if len(parts) < 2:
        return parts[0] if parts else columns_of([])
    rows = np.concatenate([*(columns.rows for columns in found), *([[row for row, _ in singles]] if singles else [])])
    return concatenate(parts)[np.argsort(rows, kind="stable")]


def _columns_of_fields(columns: Columns) -> NavColumns:
    fields = dict(zip(_FIELDS, columns.fields, strict=False))
    known = {name: np.array(fields[name], dtype=float) for name in _SHAPES if fields.get(name) is not None}
    if fields.get("lat") is not None:
        known["position"] = np.stack([fields[name] for name in ("lat", "lon", "height")], axis=1)
    return blank_columns(columns.stamps_ns, **known)


def blank_columns(stamps_ns: np.ndarray, **known: np.ndarray) -> NavColumns:
    """Columns at ``stamps_ns`` with the named ones given and all others NaN."""
    rest = {name: np.full((len(stamps_ns), *shape), np.nan) for name, shape in _SHAPES.items() if name not in known}
    return NavColumns(np.asarray(stamps_ns, dtype=np.int64), **known, **rest)


def concatenate(parts: Sequence[NavColumns]) -> NavColumns:
    """Join columns end to end."""
    if len(parts) == 1:
        return parts[0]
    return NavColumns(*(np.concatenate([getattr(p, name) for p in parts]) for name in NavColumns.__dataclass_fields__))


def interpolate(columns: NavColumns, stamps_ns: np.ndarray, max_gap_ns: int) -> NavColumns:
    """States at other stamps.

    Position goes linearly in the local level frame (the longitude's wrap minded), velocity and wind linearly, attitude along the
    shorter arc; covariances are those of the sample before.  Stamps outside the columns, or in a gap longer than ``max_gap_ns``, give NaN.

    Parameters
    ----------
    columns : NavColumns
        Stamps not decreasing.
    stamps_ns : ndarray of int64, shape (m,)
    max_gap_ns : int
        Longest gap to bridge, ns.
    """
    after = np.clip(np.searchsorted(columns.stamps_ns, stamps_ns, side="left"), 1, max(1, len(columns) - 1))
    if len(columns) < 2:
        after = np.zeros(len(stamps_ns), dtype=np.int64)
    before = np.maximum(after - 1, 0)
    t0, t1 = columns.stamps_ns[before], columns.stamps_ns[after]
    share = (stamps_ns - t0) / np.maximum(t1 - t0, 1)
    usable = (stamps_ns >= t0) & (stamps_ns <= t1) & (t1 - t0 <= max_gap_ns)
    share = np.where(usable, share, np.nan)[:, None]
    step = columns.position[after] - columns.position[before]
    step[:, 1] = wrap(step[:, 1])
    position = columns.position[before] + share * step
    position[:, 1] = wrap(position[:, 1])
    return NavColumns(
        np.asarray(stamps_ns, dtype=np.int64),
        position,
        _between(columns.vel_n, before, after, share),
        _nlerp(columns.q_nb[before], columns.q_nb[after], share),
        _between(columns.wind_n, before, after, share),
        *(getattr(columns, name)[before] for name in ("cov_pos", "cov_vel", "cov_att", "cov_wind")),
    )


def _between(values: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray) -> np.ndarray:
    return values[before] + share * (values[after] - values[before])


def _nlerp(q0: np.ndarray, q1: np.ndarray, share: np.ndarray) -> np.ndarray:
    near = np.where(np.sum(q0 * q1, axis=1, keepdims=True) < 0.0, -q1, q1)
    mixed = q0 + share * (near - q0)
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
