"""The documentation says what the code does."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def test_the_interfaces_page_is_what_the_code_declares():
    result = subprocess.run([sys.executable, ROOT / "docs" / "make_interfaces.py", "--check"], check=False)
    assert result.returncode == 0, "run python docs/make_interfaces.py"


@pytest.mark.parametrize("page", sorted(p.relative_to(ROOT).as_posix() for p in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]))
def test_every_link_and_picture_of_a_page_exists(page):
    text = (ROOT / page).read_text()
    targets = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text)
    missing = [t for t in targets if "://" not in t and not ((ROOT / page).parent / t).exists()]
    assert not missing


def script(name):
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(ROOT / "docs"))


@pytest.mark.parametrize("study", ["gebre", "solimeno", "eggers", "kawecki"])
def test_readme_says_how_many_results_came_out_how(study):
    make_verdicts = script("make_verdicts")
    text, page = make_verdicts.README.read_text(encoding="utf-8"), (make_verdicts.PAGES / f"{study}.md").read_text(encoding="utf-8")
    assert text == make_verdicts.readme(text), "run python docs/make_verdicts.py"
    head = page.partition(". A number marked")[0]
    counted = make_verdicts.counts(page)
    assert counted in head.replace("**", ""), "the head of the page does not agree with its rows"
    assert sum(int(n) for n in re.findall(r"\d+", counted)) == len(re.findall(r"^## [A-Z]+\d", page, re.MULTILINE))


def test_the_page_on_logs_says_what_a_table_may_hold():
    make_convert = script("make_convert")
    text = make_convert.PAGE.read_text(encoding="utf-8")
    assert text == make_convert.page(text), "run python docs/make_convert.py"


def test_a_measured_page_made_anew_is_compared_line_by_line(tmp_path, monkeypatch, capsys):
    making = script("make_validation")
    monkeypatch.setattr(making, "DOCS", tmp_path / "docs")
    monkeypatch.setattr(making, "PAGES", {"gebre": (["sh", "-c", "echo '| 2.0 m |' > {docs}/validation/gebre.md"],), "lost": (["true"],)})
    (tmp_path / "docs" / "validation").mkdir(parents=True)
    page = tmp_path / "docs" / "validation" / "gebre.md"
    page.write_text("| 1.0 m |\n")
    monkeypatch.setattr("sys.argv", ["make_validation.py", "--check", "gebre"])
    assert making.main() == 1 and "-| 1.0 m |\n+| 2.0 m |\n" in capsys.readouterr().out and "1.0" in page.read_text()
    monkeypatch.setattr("sys.argv", ["make_validation.py", "gebre"])
    assert making.main() == 0 and page.read_text() == "| 2.0 m |\n"
    monkeypatch.setattr("sys.argv", ["make_validation.py", "--check", "gebre"])
    assert making.main() == 0
    monkeypatch.setattr("sys.argv", ["make_validation.py", "lost"])
    assert making.main() == 1 and "no page was made" in capsys.readouterr().err
