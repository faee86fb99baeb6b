"""Satellites of an almanac at a date: where they are, which are left out, and what dates are too far; a day's plan of them."""

import math

import numpy as np
import pytest
from rinex_text import TOE, ephemerides, yuma_text
from sensors_truth import flat, steady_truth

from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss import gps_time as gt
from lowcostnav_ros.gnss.almanac_constellation import almanac_from_yuma
from lowcostnav_ros.gnss.constellation import constellation_named, gps_24, together
from lowcostnav_ros.gnss.ephemeris import satellite_state
from lowcostnav_ros.gnss.sky_plan import plan_sky
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator, GnssRawSimulatorSettings
from lowcostnav_ros.simulation.equipment import build

SATELLITES = ephemerides()
ALMANAC = almanac_from_yuma(yuma_text(SATELLITES), "gps.alm")


def test_satellites_stand_where_their_orbits_put_them():
    for after_s in (0.0, 5400.0, 8.0 * 86400.0):
        gps = TOE + round(after_s * gt.SECOND)
        sky = ALMANAC.constellation(gps, t_s=100.0)
        position, velocity = sky.states(107.0)
        for k, one in enumerate(SATELLITES):
            state = satellite_state(one, gps + 7 * gt.SECOND)
            assert position[k] == pytest.approx(state.position_e, abs=2.0)  # the file has ten digits
            assert velocity[k] == pytest.approx(state.velocity_e, abs=1e-3)
    assert ALMANAC.constellation(TOE).states(0.0)[0][:24] == pytest.approx(gps_24().states(0.0)[0], abs=2.0)


def test_each_satellite_may_have_a_time_of_its_own():
    sky = ALMANAC.constellation(TOE)
    times = np.arange(len(sky), dtype=float)
    assert sky.states(times)[0][5] == pytest.approx(sky.states(5.0)[0][5])
    both = together(sky, constellation_named("galileo"))
    assert len(both) == 59 and both.system.tolist() == ["G"] * 32 + ["E"] * 27
    assert both.states(np.full(59, 5.0))[0] == pytest.approx(both.states(5.0)[0])
    assert both.states(5.0)[0][32:] == pytest.approx(constellation_named("galileo").states(5.0)[0])


def test_what_is_left_out_is_named_and_counted():
    text = yuma_text(ephemerides(unhealthy=(4, 22)))
    text += "\n" + yuma_text(SATELLITES[:1]) + "\n" + yuma_text(SATELLITES[1:2]).replace("02\n", "193\n", 1).replace("PRN-02", "PRN-193")
    text += "\n" + yuma_text(SATELLITES[2:3]).replace("Mean Anom", "Mean Something")
    almanac = almanac_from_yuma(text, "gps.alm")
    assert sorted(one.sat_id for one in almanac.satellites) == [k for k in range(1, 33) if k not in (4, 22)]
    assert almanac.notes() == [
        "gps.alm: 2 unhealthy satellites left out (G04, G22).",
        "gps.alm: 1 x earlier record of a satellite left out.",
        "gps.alm: 1 x incomplete record left out.",
        "gps.alm: 1 x number of no GPS satellite left out.",
    ]


def test_weeks_are_those_nearest_to_the_date_and_half_a_year_is_the_limit():
    later = TOE + 20 * gt.WEEK_NS
    assert "week 292 is taken for 1316 (2005-04-02), the nearest, 140 days before the start" in ALMANAC.dated(later)
    rolled = TOE + 1024 * gt.WEEK_NS - 3 * gt.WEEK_NS
    assert "week 292 is taken for 2340 (2024-11-16), the nearest, 21 days after the start" in ALMANAC.dated(rolled)
    assert np.all(np.isfinite(ALMANAC.constellation(rolled).states(0.0)[0]))
    with pytest.raises(GnssError, match=r"of 2005-04-02 \(weeks are known modulo 1024\), 27 weeks from 2005-10-08; give one of within 26"):
        ALMANAC.constellation(TOE + 27 * gt.WEEK_NS)


def test_an_almanac_of_the_ill_alone_is_refused():
    with pytest.raises(GnssError, match="x.alm has no healthy GPS satellite"):
        almanac_from_yuma(yuma_text(ephemerides(unhealthy=range(1, 33))), "x.alm")
    with pytest.raises(GnssError, match="x.alm: No usable satellite was found"):
        almanac_from_yuma("hello", "x.alm")


def simulator(tmp_path, **settings):
    path = tmp_path / "gps.alm"
    path.write_text(yuma_text(ephemerides(unhealthy=(4,))))
    return build("gnss", from_mapping(GnssRawSimulatorSettings, {"almanac_file": str(path), **settings}))


def truth_of(gps, duration_s=2.0):
    truth = steady_truth(duration_s, rate_hz=10)
    truth.stamps_ns[:] += gt.unix_ns(gps) - truth.stamps_ns[0]
    return truth


def test_a_simulated_receiver_sees_the_almanacs_satellites_at_the_stamps_date(tmp_path):
    truth = truth_of(TOE + 3600 * gt.SECOND)
    made = simulator(tmp_path)
    epochs = made.simulate(truth)
    assert any("G04" in note for note in made.notes) and any("taken for 1316" in note for note in made.notes)
    for epoch in epochs:
        assert 4 not in epoch.sat_id
        for k, sat_id in enumerate(epoch.sat_id):
            state = satellite_state(SATELLITES[sat_id - 1], gt.gps_ns(epoch.stamp_ns))
            assert epoch.sat_pos_e[k] == pytest.approx(state.position_e, abs=2.0)
    again = simulator(tmp_path)
    assert flat([e for cut in (truth[:7], truth[7:]) for e in again.simulate(cut)]) == flat(epochs)
    both = simulator(tmp_path, constellation="gps_galileo", light_time=True).simulate(truth)
    assert {"G", "E"} == set(both[0].system)


def test_an_almanac_that_cannot_serve_is_refused_with_a_sentence(tmp_path):
    late = simulator(tmp_path)
    for _ in range(2):  # a node goes on after the first refusal
        with pytest.raises(SettingsError, match="26 weeks, or another date"):
            late.simulate(truth_of(TOE + 100 * gt.WEEK_NS))
    undated = steady_truth(1.0, rate_hz=10)
    undated.stamps_ns[:] -= undated.stamps_ns[0]
    with pytest.raises(SettingsError, match="before GPS time began"):
        simulator(tmp_path).simulate(undated)
    with pytest.raises(SettingsError, match="gone.alm does not exist"):
        build("gnss", GnssRawSimulatorSettings(almanac_file="gone.alm"))
    (tmp_path / "no.alm").write_text("nothing")
    with pytest.raises(SettingsError, match="no.alm: No usable satellite"):
        build("gnss", GnssRawSimulatorSettings(almanac_file=str(tmp_path / "no.alm")))
    with pytest.raises(SettingsError, match="set 'constellation' to gps or gps_galileo"):
        GnssRawSimulatorSettings(almanac_file="gps.alm", constellation="galileo")


def test_without_an_almanac_nothing_is_noted():
    made = GnssRawSimulator(GnssRawSimulatorSettings())
    made.simulate(steady_truth(1.0, rate_hz=10))
    assert made.notes == []


def test_the_plan_counts_what_is_above_the_mask_and_finds_its_windows():
    place, mask = (math.radians(38.7), math.radians(-9.1), 500.0), math.radians(5.0)

    def lowest(azimuth):
        return np.full(np.shape(azimuth), mask)

    plan = plan_sky(gps_24(), place, lowest, hours=24.0, step_s=600.0)
    assert len(plan.time_s) == 145 and plan.counts[0] == 8 and plan.counts[18] == 9  # the thesis's skies at 0 and 10800 s
    assert np.array_equal(plan.visible, plan.elevation >= mask)
    limit = float(np.sort(plan.column("pdop"))[-10])
    windows = plan.windows(limit)
    assert sum(w.end_s - w.start_s for w in windows) == 600.0 * np.count_nonzero(plan.column("pdop") > limit)
    assert all(a.end_s - a.start_s >= b.end_s - b.start_s for a, b in zip(windows, windows[1:], strict=False))
    assert plan.windows(math.inf) == []
    (none,) = plan_sky(gps_24(), place, lambda a: np.full(np.shape(a), 1.5), hours=2.0).windows(100.0)
    assert (none.start_s, none.end_s, none.worst_pdop) == (0.0, 7200.0, math.inf) and none.fewest < 4
