"""The measured pages of docs anew, or compared with what they say: ``make validation`` and ``make validation-check`` (an hour or more).

python docs/make_validation.py                     write docs/validation, docs/faults.md and docs/validation.md
python docs/make_validation.py --check             make them elsewhere; 1 where a line differs from the page
python docs/make_validation.py --check gebre       one of them alone
"""

import argparse
import difflib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

DOCS = Path(__file__).resolve().parent
BENCHMARKS = DOCS.parent / "benchmarks"
THESES = ("gebre", "solimeno", "eggers", "kawecki", "njenga")
RUN = [sys.executable, "-m", "lowcostnav_ros.cli"]
PAGES = {
    **{name: ([*RUN, "reproduce", name, "--out", "{docs}/validation"],) for name in THESES},
    "faults": ([*RUN, "faults", "--docs", "{docs}/faults.md"],),
    "recordings": (
        [sys.executable, str(BENCHMARKS / "consistency.py"), "--json", "{docs}/consistency.json"],
        [sys.executable, str(BENCHMARKS / "validation.py"), "--consistency", "{docs}/consistency.json", "--docs", "{docs}"],
    ),
}
"""Commands that write each, ``{docs}`` the folder; the recordings of ``recordings`` are not part of the project."""


def make(name: str, docs: Path) -> None:
    """Write a page into a folder laid out like docs; the exit status of a study tells of its findings, not of the page."""
    for command in PAGES[name]:
        subprocess.run([word.format(docs=docs) for word in command], check=False, stdout=subprocess.DEVNULL)


def differences(made: Path, docs: Path) -> Iterator[str]:
    """Lines in which the text of pages differs from docs."""
    for page in sorted(made.rglob("*.md")):
        there = docs / page.relative_to(made)
        old, new = (path.read_text(encoding="utf-8").splitlines() if path.is_file() else [] for path in (there, page))
        yield from difflib.unified_diff(old, new, str(page.relative_to(made)), "made anew", lineterm="", n=0)


def main() -> int:
    """Write, or compare; 1 where something differs or was not made."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"of {', '.join(PAGES)} (default: all)")
    parser.add_argument("--check", action="store_true", help="write nothing, say what differs")
    options = parser.parse_args()
    unknown = sorted(set(options.pages) - set(PAGES))
    if unknown:
        parser.error(f"there is no page {unknown[0]}; there are {', '.join(PAGES)}")
    with tempfile.TemporaryDirectory() as folder:
        made, bad = Path(folder), 0
        (made / "validation").mkdir()
        for name in options.pages or PAGES:
            print(f"{name} ...", flush=True)
            before = len(list(made.rglob("*.md")))
            make(name, made)
            if len(list(made.rglob("*.md"))) == before:
                print(f"{name}: no page was made", file=sys.stderr)
                bad = 1
        if not options.check:
            (made / "consistency.json").unlink(missing_ok=True)
            shutil.copytree(made, DOCS, dirs_exist_ok=True)
            return bad
        for line in differences(made, DOCS):
            print(line)
            bad = 1
    return bad


if __name__ == "__main__":
    sys.exit(main())
