"""The documentation says what the code does."""

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


def test_the_page_on_logs_says_what_a_table_may_hold():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import make_convert
    finally:
        sys.path.remove(str(ROOT / "docs"))
    text = make_convert.PAGE.read_text(encoding="utf-8")
    assert text == make_convert.page(text), "run python docs/make_convert.py"
