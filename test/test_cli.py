"""The command line through ``main(argv)``: exit statuses, one sentence on stderr, no traceback."""

import json
import os
import subprocess
import sys
import time

import pytest
import yaml
from replay_fakes import REGISTRY, flight, write_bag, write_config

from lowcostnav_ros.cli.main import main
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.bag_writer import BagWriter


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return str(write_bag(tmp_path_factory.mktemp("cli") / "flight", flight(20)))


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return str(write_config(tmp_path_factory.mktemp("config")))


def refused(capsys, *argv):
    """Run the command line, expect exit status 2 and one sentence; return the sentence."""
    assert main(list(argv), REGISTRY) == 2
    err = capsys.readouterr().err
    assert "Traceback" not in err and err.count("\n") == 1 and err.rstrip().endswith(".")
    return err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--navigators", "folower"], "did you mean 'follower'"),
        (["--withhold", "gps/fix@9"], "like gps/fix,gps/vel@290-350"),
        (["--withhold", "gps/fixx@1-2"], "did you mean 'gps/fix'"),
        (["--withhold", "gps/fix@60-90"], "the recording spans 100.0 to 1"),
        (["--truth", "truth/odometri"], "did you mean 'truth/odometry'"),
        (["--truth", "gps/fix"], "give a topic of type nav_msgs/msg/Odometry"),
        (["--config", "nowhere"], "does not exist"),
        (["--baseline", "nowhere.yaml"], "--write-baseline"),
        (["--json", "nowhere/r.json"], "create it first"),
        (["--navigators", "listener"], "listener cannot run: the recording has no imu/data_fused"),
    ],
)
def test_unusable_options_are_refused(capsys, bag, config, arguments, says):
    options = arguments if "--config" in arguments else ["--config", config, *arguments]
    assert says in refused(capsys, "replay", bag, *options)


def test_a_missing_bag_a_file_that_is_none_and_an_empty_one_are_refused(capsys, tmp_path):
    assert "does not exist" in refused(capsys, "replay", str(tmp_path / "none"))
    (tmp_path / "text.mcap").write_text("not a bag")
    assert "not a recording" in refused(capsys, "replay", str(tmp_path / "text.mcap"))
    with BagWriter(tmp_path / "empty"):
        pass
    assert "no messages" in refused(capsys, "replay", str(tmp_path / "empty"))


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_truncated_bag_is_refused(capsys, tmp_path, share, config):
    path = write_bag(tmp_path / "flight", flight(6))
    (file,) = path.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    assert str(path) in refused(capsys, "replay", str(path), "--config", config)


def test_a_topic_of_the_wrong_type_is_named(capsys, tmp_path, config):
    from lowcostnav_ros.messages import encode
    from lowcostnav_ros.messages.store import to_cdr

    with BagWriter(tmp_path / "wrong") as writer:
        writer.write("gps/fix", topics.CLOCK, 1, to_cdr(encode.clock(1)))
    assert "'gps/fix' is of type rosgraph_msgs/msg/Clock" in refused(capsys, "replay", str(tmp_path / "wrong"), "--config", config)


def test_missing_required_topics_are_named(capsys, tmp_path, config):
    items = [i for i in flight(3) if getattr(i, "source", "") == "gps/vel"]
    write_bag(tmp_path / "poor", items)
    assert "No navigator can run" in refused(capsys, "replay", str(tmp_path / "poor"), "--config", config)


def test_a_missing_configuration_file_is_refused(capsys, bag, tmp_path):
    assert "holds no <navigator>.yaml file; those known are ahrs" in refused(capsys, "replay", bag, "--config", str(tmp_path))


def test_replay_writes_what_was_asked_and_meets_its_own_baseline(capsys, bag, config, tmp_path):
    base = ["replay", bag, "--navigators", "follower", "--config", config]
    files = ["--json", str(tmp_path / "r.json"), "--out", str(tmp_path / "out"), "--write-baseline", str(tmp_path / "b.yaml")]
    assert main([*base, *files], REGISTRY) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 100
    assert "follower: GPS all flight" in out
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["bag"]["topics"]["imu/data_raw"] == 400 and len(result["navigators"]["follower"]["fused"]["sha256"]) == 64
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"follower.csv", "follower_aids.csv", "summary.json"}
    assert main([*base, "--baseline", str(tmp_path / "b.yaml")], REGISTRY) == 0
    assert "PASS" in capsys.readouterr().out


def test_worse_than_the_baseline_is_exit_status_one(capsys, bag, config, tmp_path):
    path = tmp_path / "b.yaml"
    base = ["replay", bag, "--navigators", "follower", "--config", config]
    path.write_text(yaml.safe_dump({"navigators": {"follower": {"errors.flight.horizontal_m.max": {"limit": 10.0}}}}))
    assert main([*base, "--baseline", str(path)], REGISTRY) == 1
    assert "WORSE: 0 better, 0 same, 1 worse" in capsys.readouterr().out
    assert main([*base, "--baseline", str(path), "--withhold", "gps/fix@5-12"], REGISTRY) == 1


def test_a_baseline_of_another_bag_is_refused(capsys, bag, config, tmp_path):
    (tmp_path / "b.yaml").write_text("bag: 0123456789abcdef\nnavigators: {follower: {fused.count: {value: 1}}}\n")
    base = ["replay", bag, "--config", config, "--navigators", "follower"]
    assert "another bag" in refused(capsys, *base, "--baseline", str(tmp_path / "b.yaml"))


def test_settings_come_from_the_configuration_directory(capsys, bag, tmp_path):
    (tmp_path / "follower.yaml").write_text("/**:\n  ros__parameters:\n    north_bias_m: 3.0\n    output.rate_hz: 5.0\n")
    base = ["replay", bag, "--navigators", "follower", "--config", str(tmp_path), "--json", str(tmp_path / "r.json")]
    assert main(base, REGISTRY) == 0
    ratios = json.loads((tmp_path / "r.json").read_text())["navigators"]["follower"]["errors"]["flight"]["error_over_sigma"]
    assert ratios["north_m"] == pytest.approx(3.0 / 5.0, rel=1e-3)
    (tmp_path / "follower.yaml").write_text("/**:\n  ros__parameters:\n    north_bia_m: 3.0\n")
    capsys.readouterr()
    assert "did you mean 'north_bias_m'" in refused(capsys, *base)


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["run", "ahsr"], "did you mean 'ahrs'"),
        (["simulate", "livermoor", "-o", "never"], "livermoor"),
        (["simulate", "livermore", "-o", "never", "--duration", "-3"], "must be positive"),
        (["up", "livermoor"], "livermore"),
    ],
)
def test_other_jobs_refuse_what_does_not_exist(capsys, argv, says):
    assert says in refused(capsys, *argv)


def test_simulate_records_what_the_nodes_would_publish(capsys, tmp_path):
    path = tmp_path / "short"
    assert main(["simulate", "ld", "-o", str(path), "--duration", "2", "--seed", "7", "--storage", "sqlite3"]) == 0
    from lowcostnav_ros.messages.bag import BagReader

    with BagReader(path) as reader:
        assert reader.types["truth/odometry"] == topics.ODOMETRY and reader.types["imu/data_raw"] == topics.IMU
        assert reader.counts["truth/odometry"] == pytest.approx(41, abs=1)
        assert reader.duration_s == pytest.approx(2.0, abs=0.05)
    assert "exists already" in refused(capsys, "simulate", "ld", "-o", str(path), "--duration", "2")


def test_a_recording_with_radials_replays_through_the_vor_aid(capsys, tmp_path):
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "ins_gps.yaml").write_text(
        "ins_gps:\n  ros__parameters:\n    vor: {enabled: true, stations_file: dme_stations_bay_area.csv}\n"
    )
    scenario, bag = tmp_path / "radials.yaml", str(tmp_path / "bag")
    flight = "truth: {kind: segments, name: straight, rate_hz: 50}\nimu: {profile: automotive, rate_hz: 50.0}\n"
    scenario.write_text(f"name: radials\nsensors: [imu, magnetometer, gps, vor]\n{flight}gps: {{outages_s: [[15.0, 1000.0]]}}\n")
    assert main(["simulate", str(scenario), "-o", bag, "--duration", "40"]) == 0
    report = tmp_path / "r.json"
    replay = ["replay", bag, "--navigators", "ins_gps", "--config", str(tmp_path / "config"), "--json", str(report)]
    assert main(replay) == 0
    found = json.loads(report.read_text())
    assert found["navigators"]["ins_gps"]["aids"]["vor"]["used"] >= 14  # two stations, every five seconds
    assert {"OAK", "SJC"} <= {s["ident"] for s in found["stations"]}


def test_help_and_version_answer_at_once_and_name_the_jobs():
    began = time.perf_counter()
    shown = subprocess.run([sys.executable, "-m", "lowcostnav_ros.cli.main", "--help"], capture_output=True, text=True, check=True)
    assert all(job in shown.stdout for job in ("run", "up", "doctor", "simulate", "convert", "demo", "replay", "report", "exit status"))
    assert time.perf_counter() - began < 5.0
    heavy = "[m for m in ('numpy', 'numba', 'rclpy', 'rich', 'yaml') if m in sys.modules]"
    imported = f"import sys, lowcostnav_ros.cli.main as c; c.parser(); print({heavy})"
    shown = subprocess.run([sys.executable, "-c", imported], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
    assert main(["--version"]) == 0


def test_the_options_of_a_job_are_shown_without_what_works_and_all_jobs_together_load_little():
    heavy = ("numba", "scipy", "matplotlib", "rclpy", "rosbags", "jsbsim", "filterpy", "pyulog", "mcap", "pygeomag")
    shown = (
        "import sys, lowcostnav_ros.cli.main as c\n"
        "for name in c.JOBS: c.parser(name)\n"
        f"print([m for m in {heavy} if m in sys.modules], sum(m.startswith('lowcostnav_ros') for m in sys.modules))"
    )
    environment = {**os.environ, "LOWCOSTNAV_KERNELS": "interpreted"}  # as --help sets it
    told = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True, env=environment).stdout
    assert told.startswith("[] ") and int(told.split()[-1]) < 120, told


def test_no_job_or_an_unknown_one_is_exit_status_two(capsys):
    assert main([]) == 2
    assert main(["replya"]) == 2
    assert "invalid choice" in capsys.readouterr().err


def test_a_defect_is_not_dressed_up_as_a_refusal(monkeypatch, bag, config):
    from lowcostnav_ros.replay import bag_replay

    def broken(*_):
        raise ValueError("operands could not be broadcast")

    monkeypatch.setattr(bag_replay, "replay_bag", broken)
    with pytest.raises(ValueError, match="broadcast"):
        main(["replay", bag, "--config", config], REGISTRY)


def test_a_plugin_adds_a_job(tmp_path):
    (tmp_path / "glide_plugin.py").write_text(
        "from lowcostnav_ros.cli.jobs import job\n\n\n"
        "@job('Glide.', lambda parser: parser.add_argument('--ratio', type=float))\n"
        "def glide(arguments):\n    print(f'gliding at {arguments.ratio:g}')\n    return 0\n"
    )
    environment = {**os.environ, "LOWCOSTNAV_PLUGINS": "glide_plugin", "PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-m", "lowcostnav_ros.cli", "glide", "--ratio", "12.5"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert shown.stdout == "gliding at 12.5\n"
    environment["LOWCOSTNAV_PLUGINS"] = "gilde_plugin"
    shown = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert shown.returncode == 2 and "gilde_plugin" in shown.stderr and shown.stderr.count("\n") == 1


def test_every_module_of_the_room_is_a_job_or_a_helper():
    from lowcostnav_ros.cli.jobs import JOBS

    assert all(callable(JOBS[name].run) and JOBS[name].text.endswith(".") for name in JOBS.own())


def test_a_command_whose_reader_has_read_enough_says_nothing():
    shell = f"{sys.executable} -m lowcostnav_ros.cli.main list | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("scenarios")
