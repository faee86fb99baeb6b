"""Collect samples for a magnetometer calibration while flying, with progress, in bounded memory.

A pure accumulator: it has no clock and no topic.  Every attitude cell keeps a few samples only, so hours of straight flight
neither fill the memory nor outweigh the turns.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.calibration.magnetometer_fit import NARROW_DEG, Coverage, MagnetometerFit, coverage_of
from lowcostnav_ros.calibration.magnetometer_full import full_fit
from lowcostnav_ros.calibration.magnetometer_known_strength import CalibrationPrior, known_strength_fit
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.physics.rotation import quat_to_dcm

PER_CELL = 20
CELLS_PER_UNIT = 10
"""Cells of the field direction are tenths of the unit vector, about six degrees."""
WANTED_SWEPT_DEG = 330.0


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a collection is.

    Attributes
    ----------
    samples : int
        Samples kept.
    coverage : Coverage or None
        None until there are enough samples for one.
    share : float
        0 to 1; at 1 the free fit has what it needs.
    advice : str
        What to fly next, one sentence.
    """

    samples: int
    coverage: Coverage | None
    share: float
    advice: str


class MagnetometerCollection:
    """Samples of the field with the attitude they were taken at.

    Parameters
    ----------
    field_n : ndarray, shape (3,)
        The earth's field at the place, tesla, NED, from the magnetic model.
    """

    def __init__(self, field_n: np.ndarray) -> None:
        self._field_n = np.array(field_n, dtype=float)
        if self._field_n.shape != (3,) or not np.all(np.isfinite(self._field_n)) or not np.any(self._field_n):
            raise CalibrationError("The earth's field must be three finite numbers in tesla; take it from the magnetic model.")
        self.strength = float(np.linalg.norm(self._field_n))
        self._measured: list[np.ndarray] = []
        self._expected: list[np.ndarray] = []
        self._filled: dict[tuple[int, int, int], int] = {}
        self._coverage: Coverage | None = None
        self.rejected = 0

    def collect(self, field_b: np.ndarray, q_nb: np.ndarray) -> Progress:
        """Add one sample.

        Parameters
        ----------
        field_b : ndarray, shape (3,)
            Measured field before calibration, tesla, body axes.
        q_nb : ndarray, shape (4,)
            Attitude at the time, only used to judge coverage, so a heading wrong by ten degrees does no harm.
        """
        field_b, q_nb = np.asarray(field_b, dtype=float), np.asarray(q_nb, dtype=float)
        if not (np.all(np.isfinite(field_b)) and np.all(np.isfinite(q_nb))):
            self.rejected += 1
            return self.progress()
        expected = quat_to_dcm(q_nb).T @ self._field_n / self.strength
        x, y, z = (int(v) for v in np.floor(expected * CELLS_PER_UNIT))
        cell = x, y, z
        if self._filled.get(cell, 0) < PER_CELL:
            first = cell not in self._filled
            self._filled[cell] = self._filled.get(cell, 0) + 1
            self._measured.append(field_b)
            self._expected.append(expected)
            if first:
                self._coverage = None
        return self.progress()

    def progress(self) -> Progress:
        """Describe the progress of the collection."""
        count = len(self._measured)
        if self._coverage is None and len(self._filled) >= 3:
            self._coverage = coverage_of(np.array(self._expected))
        coverage = self._coverage
        if coverage is None:
            return Progress(count, None, 0.0, "Fly a level turn through all headings.")
        turn, tilt = min(1.0, coverage.swept_deg / WANTED_SWEPT_DEG), min(1.0, coverage.strip_deg / (2.0 * NARROW_DEG))
        if turn < 1.0:
            advice = f"Turn through all headings; {coverage.swept_deg:.0f} deg are covered."
        elif tilt < 1.0:
            advice = f"Bank and pitch more, left and right; {coverage.strip_deg:.0f} deg of tilt are covered."
        else:
            advice = "Enough is collected; finish the calibration."
        return Progress(count, coverage, min(turn, tilt), advice)

    def finish(self, prior: CalibrationPrior | None = None) -> MagnetometerFit:
        """Fit what was collected, unit tesla: freely where the coverage carries it, else with known strength and a prior.

        Raises
        ------
        CalibrationError
            When neither fit can be carried, with the reason and what to fly.
        """
        measured = np.array(self._measured).reshape(-1, 3)
        try:
            return full_fit(measured, self.strength, 2.0 * NARROW_DEG)
        except CalibrationError:
            return known_strength_fit(measured, self.strength, prior)
