"""The commands of README and docs: found in their shell blocks, checked for arguments that parse, and run in their printed order.

    python docs/commands.py            run all but those marked <!-- not run: why -->, pages after README, in a folder of their own
"""

import re
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
ENDLESS = ("up", "run")
"""Jobs that only Ctrl-C ends; they are given as long to come up."""
COMES_UP_S, LONGEST_S = 25.0, 1500.0


class Command(NamedTuple):
    """One line of a shell block; ``is_run`` is False where the block is marked as one that cannot be run everywhere."""

    page: str
    line: int
    text: str
    is_run: bool

    def calls(self) -> Iterator[list[str]]:
        """Arguments of every ``lowcostnav`` in it."""
        lexer = shlex.shlex(self.text, posix=True, punctuation_chars="&|;><")
        lexer.whitespace_split = True
        words: list[str] = []
        for word in [*lexer, "&&"]:
            if word in ("&&", "||", "|", ";", ">"):
                if words[:1] == ["lowcostnav"]:
                    yield words[1:]
                words = []
            else:
                words.append(word)


def commands(page: Path) -> Iterator[Command]:
    """The commands of a page: of its ``sh`` blocks, and of lines indented by four blanks that begin with ``lowcostnav``."""
    in_block, marked = False, False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            marked = marked and not in_block  # a mark holds for the block that follows it
            in_block = not in_block and line.strip() == "```sh"
        elif re.match(r"<!-- not run: .+ -->", line):
            marked = True
        elif in_block and line.strip() and not line.lstrip().startswith("#") or line.startswith("    lowcostnav "):
            yield Command(page.relative_to(ROOT).as_posix(), number, line.strip(), not marked)
        elif line.strip() and not in_block:
            marked = False


def main() -> int:
    """Run; return how many failed."""
    failed = []
    with tempfile.TemporaryDirectory(prefix="lowcostnav_docs_") as folder:
        for command in (c for page in PAGES for c in commands(page) if c.is_run):
            if not command.text.startswith("lowcostnav"):
                continue
            status = _run(command, Path(folder))
            print(f"{'ok  ' if status in (0, 1) else 'FAILED'} {command.page}:{command.line}: {command.text}", flush=True)
            failed += [command] if status not in (0, 1) else []
    return len(failed)


def _run(command: Command, folder: Path) -> int:
    job = next(command.calls(), [""])[0]
    shell = f"exec {command.text}" if job in ENDLESS else command.text
    process = subprocess.Popen(shell, shell=True, cwd=folder, stdout=subprocess.DEVNULL)
    try:
        return process.wait(COMES_UP_S if job in ENDLESS else LONGEST_S)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        return process.wait(30.0) if job in ENDLESS else -1


if __name__ == "__main__":
    sys.exit(main())
