"""The reference recording replays within its baseline, and to the same bit twice."""

import json
import re
from pathlib import Path

from lowcostnav_ros.cli.main import main

BAGS = Path(__file__).resolve().parent.parent / "bags"


def test_reference_recording_is_no_worse_than_its_baseline_and_repeats_to_the_bit(tmp_path, capsys):
    digests = []
    for run in ("first", "second"):
        baseline = str(BAGS / "reference.baseline.yaml")
        status = main(["replay", str(BAGS / "reference"), "--baseline", baseline, "--json", str(tmp_path / run)])
        assert status == 0, capsys.readouterr().out
        summary = json.loads((tmp_path / run).read_text())
        digests.append({name: entry["fused"]["sha256"] for name, entry in summary["navigators"].items()})
    assert digests[0] == digests[1]
    assert {"ahrs", "ins_gps", "dead_reckoning", "supervisor"} <= set(digests[0])


def test_a_worse_result_is_told_by_the_exit_status(tmp_path, capsys):
    loose = (BAGS / "reference.baseline.yaml").read_text()
    tight = re.sub(r"(?s)(  ins_gps:.*?errors\.flight\.horizontal_m\.rms: {value: )[\d.]+", r"\g<1>0.1", loose, count=1)
    assert tight != loose
    (tmp_path / "tight.yaml").write_text(tight)
    assert main(["replay", str(BAGS / "reference"), "--navigators", "ins_gps", "--baseline", str(tmp_path / "tight.yaml")]) == 1
    assert "WORSE" in capsys.readouterr().out
