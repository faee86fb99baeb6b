"""Ground transmitters: the table, delays against closed forms and published values, dilution, positions from code, the plan."""

import math

import numpy as np
import pytest

from lowcostnav_ros.base.units import kelvin
from lowcostnav_ros.catalogue.equipment import load_stations
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.air_column import AirColumn
from lowcostnav_ros.radionav.network import NoFix, best_next, dilution, fix_from_code, places_of, thesis_network
from lowcostnav_ros.radionav.stations import StationError, stations_from_text
from lowcostnav_ros.radionav.troposphere import BOUSKA_RAQUET, HOPFIELD, INDEX, NONE, air_of, path_delays, quartic_mean, raquet_delay
from lowcostnav_ros.radionav.weather import Weather, standard_weather
from lowcostnav_ros.sensors.airframe import AirframeSettings, shadow_db, slips_per_s, turns_per_s

DAY = Weather(87500.0, kelvin(10.0), 0.3)
HEADER = "ident,name,lat_deg,lon_deg,height_m,kind,pressure_hpa,temperature_c,humidity_pct,nearest_m,farthest_m\n"
GOOD = [
    "100,A,32.9,-106.1,1250.0,PSEUDOLITE,875,10,30,200,50000",
    "200,B,32.8,-106.2,1260.0,PSEUDOLITE,,,,,",
    "300,C,32.9,-106.3,1240.0,PSEUDOLITE,,,,,",
]


def delay(model, above, range_m):
    return float(path_delays(model, air_of(DAY, 0.0)[None, :], above, np.array([range_m]))[0])


@pytest.mark.parametrize(
    ("range_m", "above", "closed", "index"),
    [(5000.0, 3000.0, 1.08884, 1.28734), (20000.0, 6000.0, 3.72340, 5.14937), (30000.0, 7600.0, 5.15457, 7.72405)],
)
def test_delays_of_a_day(range_m, above, closed, index):
    assert (DAY.dry(), DAY.wet(), DAY.index()) == pytest.approx((239.802, 17.345, 257.468), abs=2e-3)
    air = air_of(DAY, 0.0)
    exact = 1e-6 * range_m * sum(N * quartic_mean(0.0, above, top) for N, top in ((air[0], air[2]), (air[1], air[3])))
    assert exact == pytest.approx(closed, abs=2e-5)
    assert delay(HOPFIELD, above, range_m) == pytest.approx(closed, abs=6e-4)
    assert delay(INDEX, above, range_m) == pytest.approx(index, abs=2e-5) and delay(NONE, above, range_m) == 0.0


def test_raquet_against_numerical_integration_and_level_ends():
    assert raquet_delay(257.147, 42700.0, 1250.0, 1350.0, 5900.0, 20000.0) == pytest.approx(3.83299, abs=1e-5)
    heights = (np.arange(200000) + 0.5) * 0.0295 + 100.0
    integral = np.mean(((42700.0 - 1250.0 - heights) / (42700.0 - 1250.0)) ** 4)
    assert raquet_delay(257.147, 42700.0, 1250.0, 1350.0, 5900.0, 20000.0) == pytest.approx(1e-6 * 257.147 * integral * 20000.0, rel=1e-7)
    for model in (HOPFIELD, BOUSKA_RAQUET):  # nearly level ends agree with level ones
        assert delay(model, 0.9, 1000.0) == pytest.approx(delay(model, 1.1, 1000.0), rel=2e-5)


def test_the_true_air_is_near_the_models_and_none_of_them():
    air = AirColumn(DAY, 0.0, 5.5e-3, 1800.0)
    true = float(air.delays(np.array([0.0]), 4300.0, np.array([12000.0]))[0])
    assert 0.002 < abs(delay(HOPFIELD, 4300.0, 12000.0) - true) < 0.1
    assert air.at(0.0).pressure_pa == DAY.pressure_pa and air.at(0.0).humidity == pytest.approx(0.3)
    level = float(air.delays(np.array([0.0]), 0.0, np.array([10.0]))[0])
    assert level == pytest.approx(1e-5 * float(air.refractivity(np.array(0.0))), rel=1e-6)


@pytest.mark.parametrize(
    ("weather", "why"),
    [
        (Weather(65600.0, kelvin(10.0), 0.3), "millimetres of mercury"),
        (Weather(87500.0, kelvin(283.0), 0.3), "kelvin instead of degC"),
        (Weather(87500.0, kelvin(10.0), 30.0), "relative humidity of 3000 %"),
        (Weather(math.nan, kelvin(10.0), 0.3), "pressure of nan"),
        (DAY, ""),
    ],
)
def test_absurd_weather(weather, why):
    found = weather.absurdity(1250.0)
    assert why in found and bool(found) == bool(why)
    assert not standard_weather(1250.0).absurdity(1250.0)


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ("400,D,-106.2,32.9,1250,PSEUDOLITE,,,,,", "lat_deg of -106.2 must lie between -90 and 90"),
        ("400,D,42.9,-16.1,1250,PSEUDOLITE,,,,,", "Station 400 is more than 300 km from all others: check its coordinates"),
        ("400,D,32.85,-106.2,-2300,PSEUDOLITE,,,,,", "height_m of -2300 must lie between"),
        ("400,D,32.85,-106.2,4100,PSEUDOLITE,,,,,", "Station 400 is 2850 m above the others; check its height"),
        ("100,D,32.85,-106.2,1250,PSEUDOLITE,,,,,", "Station 100 is listed twice"),
        ("400,D,32.9,-106.1,1250.5,PSEUDOLITE,,,,,", "Stations 100 and 400 are 1 m apart"),
        ("400,D,32.85,-106.2,1250,PSEUDOLITE,656,10,30,,", "millimetres of mercury instead of hPa"),
        ("400,D,32.85,-106.2,1250,PSEUDOLITE,875,,,,", "together, or none of them"),
        ("400,D,32.85,-106.2,1250,PSEUDOLITE,,,,500,200", "nearest_m of 500 is not below farthest_m of 200"),
        ("400,D,32.85,-106.2,1250,DME,,,,,", "a DME needs the column elevation_ft"),
    ],
)
def test_a_table_that_cannot_be_right_is_refused_in_a_sentence(row, sentence):
    assert len(stations_from_text(HEADER + "\n".join(GOOD))) == 3
    with pytest.raises(StationError) as told:
        stations_from_text(HEADER + "\n".join([*GOOD, row]))
    assert sentence in str(told.value)


def test_swapped_coordinates_are_named():
    rows = [r.replace("-106.", "46.").replace("32.", "12.") for r in GOOD]
    with pytest.raises(StationError, match="latitude and longitude look swapped"):
        stations_from_text(HEADER + "\n".join([*rows, "400,D,46.2,12.9,1250,PSEUDOLITE,,,,,"]))


def test_dilution_of_the_network_and_code_alone():
    network = thesis_network()
    here = 12000.0 * np.array([0.0, 0.0, -0.358])
    found = dilution(here, network)
    assert (found.hdop, found.pdop) == pytest.approx((0.620, 1.420), abs=1e-3)
    assert math.isinf(dilution(here, network[:3]).pdop) and math.isfinite(dilution(here, network[:3], clock=False).pdop)
    code = np.linalg.norm(network - here, axis=1) + 321.0
    fix = fix_from_code(network, code, np.array([0.0, 0.0, -8000.0]))
    assert fix.place == pytest.approx(here, abs=1e-3) and fix.clock_m == pytest.approx(321.0, abs=1e-3)
    assert math.sqrt(fix.covariance[:3, :3].trace()) == pytest.approx(found.pdop, rel=1e-6)
    with pytest.raises(NoFix, match="3 transmitters; a position takes 4"):
        fix_from_code(network[:3], code[:3], here)
    table = load_stations("pseudolites_range.csv")
    assert places_of(list(table), LocalFrame(math.radians(32.95), math.radians(-106.15), 1250.0)) == pytest.approx(network, abs=2e-3)


def test_the_next_transmitter_goes_where_there_are_none():
    network = thesis_network()[[0, 1, 2, 3, 13]]  # all in the north-east
    above = np.array([[n, e, -4000.0] for n in (-8000.0, 8000.0) for e in (-8000.0, 8000.0)])
    sites = np.array([[9000.0, 9000.0, 0.0], [-9000.0, -9000.0, 0.0], [0.0, 100.0, 0.0]])
    assert best_next(above, network, sites)[0] == 1


def test_the_plan_on_the_terminal_and_in_a_folder(tmp_path, capsys):
    assert main(["pseudolite", "plan", "--height-m", "5550", "-o", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "The next transmitter helps most at" in told and {p.name for p in tmp_path.iterdir()} == {"plan.html", "plan.json"}
    page = (tmp_path / "plan.html").read_text()
    assert page.count('class="map"') == 3 and "The next transmitter helps most at" in page and "PDOP at 5550 m" in page
    assert main(["pseudolite", "plan", "--height-m", "5550", "--pdop", "2"]) == 1
    assert main(["pseudolite", "plan", "--stations", "dme_stations_bay_area.csv", "--height-m", "5550"]) == 2
    assert "holds no station of kind PSEUDOLITE" in capsys.readouterr().err


def test_an_airframe_shadows_and_in_the_shadow_carriers_are_turned_round():
    sight_b = np.array([[0.0, np.cos(a), np.sin(a)] for a in np.radians([-9.0, 0.0, 30.0])])
    assert shadow_db(np.array([-0.8, 0.0, 1.0]), 0.5, 1.0) == pytest.approx([0.0, 6.03, 13.93], abs=0.01)  # ITU-R P.526, v = 0 and 1
    belly, roof = (slips_per_s(AirframeSettings(antenna), sight_b, 0.123) for antenna in ("belly", "roof"))
    assert belly[0] > 1.0 and belly[1] > 1e-4 and belly[2] < 1e-6 and roof[2] > belly[0]
    assert slips_per_s(AirframeSettings(), sight_b, 0.123) is None
    # The rate of Rice: a carrier in noise of a flat spectrum, its crossings of the negative axis counted.
    seconds, rate, band, rng = 400, 1000, 18.0, np.random.default_rng(3)
    f = np.fft.fftfreq(seconds * rate, 1.0 / rate)
    noise = np.fft.ifft(np.where(np.abs(f) < band, rng.standard_normal((2, f.size)).T @ np.array([1.0, 1j]), 0.0))
    for ratio in (0.5, 1.0, 2.0):
        phase = np.angle(np.sqrt(ratio) + noise / np.sqrt(np.mean(np.abs(noise) ** 2)))
        crossed = np.count_nonzero(np.abs(np.diff(phase)) > np.pi) / seconds
        assert crossed == pytest.approx(turns_per_s(np.array([ratio]), band)[0], rel=0.1)
