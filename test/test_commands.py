"""The commands that README and docs print: their arguments parse, the short ones run; `make docs-check` runs all in their printed order."""

import importlib.util
from pathlib import Path

import pytest

from lowcostnav_ros.cli.jobs import JOBS
from lowcostnav_ros.cli.main import main, parser

ROOT = Path(__file__).resolve().parent.parent
_spec = importlib.util.spec_from_file_location("commands_of_the_docs", ROOT / "docs" / "commands.py")
assert _spec is not None and _spec.loader is not None
_module = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_module)
PAGES, commands = _module.PAGES, _module.commands

FOUND = [command for page in PAGES for command in commands(page)]
SHORT = ("list", "profiles", "parameters")


def test_commands_are_found_and_most_can_be_run():
    assert len(FOUND) > 40 and {c.page for c in FOUND} >= {"README.md", "docs/gnss.md"}
    assert "docs/commands.py" in (ROOT / "Makefile").read_text()
    assert sum(c.is_run for c in FOUND if c.page == "README.md") > 10


@pytest.mark.parametrize("command", FOUND, ids=lambda c: f"{c.page}:{c.line}")
def test_the_arguments_of_a_command_parse(command):
    for words in command.calls():
        arguments = parser(words[0]).parse_args(words)
        assert arguments.job in JOBS


@pytest.mark.parametrize("command", [c for c in FOUND if c.is_run], ids=lambda c: f"{c.page}:{c.line}")
def test_a_short_command_runs(command, capsys):
    for words in command.calls():
        if words[0] in SHORT or "--list" in words:
            assert main(words) == 0 and capsys.readouterr().out


def test_the_rows_of_the_readmes_table_are_jobs():
    rows = [line.split("`")[1].split() for line in (ROOT / "README.md").read_text().splitlines() if line.startswith("| `lowcostnav ")]
    assert len(rows) > 12 and {words[1] for words in rows} <= set(JOBS)


@pytest.mark.parametrize("job", list(JOBS))
def test_every_help_has_an_example_unless_the_job_takes_nothing(job, capsys):
    assert main([job, "--help"]) == 0
    said = capsys.readouterr().out
    assert "example" in said or "lowcostnav " in said.partition("options:")[2] or job in ("doctor",)


def test_what_there_is_stands_in_the_helps(capsys):
    for job, name in (("simulate", "livermore"), ("up", "navigators_only"), ("run", "ins_gps")):
        main([job, "--help"])
        assert name in capsys.readouterr().out.replace("\n", " ")
    assert main(["list", "graphs", "scenarios"]) == 0 and "navigators_only" in capsys.readouterr().out
    assert main(["list", "grpahs"]) == 2 and "did you mean 'graphs'" in capsys.readouterr().err
