"""The spectrum of vibration against closed forms, and two results in one page."""

import base64
import json
import struct
import zlib

import numpy as np
import pytest
from replay_fakes import FakeSettings, FixFollower, flight, write_bag

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.replay.session import replay_stream
from lowcostnav_ros.report.chart import TimeAxis
from lowcostnav_ros.report.flight.vibration import _png, spectrum, vibration_section

RATE_HZ, LINE_HZ, SIZE = 100.0, 24.0, 3.0


def shaking(seconds=60.0):
    t_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    noise = np.random.default_rng(1).normal(0.0, 0.5, (len(t_s), 3))
    noise[:, 2] += np.where(t_s > seconds / 2.0, SIZE * np.sin(2.0 * np.pi * LINE_HZ * t_s), 0.0) - 9.8
    return t_s, noise


def test_white_noise_and_a_line_have_the_densities_they_ought_to():
    t_s, force = shaking()
    edges, hertz, density = spectrum(t_s, force)
    quiet, loud = density[: len(density) // 2 - 1], density[len(density) // 2 + 2 :]
    inner = (hertz > 3.0) & (hertz < 45.0)
    assert quiet[:, inner].mean() == pytest.approx(3.0 * 2.0 * 0.25 / RATE_HZ, rel=0.05)  # three axes, one-sided
    near = np.abs(hertz - LINE_HZ) < 1.2
    power = (loud[:, near].sum(axis=1) * (hertz[1] - hertz[0])).mean()
    assert power == pytest.approx(SIZE**2 / 2.0, rel=0.05) and edges[-1] == t_s[-1]


def test_a_segment_over_a_gap_counts_nowhere():
    t_s, force = shaking(20.0)
    t_s = np.where(t_s >= 10.0, t_s + 30.0, t_s)
    edges, _, density = spectrum(t_s, force)
    silent = (edges[:-1] >= 10.0) & (edges[1:] <= 40.0)
    assert silent.any() and np.isnan(density[silent]).all() and np.isfinite(density[~silent]).any()


def test_the_picture_holds_its_pixels():
    pixels = np.arange(6, dtype=np.uint8).reshape(2, 3)
    raw = base64.b64decode(_png(pixels).partition(",")[2])
    assert raw.startswith(b"\x89PNG") and struct.unpack(">II", raw[16:24]) == (3, 2)
    at = raw.index(b"IDAT")
    data = zlib.decompress(raw[at + 4 : at + 4 + struct.unpack(">I", raw[at - 4 : at])[0]])
    assert data == b"\0\0\1\2" + b"\0\3\4\5"


def test_a_recording_says_which_line_stands_out(tmp_path):
    t_s, force = shaking()
    stamps = np.round((1.7e9 + t_s) * 1e9).astype(np.int64)
    parts = [slice(k, k + 100) for k in range(0, len(stamps), 100)]
    bag = write_bag(tmp_path / "bag", [ImuBlock.of("imu/data_raw", stamps[p], force[p], np.zeros((len(stamps[p]), 3))) for p in parts])
    text = vibration_section(bag, TimeAxis(1.7e9, 1.7e9 + 60.0))
    assert "lines stand out at 24" in text or "lines stand out at 23.8" in text
    assert "data:image/png" in text and "50 Hz is folded" in text


def test_two_results_of_one_recording_stand_side_by_side(tmp_path, capsys):
    for name, bias in (("plain", 0.0), ("biased", 3.0)):
        out = tmp_path / name
        result = replay_stream(flight(8), {"follower": FixFollower(FakeSettings(north_bias_m=bias))}, (), out=out)
        (out / "summary.json").write_text(json.dumps(result.to_mapping()))
    other = tmp_path / "later"
    result = replay_stream(flight(8, start_s=900.0), {"follower": FixFollower(FakeSettings())}, (), out=other)
    (other / "summary.json").write_text(json.dumps(result.to_mapping()))
    page = tmp_path / "both.html"
    assert main(["report", str(tmp_path / "plain"), "--beside", str(tmp_path / "biased"), "-o", str(page)]) == 0
    assert "<b>follower (plain)</b>" in page.read_text() and "<b>follower (biased)</b>" in page.read_text()
    assert main(["report", str(tmp_path / "plain"), "--beside", str(other), "-o", str(page)]) == 2
    assert "no time in common" in capsys.readouterr().err
