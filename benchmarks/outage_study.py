"""What one aid buys in a GPS outage: the same flight and the same outage, flown by ``ins_gps`` with it and without.

An aircraft near Livermore turns for two minutes, so that GPS shows the inertial navigator its heading, flies straight for one and then
loses GPS for five minutes with two turns in them.  A road vehicle drives likewise; it points where it goes.  The IMU is of automotive
grade, GPS 2 m at 1 Hz, every other sensor as its simulator's defaults have it, and the filter is told what these are.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import complete_settings, make_navigator
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.replay.evaluation import Truth, truth_columns
from lowcostnav_ros.replay.session import first_stamp
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation
from lowcostnav_ros.studies.outages.result import End
from lowcostnav_ros.studies.outages.study import Plan, stream_outages

LOST_S = 180.0
"""GPS is lost this long after the start and stays away."""
ENDS_S = (60.0, 120.0, 300.0)
"""Lengths of outage looked at."""
STATIONS = "dme_stations_bay_area.csv"
_FLIGHT = """
name: outage
sensors: [{sensors}]
truth:
  kind: segments
  rate_hz: 50
  duration_s: 482.0
  incidence_deg: {incidence}
  mission: [straight duration_s=20, "s_turns count=6 by_deg={turn} bank_deg={bank}", straight duration_s=100,
    turn by_deg=60 bank_deg={bank}, straight duration_s=100, turn by_deg=-90 bank_deg={bank}, straight duration_s=600]
  start: {{height_m: 900.0, heading_deg: 250.0, airspeed_mps: {speed}}}
  wind: {wind}
imu: {{profile: automotive, rate_hz: 50.0}}
magnetometer: {{rate_hz: 10.0}}
air_data: {{rate_hz: 5.0}}
gps: {{rate_hz: 1.0}}
"""
FLIGHTS = {
    "aircraft": _FLIGHT.format(
        sensors="imu, magnetometer, air_data, gps, vor", incidence=2.0, turn=90, bank=25, speed=50.0,
        wind="{north_mps: -4.0, east_mps: 6.0, variation_sigma_mps: 1.0, turbulence_sigma_mps: 0.5}",
    ),
    "road": _FLIGHT.format(sensors="imu, gps", incidence=0.0, turn=90, bank=4, speed=20.0, wind="{}"),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One choice of aids: the flight it is tried on and the settings that differ from the bare navigator's."""

    flight: str
    settings: Mapping[str, object]


_AIRSPEED = {"airdata.enabled": True, "airdata.bias_mps": 2.6}
_VOR = {"vor.enabled": True, "vor.stations_file": STATIONS}
CASES = {
    "none": Case("aircraft", {}),
    "barometer": Case("aircraft", {"baro.enabled": True}),
    "compass": Case("aircraft", {"magnetic.enabled": True}),
    "vor": Case("aircraft", _VOR),
    "airspeed": Case("aircraft", {**_AIRSPEED, "airdata.sideslip_sigma_deg": 30.0}),  # so wide that it says nothing
    "airspeed_and_zero_sideslip": Case("aircraft", _AIRSPEED),
    "airspeed_zero_sideslip_and_compass": Case("aircraft", {**_AIRSPEED, "magnetic.enabled": True}),
    "airspeed_zero_sideslip_and_vor": Case("aircraft", {**_AIRSPEED, **_VOR}),
    "all": Case("aircraft", {"baro.enabled": True, "magnetic.enabled": True, **_AIRSPEED, **_VOR}),
    "road_none": Case("road", {}),
    "wheels": Case("road", {"wheels.enabled": True}),
}
"""Aids by name; the first of each flight is the navigator without any."""
BARE = {"aircraft": "none", "road": "road_none"}


def fly(flight: str, seed: int) -> tuple[TruthBlock, list[Measurement]]:
    """Fly one of :data:`FLIGHTS`: the whole truth and all measurements in order of availability."""
    return Simulation(scenario_from_text(FLIGHTS[flight], flight, seed=seed)).whole()


def navigator(case: Case) -> Any:
    """Return the navigator with the aids of a case and no others."""
    bare = {"imu.profile": "automotive", "baro.enabled": False, "magnetic.enabled": False, "airdata.enabled": False}
    return make_navigator(complete_settings(InsGpsSettings, {**bare, **case.settings}), InsGps)


def outages_at_once(names: list[str], seed: int) -> dict[str, tuple[End, ...]]:
    """Return, for each of the named :data:`CASES`, the errors at :data:`ENDS_S`; cases of one flight hear the very same measurements."""
    flown: dict[str, tuple[TruthBlock, list[Measurement]]] = {}
    found = {}
    for name in names:
        case = CASES[name]
        if case.flight not in flown:
            flown[case.flight] = fly(case.flight, seed)
        found[name] = ends_of(case, *flown[case.flight])
    return found


def ends_of(case: Case, truth: TruthBlock, heard: list[Measurement]) -> tuple[End, ...]:
    """Return the errors at :data:`ENDS_S` of one case on one flight."""
    known = Truth()
    known.states.add(truth_columns(truth))
    lost_s = LOST_S + 1e-9 * float(truth.stamps_ns[0] - first_stamp(heard[0]))  # the flight begins with its truth
    plan = Plan(ENDS_S, 1000.0, lost_s)
    return stream_outages(heard, {"ins_gps": navigator(case)}, plan, ("gps/fix", "gps/vel"), known)["ins_gps"][0].ends
