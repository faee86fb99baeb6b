"""RINEX readers against files written here column by column from the format's tables, good and bad."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rinex_text import INTERVAL, TYPES_2, d19, epoch_2, head, record, start

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss import gps_time as gt
from lowcostnav_ros.gnss.ephemeris import Ephemeris
from lowcostnav_ros.gnss.rinex_nav import parse_navigation
from lowcostnav_ros.gnss.rinex_obs import parse_observations
from lowcostnav_ros.gnss.signals import L1_WAVELENGTH_M

TOE = gt.from_week(1316, 518400.0 + 7200.0)
EPHEMERIS = Ephemeris(
    "G", 3, TOE, TOE, 5153.730749, 6.735e-3, 2.4711, 0.5355, 0.9293, 0.6055, -8.58e-9, 2.1e-10, 5.3767e-9,
    1.0e-6, 7.6e-6, 230.0, 19.7, -1e-7, -6.5e-8, 9.7e-5, 3.1e-12, 0.0, -3.3e-9, 2.0, True, 83, 7200.0,
)  # fmt: skip


def same(a, b):
    for name in a.__dataclass_fields__:
        x, y = getattr(a, name), getattr(b, name)
        assert x == (pytest.approx(y, rel=1e-11) if isinstance(y, float) else y), name


@pytest.mark.parametrize("version", [2.0, 2.11, 3.02, 3.05])
@given(*(st.integers(-(10**9), 10**9) for _ in range(3)), st.integers(1, 32))
def test_navigation_record_there_and_back(version, eccentricity, anomaly, af0, sat_id):
    eccentricity, anomaly, af0 = abs(eccentricity) * 5e-11, anomaly * 3.1e-9, af0 * 1e-12  # the format has two digits of exponent
    e = dataclasses.replace(EPHEMERIS, eccentricity=eccentricity, mean_anomaly=anomaly, af0=af0, sat_id=sat_id)
    read = parse_navigation("\n".join(start(version, "N") + record(e, version)))
    same(read.store.find("G", sat_id, TOE)[0], e)
    assert not read.rejected


def test_header_of_both_versions():
    two = start(
        2.10, "N",
        head("ION ALPHA", "  " + "".join(f"{v:12.4E}".replace("E", "D") for v in (1.118e-8, 1.49e-8, -5.96e-8, -5.96e-8))),
        head("ION BETA", "  " + "".join(f"{v:12.4E}".replace("E", "D") for v in (88060.0, 16380.0, -196600.0, -131100.0))),
        head("LEAP SECONDS", f"{13:6d}"),
    )  # fmt: skip
    three = start(
        3.03, "N",
        head("IONOSPHERIC CORR", "GPSA " + "".join(f"{v:12.4E}" for v in (1.118e-8, 1.49e-8, -5.96e-8, -5.96e-8))),
        head("IONOSPHERIC CORR", "GPSB " + "".join(f"{v:12.4E}" for v in (88060.0, 16380.0, -196600.0, -131100.0))),
        head("LEAP SECONDS", f"{14:6d}"),
    )  # fmt: skip
    read = [parse_navigation("\n".join(h + record(EPHEMERIS, v))) for h, v in ((two, 2), (three, 3))]
    assert read[0].klobuchar == read[1].klobuchar
    assert read[0].klobuchar.alpha == (1.118e-8, 1.49e-8, -5.96e-8, -5.96e-8)
    assert read[0].remarks == []
    assert "announce 14 leap seconds where the table of this program has 13" in read[1].remarks[0]
    assert parse_navigation("\n".join(start(2.1, "N") + record(EPHEMERIS, 2))).klobuchar is None


def test_records_that_cannot_be_used_are_counted_by_reason():
    galileo = dataclasses.replace(EPHEMERIS, system="E", sat_id=11, sqrt_a=5440.6, valid_s=14400.0)
    glonass = ["R05 2005 04 02 00 15 00" + d19(1e-5) * 3, *["    " + d19(1.0) * 4] * 3]
    blank = record(dataclasses.replace(EPHEMERIS, sat_id=7), 3)
    blank[2] = blank[2][:23] + " " * 19 + blank[2][42:]
    cut = record(dataclasses.replace(EPHEMERIS, sat_id=8), 3)[:5]
    no_date = record(dataclasses.replace(EPHEMERIS, sat_id=9), 3)
    no_date[0] = no_date[0].replace("2005 04 02", "2005 14 02")
    records = [
        record(EPHEMERIS, 3), record(EPHEMERIS, 3), glonass, blank, cut, no_date,
        record(galileo, 3, source=513.0), record(dataclasses.replace(galileo, sat_id=12), 3, source=258.0),
        record(dataclasses.replace(galileo, sat_id=13), 3, source=513.0, ura=-1.0),
        record(dataclasses.replace(EPHEMERIS, sat_id=10), 3, health=63.0),
        record(dataclasses.replace(EPHEMERIS, sat_id=14), 3, week=1316 - 1024),
    ]  # fmt: skip
    read = parse_navigation("\n".join(start(3.04, "N") + sum(records, [])))
    assert read.rejected == {
        "repeated ephemeris": 1, "GLONASS is not used": 1, "incomplete record": 2, "impossible record": 1,
        "Galileo F/NAV is not used": 1, "no accuracy stated": 1, "week number corrected from the date": 1,
    }  # fmt: skip
    assert read.store.satellites() == [("E", 11), ("G", 3), ("G", 10), ("G", 14)]
    assert read.store.find("E", 11, TOE)[0].group_delay_s == pytest.approx(-3.3e-9)
    assert read.store.find("G", 10, TOE) == (None, "satellite unhealthy")
    assert read.store.find("G", 14, TOE)[0].toe_ns == TOE


def test_blank_fields_that_do_not_matter_and_headers_that_are_damaged():
    lines = record(EPHEMERIS, 2)
    lines[5] = lines[5][: 3 + 19]  # neither codes on L2 nor week
    lines[6] = lines[6][: 3 + 57].ljust(3 + 76)
    broken = start(2.1, "N", head("LEAP SECONDS", "  soon"), head("ION ALPHA", "  1.0"), head("ION BETA", "  1.0"))
    read = parse_navigation("\n".join(broken + lines))
    assert read.store.find("G", 3, TOE)[0].toe_ns == TOE
    assert read.rejected == {"week number corrected from the date": 1}
    assert read.klobuchar is None and read.remarks == []


def test_an_orbit_uploaded_just_before_the_week_ends_belongs_to_the_next_week():
    late = dataclasses.replace(EPHEMERIS, toe_ns=gt.from_week(1317, 0.0), toc_ns=gt.from_week(1316, 518400.0 + 79200.0))
    read = parse_navigation("\n".join(start(2.1, "N") + record(late, 2)))
    assert read.store.find("G", 3, gt.from_week(1317, 0.0))[0].toe_ns == gt.from_week(1317, 0.0)


@pytest.mark.parametrize(
    ("lines", "match"),
    [
        (["hello"], "give a RINEX 2 or 3 file"),
        ([], "give a RINEX 2 or 3 file"),
        (start(4.0, "N"), "version 4.00 is not read"),
        (start(2.1, "G"), "kind 'G', where a GPS navigation file"),
        (start(2.1, "N")[:-1], "cut off"),
        (start(2.1, "N"), "it has no records"),
    ],
)
def test_navigation_files_that_are_refused(lines, match):
    with pytest.raises(GnssError, match=match):
        parse_navigation("\n".join(lines))


def header_2(*more):
    return start(2.11, "O", TYPES_2, INTERVAL, *more)


def test_observations_of_version_2_with_thirteen_satellites_and_events():
    sats = [f"G{k:02d}" for k in range(1, 14)]
    lines = header_2(head("APPROX POSITION XYZ", f"{-3976219.5:14.4f}{3382372.6:14.4f}{3652513.0:14.4f}"))
    lines += epoch_2(0.0, sats)
    lines += [f"{'':28}4  2", head("COMMENT", "spliced"), head("COMMENT", "again")]
    lines += epoch_2(30.0, [" 01", "R02", "G03"], values={2: (None, 1.0, 40.0)})
    lines += epoch_2(150.0, ["G01", "G02", "G01"])
    lines += epoch_2(150.0, ["G01"])
    read = parse_observations("\n".join(lines))
    assert [len(e) for e in read.epochs] == [13, 1, 1]
    assert read.rejected == {
        "GLONASS is not used": 1, "no code on L1": 1, "duplicate satellite": 2, "epoch not after the one before": 1,
    }  # fmt: skip
    assert read.missing_epochs == 3
    first = read.epochs[0]
    assert first.gps_ns == gt.from_calendar(2005, 4, 2)
    assert first.pseudorange_m == pytest.approx(2.2e7 + np.arange(13))
    assert first.doppler_mps == pytest.approx(L1_WAVELENGTH_M * (1000.0 - np.arange(13)))  # -1000 Hz: it recedes
    assert first.cn0.tolist() == [45.0] * 13
    assert read.approx_position_e == pytest.approx([-3976219.5, 3382372.6, 3652513.0])
    assert read.epochs[1].satellites() == [("G", 1)]


def test_observations_of_version_3():
    lines = start(
        3.04, "O",
        head("SYS / # / OBS TYPES", "G    4 C1W C1C D1C S1C"),
        head("SYS / # / OBS TYPES", "E    2 C1X L1X"),
        head("TIME OF FIRST OBS", f"{'':48}GPS"),
    )  # fmt: skip
    for second, flag, names in ((0.0, 0, ("G07", "E12", "R01")), (1.0, 4, ("com", "com")), (2.0, 0, ("G07", "G08"))):
        lines.append(f"> 2005 04 02 00 00{second:11.7f}  {flag}{len(names):3d}")
        for n in names:
            lines.append(n + "".join(f"{v:14.3f}  " for v in (2.1e7, 2.2e7, 500.0, 41.5)) if flag == 0 else head("COMMENT", "x"))
    read = parse_observations("\n".join(lines))
    assert [e.satellites() for e in read.epochs] == [[("G", 7), ("E", 12)], [("G", 7), ("G", 8)]]
    assert read.epochs[0].pseudorange_m.tolist() == [2.2e7, 2.1e7]
    assert read.epochs[0].doppler_mps[0] == pytest.approx(-500.0 * L1_WAVELENGTH_M)
    assert math.isnan(read.epochs[0].doppler_mps[1])
    assert read.rejected == {"GLONASS is not used": 1}
    assert read.missing_epochs == 0


def test_without_an_interval_in_the_header_the_median_spacing_counts():
    seconds = (0.0, 5.0, 10.0, 30.0, 35.0, 45.0, 50.0)
    lines = start(2.11, "O", TYPES_2) + sum((epoch_2(s, ["G01"]) for s in seconds), [])
    read = parse_observations("\n".join(lines))
    assert (read.interval_s, read.interval_inferred, read.missing_epochs, read.holes) == (5.0, True, 4, 2)
    assert not read.remarks


def test_an_interval_that_no_epoch_keeps_is_not_believed():
    lines = start(2.11, "O", TYPES_2, head("INTERVAL", f"{1.0:10.3f}")) + sum((epoch_2(s, ["G01"]) for s in (0.0, 30.0, 40.0)), [])
    read = parse_observations("\n".join(lines + epoch_2(59.0, ["G01"])))
    assert (read.interval_s, read.interval_inferred) == (19.0, True)
    assert "states an interval of 1 s, but the epochs are 19 s apart" in read.remarks[0]


def test_a_single_epoch_has_no_interval_and_misses_none():
    read = parse_observations("\n".join(start(2.11, "O", TYPES_2) + epoch_2(0.0, ["G01"])))
    assert (read.interval_s, read.missing_epochs, read.holes) == (None, 0, 0)


def test_damaged_observations_are_counted():
    lines = header_2() + epoch_2(0.0, ["G01", "G02"], values={0: (12.0, 0.0, 0.0)}) + ["what is this"]
    lines += epoch_2(30.0, ["G01"])
    lines[-3] = lines[-3].replace("05  4  2", "05 14  2")
    lines += epoch_2(60.0, ["G01", "G02"])[:-2]
    read = parse_observations("\n".join(lines))
    assert read.rejected == {"impossible pseudorange": 1, "unreadable line": 1, "impossible date": 1, "epoch cut off": 1}
    assert len(read.epochs) == 1


@pytest.mark.parametrize(
    ("lines", "match"),
    [
        (start(2.11, "N"), "kind 'N', where an observation file"),
        (start(2.11, "O", head("# / TYPES OF OBSERV", f"{1:6d}    P2")), "no C/A code on L1 \\(C1\\), only P2"),
        (start(3.04, "O", head("SYS / # / OBS TYPES", "R    1 C1C")), "no code on GPS L1 or Galileo E1"),
        (header_2(head("TIME OF FIRST OBS", f"{'':48}GLO")), "counts time in GLO"),
        (header_2(), "no usable epoch"),
    ],
)
def test_observation_files_that_are_refused(lines, match):
    with pytest.raises(GnssError, match=match):
        parse_observations("\n".join(lines))


@given(st.text(alphabet=st.characters(max_codepoint=126), max_size=400))
def test_random_text_after_a_good_header_is_refused_or_counted_never_worse(text):
    for read, first in ((parse_observations, header_2()), (parse_navigation, start(2.1, "N"))):
        try:
            read("\n".join([*first, text]))
        except GnssError as error:
            assert str(error).endswith(".")
