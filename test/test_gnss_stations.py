"""Two real static stations: metre-level positions from C/A code alone, and what each correction is worth."""

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.gnss.clock_watch import ClockWatch
from lowcostnav_ros.gnss.correction import CorrectionSettings, corrected
from lowcostnav_ros.gnss.gps_time import gps_ns
from lowcostnav_ros.gnss.locate import locate
from lowcostnav_ros.gnss.raw_epoch import RawEpoch
from lowcostnav_ros.gnss.rinex_nav import parse_navigation
from lowcostnav_ros.gnss.rinex_obs import parse_observations
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic

DATA = Path(os.environ.get("LOWCOSTNAV_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data") / "gps_rinex"
pytestmark = pytest.mark.data


def station(name):
    if not DATA.exists():
        pytest.skip("The recorded stations gps_rinex are not here; set LOWCOSTNAV_DATA to the folder that holds them.")
    texts = [(DATA / f"{name}0920.05{kind}").read_text() for kind in "no"]
    return parse_navigation(texts[0]), parse_observations(texts[1])


def errors(navigation, observations, settings, step=4):
    """NED errors (n, 3) against the header's coordinates, RAIM results and counts of what was left out."""
    reference = observations.approx_position_e
    C_ne = dcm_ne(*ecef_to_geodetic(reference)[:2])
    out, results, rejected = [], [], Counter()
    for raw in observations.epochs[::step]:
        epoch, result = locate(raw, navigation, rejected, settings=settings)
        late_ns = raw.gps_ns - gps_ns(epoch.stamp_ns)
        assert abs(late_ns - result.fix.clocks_m["G"] / 0.299792458) < 2.0
        results.append(result)
        out.append(C_ne @ (results[-1].fix.position_e - reference))
    return np.array(out), results, rejected


@pytest.mark.parametrize("name", ["0759", "3040"])
def test_code_positions_are_at_metre_level_and_every_correction_helps(name):
    navigation, observations = station(name)
    assert len(observations.epochs) == 120
    assert observations.missing_epochs == 0
    assert not navigation.rejected and not observations.rejected and not navigation.remarks
    full, results, rejected = errors(navigation, observations, CorrectionSettings())
    rms = np.sqrt(np.mean(full**2, axis=0))
    assert rms[0] < 0.7 and rms[1] < 0.7 and rms[2] < 1.6
    assert {r.verdict for r in results} == {"healthy"}
    assert set(rejected) == {"below the elevation mask"}
    sigma = np.sqrt([np.diag(r.fix.cov_n) for r in results])
    assert np.all(np.abs(full) < 3.0 * sigma)
    for off in ({"ionosphere": False}, {"troposphere": False}):
        worse, _, _ = errors(navigation, observations, CorrectionSettings(**off), step=20)
        assert abs(worse[:, 2].mean()) > 3.0 * abs(full[:, 2].mean())


@pytest.mark.parametrize("fault_m", [60.0, -500.0, 299792.458])
def test_a_fault_in_real_data_is_found_and_a_reset_named(fault_m):
    navigation, observations = station("3040")
    raw, after = observations.epochs[60], observations.epochs[61]
    faulty = raw.pseudorange_m + fault_m * (raw.sat_id == 11)
    raw = RawEpoch(raw.gps_ns, raw.system, raw.sat_id, faulty, raw.doppler_mps, raw.cn0)
    _, result = locate(raw, navigation, Counter())
    assert (result.verdict, result.excluded) == ("excluded", "G11")
    assert np.linalg.norm(result.fix.position_e - observations.approx_position_e) < 5.0
    watch = ClockWatch()
    watch.observe(observations.epochs[60])
    jumped = after.pseudorange_m + 299792.458
    assert watch.observe(RawEpoch(after.gps_ns, after.system, after.sat_id, jumped, after.doppler_mps, after.cn0)).reset_ms == 1


def test_satellites_without_a_valid_ephemeris_are_counted():
    navigation, observations = station("0759")
    raw = observations.epochs[0]
    tomorrow = RawEpoch(raw.gps_ns + 2 * 86400 * 10**9, raw.system, raw.sat_id, raw.pseudorange_m, raw.doppler_mps, raw.cn0)
    rejected = Counter()
    assert len(corrected(tomorrow, navigation, None, CorrectionSettings(), rejected)) == 0
    assert rejected == {"ephemeris out of date": len(raw)}
    other = RawEpoch(raw.gps_ns, np.full(len(raw), "E"), raw.sat_id, raw.pseudorange_m, raw.doppler_mps, raw.cn0)
    rejected = Counter()
    assert len(corrected(other, navigation, observations.approx_position_e, CorrectionSettings(), rejected)) == 0
    assert rejected == {"no ephemeris": len(raw)}


@pytest.mark.parametrize("name", ["0759", "3040"])
def test_a_station_flies_from_its_bag_on_satellites_alone_at_metre_level(name, tmp_path):
    station(name)
    files = [str(DATA / f"{name}0920.05{kind}") for kind in "on"]
    assert cli.main(["convert", files[0], "--navigation", files[1], "--at-rest", "-o", str(tmp_path / "bag")]) == 0
    assert cli.main(["replay", str(tmp_path / "bag"), "--navigators", "gnss_only", "--json", str(tmp_path / "r.json")]) == 0
    found = json.loads((tmp_path / "r.json").read_text())["navigators"]["gnss_only"]
    assert found["solutions"] >= 119 and not found["inputs"]["gnss/raw"]["rejected"]
    flight = found["errors"]["flight"]
    assert np.hypot(flight["horizontal_m"]["rms"], flight["vertical_m"]["rms"]) < 1.5
