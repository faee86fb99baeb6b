"""The earth's magnetic field by the World Magnetic Model, with the generation chosen by date.

Field in tesla, NED at the place; declination in radians, east positive; inclination in radians, positive where the field dips.
The model holds the core field only: local anomalies of some hundred nanotesla (half a degree of declination) are in none of it.
"""

import functools
import itertools
import math
from datetime import UTC, datetime
from datetime import date as Date
from typing import Any

import numpy as np
from pygeomag import GeoMag

from lowcostnav_ros.base.settings import SettingsError, setting

GENERATIONS = ((2010.0, "WMM_2010"), (2015.0, "WMM_2015v2"), (2020.0, "WMM_2020"), (2025.0, "WMM_2025"))
"""First year of validity and name of each model; each is good for five years."""
LAST_YEAR = 2030.0
LOWEST_HEIGHT, HIGHEST_HEIGHT = -1_000.0, 850_000.0
"""Range of heights, m, that the model is published for."""

_NANOTESLA = 1.0e-9
_CELLS_PER_DEGREE = 10  # 11 km; linear interpolation over a cell is good to 0.2 nT, a thousandth of the model's own error
_CELL_HEIGHT = 2_000.0  # m


UNDATED_YEAR = 2026.5
"""Year taken where neither the settings nor the stamps, which then count from a power-up, give a date."""
_EARLIEST_NS = 1_260_000_000 * 1_000_000_000  # December 2009: an earlier stamp is not a date
_MONTH_NS = 30 * 86_400 * 1_000_000_000


def year_setting(description: str) -> Any:
    """Declare the setting of a model's year: one range wherever it stands, 0 for the stamps'."""
    return setting(0.0, f"{description}; 0: that of the stamps.", unit="year", minimum=0.0, maximum=LAST_YEAR)


def check_year(year: float) -> None:
    """Refuse a year in settings, other than 0, that no model covers.

    Raises
    ------
    SettingsError
    """
    if year != 0.0:
        try:
            model_name(year)
        except ValueError as error:
            raise SettingsError(f"'decimal_year': {error}") from None


def year_of_stamp(stamp_ns: int) -> float | None:
    """Decimal year of a stamp, ns since 1970; None for one that is no date but a time since power-up."""
    return decimal_year(datetime.fromtimestamp(stamp_ns * 1e-9, UTC)) if _EARLIEST_NS < stamp_ns < 2**63 else None


def decimal_year(date: float | Date | datetime) -> float:
    """Date as a decimal year (2026.5); a number is taken to be one already."""
    if not isinstance(date, Date):
        return float(date)
    first = Date(date.year, 1, 1)
    since = date.replace(tzinfo=None) - datetime(date.year, 1, 1) if isinstance(date, datetime) else date - first
    return date.year + since / (Date(date.year + 1, 1, 1) - first)


def model_name(date: float | Date | datetime) -> str:
    """Name of the model generation that covers a date.

    Raises
    ------
    ValueError
        When none does.
    """
    year = decimal_year(date)
    if not GENERATIONS[0][0] <= year <= LAST_YEAR:
        raise ValueError(
            f"No magnetic model covers the date {year:.2f} (they reach from {GENERATIONS[0][0]:.0f} to {LAST_YEAR:.0f}); "
            "give the date of the flight or set the declination by hand."
        )
    return next(name for start, name in reversed(GENERATIONS) if year >= start)


@functools.cache
def _coefficients(name: str) -> GeoMag:
    return GeoMag(coefficients_file=f"wmm/{name}.COF")


def field_n(lat: float, lon: float, height: float, date: float | Date | datetime) -> np.ndarray:
    """Magnetic field, tesla, NED, shape (3,).

    Parameters
    ----------
    lat, lon : float
        Geodetic, rad.
    height : float
        m above the ellipsoid.
    date : float, datetime.date or datetime.datetime
        Decimal year or date.

    Raises
    ------
    ValueError
        For a date outside every model, a latitude beyond the poles or a height outside the model.
    """
    _check_place(lat, lon, height)
    return _evaluate(model_name(date), decimal_year(date), math.degrees(lat), math.degrees(lon), height)


def _check_place(lat: float, lon: float, height: float) -> None:
    if not (abs(lat) <= 0.5 * math.pi + 1e-12 and math.isfinite(lon)):
        raise ValueError(f"The magnetic model needs latitude and longitude in radians, got {lat}, {lon}.")
    if not LOWEST_HEIGHT <= height <= HIGHEST_HEIGHT:
        raise ValueError(f"The magnetic model reaches from -1 km to 850 km above the ellipsoid; the height is {height} m.")


def _evaluate(name: str, year: float, lat_deg: float, lon_deg: float, height: float) -> np.ndarray:
    result = _coefficients(name).calculate(glat=max(-90.0, min(90.0, lat_deg)), glon=lon_deg, alt=1.0e-3 * height, time=year)
    return np.array([result.x, result.y, result.z]) * _NANOTESLA


def declination_of(field: np.ndarray) -> float:
    """Declination, rad, east positive, of a field in NED: true heading minus magnetic heading."""
    return math.atan2(field[1], field[0])


def inclination_of(field: np.ndarray) -> float:
    """Inclination, rad, positive down, of a field in NED."""
    return math.atan2(field[2], math.hypot(field[0], field[1]))


def declination(lat: float, lon: float, height: float, date: float | Date | datetime) -> float:
    """Declination, rad, east positive; arguments as :func:`field_n`."""
    return declination_of(field_n(lat, lon, height, date))


def inclination(lat: float, lon: float, height: float, date: float | Date | datetime) -> float:
    """Inclination, rad, positive down; arguments as :func:`field_n`."""
    return inclination_of(field_n(lat, lon, height, date))


def horizontal(lat: float, lon: float, height: float, date: float | Date | datetime) -> float:
    """Horizontal field strength, tesla; below 2e-6 a compass is of no use; arguments as :func:`field_n`."""
    field = field_n(lat, lon, height, date)
    return math.hypot(field[0], field[1])


class DatedModel:
    """The magnetic model of a stated year, or of the month of the stamps: a function of year and stamp alone.

    Parameters
    ----------
    stated : float
        Decimal year; 0 for that of the stamps, :data:`UNDATED_YEAR` where these are no dates.

    Attributes
    ----------
    model : MagneticModel or None
        Of the month last followed; None where no model covers it.
    remark : str
        What is odd about the year, in words; empty for nothing.

    Raises
    ------
    ValueError
        For a stated year that no model covers.
    """

    def __init__(self, stated: float) -> None:
        self._stated, self._month, self.remark = stated, 0, ""
        self.model: MagneticModel | None = _model(stated or UNDATED_YEAR)

    def follow(self, stamp_ns: int) -> None:
        """Take the date of a stamp, ns."""
        if stamp_ns // _MONTH_NS == self._month:
            return
        self._month = stamp_ns // _MONTH_NS
        year, self.remark = year_of_stamp(self._month * _MONTH_NS + _MONTH_NS // 2), ""
        if self._stated:
            if year is not None and abs(year - self._stated) > 1.0:
                apart = f"{abs(year - self._stated):.0f} years from the stamps' {year:.1f}"
                self.remark = f"magnetic model of {self._stated:g}, {apart}; set decimal_year to 0"
            return
        try:
            self.model = _model(UNDATED_YEAR if year is None else year)
        except ValueError as error:
            self.model, self.remark = None, str(error)


class MagneticModel:
    """The field of one date, cheap enough to ask at every magnetometer sample.

    The model is evaluated at the nodes of a fixed grid (0.1 degree, 2 km) and interpolated linearly between them, so the
    answer is a continuous function of the place alone: it neither steps nor depends on where it was asked before.

    Parameters
    ----------
    date : float, datetime.date or datetime.datetime
        Decimal year or date of the flight.
    """

    def __init__(self, date: float | Date | datetime) -> None:
        self.year = decimal_year(date)
        self.name = model_name(date)
        self._node = functools.lru_cache(maxsize=4096)(self._evaluate_node)
        self._cell = functools.lru_cache(maxsize=256)(self._nodes_of_cell)

    def _nodes_of_cell(self, i: int, j: int, k: int) -> list[list[float]]:
        """Field at the eight corners of a cell."""
        corners = itertools.product((i, i + 1), (j, j + 1), (k, k + 1))
        return [self._node(north, east % (360 * _CELLS_PER_DEGREE), up).tolist() for north, east, up in corners]

    def _evaluate_node(self, i: int, j: int, k: int) -> np.ndarray:
        return _evaluate(self.name, self.year, i / _CELLS_PER_DEGREE, j / _CELLS_PER_DEGREE, k * _CELL_HEIGHT)

    def field_n(self, lat: float, lon: float, height: float) -> np.ndarray:
        """Field, tesla, NED, shape (3,), within 0.2 nT of :func:`field_n`; rad, rad, m above the ellipsoid."""
        _check_place(lat, lon, height)
        x, y, z = math.degrees(lat) * _CELLS_PER_DEGREE, math.degrees(lon) * _CELLS_PER_DEGREE, float(height) / _CELL_HEIGHT
        i, j, k = math.floor(x), math.floor(y), math.floor(z)
        weights = itertools.product((1.0 - (x - i), x - i), (1.0 - (y - j), y - j), (1.0 - (z - k), z - k))
        north = east = down = 0.0
        for (wi, wj, wk), node in zip(weights, self._cell(i, j, k), strict=True):
            w = wi * wj * wk
            north, east, down = north + w * node[0], east + w * node[1], down + w * node[2]
        return np.array([north, east, down])

    def declination(self, lat: float, lon: float, height: float) -> float:
        """Declination, rad, east positive."""
        return declination_of(self.field_n(lat, lon, height))


@functools.lru_cache(maxsize=8)
def _model(year: float) -> MagneticModel:
    return MagneticModel(year)
