"""The magnetic field against the publisher's own test values."""

import datetime
import math
import os
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.physics import geomagnetism as mag

DATA = Path(os.environ.get("LOWCOSTNAV_DATA", Path(__file__).resolve().parents[1] / ".." / "shared" / "data")) / "magnetics"

PUBLISHED = [  # year, km, lat deg, lon deg, declination deg, inclination deg, H X Y Z F in nT
    (2020.0, 28, 89, -121, -112.41, 88.46, 1510.0, -575.7, -1396.0, 56082.3, 56102.7),
    (2020.0, 65, 43, 93, 0.71, 63.87, 24377.2, 24375.3, 303.2, 49691.4, 55348.7),
    (2020.0, 39, -59, -8, -15.79, -58.82, 14933.4, 14369.9, -4063.3, -24679.0, 28845.4),
    (2020.0, 3, -50, -103, 28.10, -55.01, 22315.5, 19684.4, 10512.2, -31883.6, 38917.2),
    (2025.0, 51, -33, 109, -5.49, -67.50, 21838.0, 21737.8, -2090.3, -52710.0, 57054.8),
    (2025.0, 66, 14, 143, -0.19, 12.82, 35003.6, 35003.4, -116.6, 7966.3, 35898.7),
    (2025.5, 6, -36, -137, 20.28, -52.11, 25353.2, 23781.9, 8786.7, -32577.5, 41280.5),
    (2025.5, 63, 26, 81, 0.51, 41.07, 34804.0, 34802.6, 308.4, 30332.1, 46166.6),
]


def check(row):
    year, km, lat_deg, lon_deg, declination, inclination, horizontal, x, y, z, total = row[:11]
    place = math.radians(lat_deg), math.radians(lon_deg), 1e3 * km, year
    field = mag.field_n(*place)
    np.testing.assert_allclose(field, np.array([x, y, z]) * 1e-9, atol=0.06e-9)
    assert np.linalg.norm(field) == pytest.approx(total * 1e-9, abs=0.06e-9)
    assert math.degrees(mag.declination(*place)) == pytest.approx(declination, abs=0.01)
    assert math.degrees(mag.inclination(*place)) == pytest.approx(inclination, abs=0.01)
    assert mag.horizontal(*place) == pytest.approx(horizontal * 1e-9, abs=0.06e-9)


@pytest.mark.parametrize("row", PUBLISHED)
def test_published_values(row):
    check(row)


@pytest.mark.data
@pytest.mark.parametrize("year", [2020, 2025])
def test_every_published_value(year):
    path = DATA / f"WMM{year}_TEST_VALUES.txt"
    if not path.exists():
        pytest.skip(f"The publisher's table {path.name} is not here; set LOWCOSTNAV_DATA to the directory that holds magnetics/.")
    rows = np.loadtxt(path, comments="#")
    assert len(rows) > 10
    for row in rows:
        if row[0] < year + 5:  # the closing instant of a generation belongs to the next
            check(row)


@pytest.mark.parametrize(
    ("date", "name"),
    [(2010.0, "WMM_2010"), (2019.99, "WMM_2015v2"), (2020.0, "WMM_2020"), (datetime.date(2024, 12, 31), "WMM_2020")]
    + [(datetime.datetime(2025, 1, 1, tzinfo=datetime.UTC), "WMM_2025"), (2030.0, "WMM_2025")],
)
def test_the_generation_follows_the_date(date, name):
    assert mag.model_name(date) == name
    assert np.all(np.isfinite(mag.field_n(0.7, 0.1, 0.0, date)))


@pytest.mark.parametrize("date", [2009.9, 2030.1, 1998.5])
def test_a_date_outside_every_model_is_refused_with_what_to_do(date):
    with pytest.raises(ValueError, match="date of the flight or set the declination"):
        mag.field_n(0.7, 0.1, 0.0, date)


def test_degrees_and_wild_heights_are_refused():
    with pytest.raises(ValueError, match="radians"):
        mag.field_n(45.0, 9.0, 0.0, 2026.0)
    with pytest.raises(ValueError, match="850 km"):
        mag.MagneticModel(2026.0).field_n(0.7, 0.1, -2000.0)


def test_decimal_year():
    assert mag.decimal_year(datetime.date(2020, 7, 2)) == 2020.5
    assert mag.decimal_year(datetime.datetime(2025, 7, 2, 12)) == 2025.5
    assert mag.decimal_year(2021.25) == 2021.25


def test_interpolated_field_is_within_a_fifth_of_a_nanotesla_everywhere_flown():
    rng, model = np.random.default_rng(0), mag.MagneticModel(2026.5)
    for _ in range(40):
        place = rng.uniform(-1.4, 1.4), rng.uniform(-math.pi, math.pi), rng.uniform(-500.0, 15_000.0)
        np.testing.assert_allclose(model.field_n(*place), mag.field_n(*place, 2026.5), atol=2e-10)


def test_interpolated_field_does_not_step_nor_remember():
    """Crossing a cell border, the date line and asking in another order change nothing beyond the field's own slope."""
    model = mag.MagneticModel(2026.5)
    border = math.radians(47.3)
    jump = model.field_n(border + 1e-12, 0.2, 2000.0) - model.field_n(border - 1e-12, 0.2, 2000.0 - 1e-6)
    assert np.abs(jump).max() < 1e-13
    np.testing.assert_allclose(model.field_n(0.3, math.pi, 500.0), model.field_n(0.3, -math.pi, 500.0), rtol=1e-12)
    again = mag.MagneticModel(2026.5)
    again.field_n(0.8261, 0.21, 100.0)
    np.testing.assert_array_equal(again.field_n(border, 0.2, 2000.0), model.field_n(border, 0.2, 2000.0))


def test_the_pole_gives_numbers():
    field = mag.MagneticModel(2026.5).field_n(math.pi / 2, 0.4, 1000.0)
    np.testing.assert_allclose(field, mag.field_n(math.pi / 2, 0.4, 1000.0, 2026.5), atol=2e-9)


def test_compass_error_sign():
    """In Lisbon the compass points west of true north (about -1.5 degrees), in Seattle east (about +15)."""
    assert -3.0 < math.degrees(mag.declination(math.radians(38.7), math.radians(-9.1), 0.0, 2025.5)) < -0.5
    assert 14.0 < math.degrees(mag.declination(math.radians(47.6205), math.radians(-122.3493), 0.0, 2025.25)) < 16.0
