"""The Python examples of the documentation run, and give the numbers that stand beside them."""

import json
import shutil
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from lowcostnav_ros.physics.earth import difference_n

ROOT = Path(__file__).parents[1]


def test_the_example_of_the_studies_page_gives_its_numbers():
    page = (ROOT / "docs/studies.md").read_text()
    found: dict = {}
    exec(page.split("## From Python")[1].split("```python\n")[1].split("```")[0], found)  # the page's own text
    np.testing.assert_allclose(found["walk_deg"], [0.0866, 0.671], rtol=1e-3)
    assert found["tilt_deg"] == pytest.approx(-17.0, abs=0.1)
    assert found["off_m"] == pytest.approx(1620.0, abs=1.0)
    assert found["same"].shape == (6, 3)
    assert np.abs(found["gains"][0][3:] - found["gains"][2][3:]).max() > 0.1 * np.abs(found["gains"][0][3:]).max()
    assert [bool(remark) for remark in found["remarks"]] == [True, True, False, False]
    assert found["apart_s"] == pytest.approx(84.9, abs=0.1) and found["change_mps"] == pytest.approx(2.94, abs=0.01)
    assert found["high"] == pytest.approx(1.024, abs=0.001) and found["altitude_m"] == pytest.approx(1000.0, abs=0.1)
    where, (at, words) = found["where"], found["found"][0]
    for station, slant_m in zip(found["stations"], (60_000.0, 62_000.0), strict=True):
        north, east, down = difference_n(where.lat, where.lon, 1500.0, station.lat, station.lon, station.height)
        assert np.sqrt(north**2 + east**2 + down**2) == pytest.approx(slant_m, rel=1e-3)
    assert at == 3 and words[2:9] == list(range(1, 8))


def test_the_notebook_runs_from_top_to_bottom_and_carries_no_output():
    cells = json.loads((ROOT / "docs/examples/losing_gps.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    matplotlib.use("Agg")
    found: dict = {}
    for cell in code:
        exec("".join(cell["source"]), found)
    shutil.rmtree(found["out"])
    assert {"ins_gps", "dead_reckoning"} <= set(found["errors"]) and all(share > 0.8 for share in found["inside"].values())
    lost = found["errors"]["ins_gps"]
    assert lost["sigma_north_m"][-1] > 3.0 * lost["sigma_north_m"][len(lost) // 2]  # GPS is away at the end
