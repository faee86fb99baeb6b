"""The Python example of the studies page runs, and gives the numbers that stand beside it."""

from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.physics.earth import difference_n


def test_the_example_of_the_studies_page_gives_its_numbers():
    page = (Path(__file__).parents[1] / "docs/studies.md").read_text()
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
