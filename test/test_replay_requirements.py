"""A flight against approach categories and alert limits: shares, alarms by the navigator's own sigmas, gaps of few satellites."""

import dataclasses
import math

import numpy as np
import pytest
from replay_fakes import FakeSettings, FixFollower
from rich.console import Console

from lowcostnav_ros.base.plain import plain
from lowcostnav_ros.gnss.accuracy import SERVICES
from lowcostnav_ros.replay.metrics import AXES, Errors, ErrorStatistics
from lowcostnav_ros.replay.outages import GAP_NS, GpsGaps
from lowcostnav_ros.replay.requirements import HOLE_NS, LISTED, Coverage, IntegrityMonitor
from lowcostnav_ros.replay.result import NavigatorErrors
from lowcostnav_ros.replay.session import replay_stream
from lowcostnav_ros.replay.tables import accuracy_table, alarm_table, approach_table, exceedance_table, interval_kind, percent
from lowcostnav_ros.report.document import html_table
from lowcostnav_ros.report.terminal import print_table

NS = 1_000_000_000
SOL = SERVICES["SOL"]


def errors_of(t_s, north=0.0, east=0.0, down=0.0, sigma=1.0):
    """Errors at these times with one sigma on all axes."""
    n = len(t_s)
    values = np.full((n, len(AXES)), np.nan)
    values[:, :3] = np.column_stack([np.broadcast_to(v, n) for v in (north, east, down)])
    sigmas = np.full((n, len(AXES)), np.nan)
    sigmas[:, :3] = np.broadcast_to(sigma, n)[:, None]
    return Errors((np.asarray(t_s) * NS).astype(np.int64), values, sigmas, np.full(n, np.nan), np.broadcast_to(sigma, n).astype(float))


def monitored(errors, cuts=1):
    monitor = IntegrityMonitor(SOL)
    for rows in np.array_split(np.arange(len(errors)), cuts):
        monitor.add(errors[rows])
    return plain(monitor.result())


def test_mean_rms_and_shares_of_known_errors():
    statistics = ErrorStatistics()
    statistics.add(errors_of([0, 1], north=[3.0, -3.0], east=[4.0, -4.0], down=[0.0, -12.0]))
    statistics.add(errors_of([2, 3], north=[0.0, math.nan], down=[0.5, 0.0]))
    found = plain(statistics.result())
    assert found["position"]["mean_m"] == pytest.approx({"north": 0.0, "east": 0.0, "up": 11.5 / 3.0})
    assert found["position"]["rms_2d_m"] == pytest.approx(math.sqrt(50.0 / 3.0))
    assert found["position"]["rms_3d_m"] == pytest.approx(math.sqrt((50.0 + 144.25) / 3.0))
    assert found["position_m"]["max"] == pytest.approx(13.0)
    shares = found["approach"]["share_within"]
    assert list(shares) == ["I", "II", "III"]
    assert shares["III"] == pytest.approx({"horizontal": 1 / 3, "vertical": 2 / 3, "both": 1 / 3})
    assert shares["II"] == pytest.approx({"horizontal": 1.0, "vertical": 2 / 3, "both": 2 / 3})
    assert found["approach"]["met_by_95"] == ""


def test_an_attitude_reference_has_no_requirements_to_meet():
    statistics, monitor = ErrorStatistics(), IntegrityMonitor(SOL)
    errors = errors_of([0, 1], north=math.nan)
    statistics.add(errors)
    monitor.add(errors)
    assert {"position", "approach"}.isdisjoint(plain(statistics.result()))
    assert monitor.result() is None


T = np.arange(0.0, 60.0, 0.5)
BEYOND = np.where((T >= 20.0) & (T < 40.0), 15.0, 1.0)


@pytest.mark.parametrize(
    ("alert_from", "verdict", "alarm_s"),
    [(10.0, "warned", 10.0), (20.0, "warned", 20.0), (26.0, "warned", 26.0), (26.5, "missed", 26.5), (90.0, "missed", None)],
)
def test_an_alarm_counts_when_it_comes_within_the_time_to_alert(alert_from, verdict, alarm_s):
    found = monitored(errors_of(T, north=BEYOND, sigma=np.where(alert_from <= T, 3.0, 1.0)))
    assert (found["exceedances"], found[verdict]) == (1, 1)
    (listed,) = found["listed"]
    assert listed == {"start_s": 20.0, "end_s": 39.5, "alarm_due_s": 26.0, "alarm_s": alarm_s, "verdict": verdict}
    assert found["longest_s"] == 19.5
    assert found["beyond_limit_s"] == 20.0
    assert found["beyond_without_alert_s"] == pytest.approx(min(20.0, max(0.0, alert_from - 20.0)))
    assert found["alert_s"] == pytest.approx(max(0.0, 59.5 - alert_from))


def test_a_short_exceedance_is_over_before_its_alarm_is_due():
    found = monitored(errors_of(T, down=np.where(abs(T - 30.0) < 2.0, -25.0, 0.0)))
    assert (found["exceedances"], found["brief"], found["missed"]) == (1, 1, 0)


def test_without_sigmas_nobody_is_warned():
    found = monitored(errors_of(T, north=BEYOND, sigma=math.nan))
    assert (found["missed"], found["alert_s"]) == (1, 0.0)


def test_cutting_the_stream_changes_nothing_and_a_hole_ends_an_exceedance():
    rng = np.random.default_rng(1)
    errors = errors_of(T, north=rng.normal(0.0, 10.0, len(T)), sigma=rng.uniform(1.0, 3.0, len(T)))
    assert monitored(errors) == monitored(errors, cuts=17)
    t = np.concatenate((T, T + 60.0 + HOLE_NS / NS))
    assert monitored(errors_of(t, north=15.0))["exceedances"] == 2
    assert monitored(errors_of(t, north=15.0))["longest_s"] == 59.5


def test_a_flight_of_many_exceedances_lists_few_and_counts_all():
    t = np.arange(0.0, 200.0)
    found = monitored(errors_of(t, north=np.where(t % 2 == 0, 15.0, 0.0)))
    assert (found["exceedances"], len(found["listed"])) == (100, LISTED)


def test_gaussian_errors_pass_their_protection_level_as_seldom_as_it_says():
    """At a risk a simulation can show: the factors of a service of risk 0.02, a hundredth each way."""
    horizontal, vertical = dataclasses.replace(SOL, integrity_risk=0.02).protection_factors()
    errors = np.random.default_rng(3).standard_normal((200_000, 3))
    assert np.mean(np.hypot(errors[:, 0], errors[:, 1]) > horizontal) == pytest.approx(0.01, rel=0.1)
    assert np.mean(np.abs(errors[:, 2]) > vertical) == pytest.approx(0.01, rel=0.1)


def test_coverage_leaves_holes_out():
    coverage = Coverage()
    for part in (np.arange(0.0, 10.0, 0.5), np.arange(30.0, 35.1, 0.5)):
        coverage.add(errors_of(part))
    coverage.add(errors_of([36.0], north=math.nan))
    assert coverage.seconds == pytest.approx(9.5 + 5.0)


def test_fewer_than_four_satellites_are_an_outage_that_says_how_many():
    gaps = GpsGaps()
    for second in range(30):
        gaps.add_epoch(second * NS, 2 + (second == 15) if 10 < second < 20 else 7)
    gaps.close(30 * NS)
    assert gaps.intervals == [(10 * NS + GAP_NS, 20 * NS)]
    assert gaps.satellites == {10 * NS + GAP_NS: 3}
    for second in (31, 32, 33):  # a dip of less than three seconds leaves no trace
        gaps.add_epoch(second * NS, 3 if second == 32 else 6)
    assert list(gaps.satellites) == [10 * NS + GAP_NS]


def test_where_a_receiver_gives_fixes_they_say_when_gps_was_there():
    gaps = GpsGaps()
    for second in range(20):
        if second < 5:
            gaps.add(second * NS)
        gaps.add_epoch(second * NS, 8)
    gaps.close(19 * NS)
    assert gaps.intervals == [(4 * NS + GAP_NS, 19 * NS)]


def test_words_and_numbers_of_the_tables():
    assert [percent(x) for x in (0.0, 1e-5, 0.5, 0.99999, 1.0)] == ["0", "0.1", "50", "99.9", "100"]
    assert [interval_kind("without GPS", n) for n in (None, 1, 3)] == ["without GPS", "1 satellite", "3 satellites"]
    statistics, monitor, errors = ErrorStatistics(), IntegrityMonitor(SOL), errors_of(T, north=BEYOND, sigma=3.0)
    statistics.add(errors)
    monitor.add(errors)
    flown = NavigatorErrors(whole=statistics.result(), services={"SOL": monitor.result()}, position_present_s=59.5)
    (navigator,) = replay_stream([], {"ins_gps": FixFollower(FakeSettings())}).navigators.values()
    result = dataclasses.replace(
        replay_stream([], {}), duration_s=119.0, navigators={"ins_gps": dataclasses.replace(navigator, errors=flown)}
    )
    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    for table in (approach_table(result), alarm_table(result)):
        print_table(table, console)
    text = console.export_text()
    assert next(line.split()[:3] for line in text.splitlines() if "flight" in line) == ["ins_gps", "flight", "50"]
    assert "SOL" in text and max(map(len, text.splitlines())) <= 100
    page = "".join(html_table(make(result)) for make in (accuracy_table, approach_table, alarm_table, exceedance_table))
    assert "warned in time" in page and "category III: 4.1 m, 0.6 m" in page and "3D RMS" in page
