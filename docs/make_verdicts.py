"""Write how many results of each thesis came out how into README.md, from the pages of docs/validation: ``make docs`` (a test compares)."""

import re
from collections import Counter
from pathlib import Path

from lowcostnav_ros.reproduce.registry import VERDICTS

ROOT = Path(__file__).parents[1]
README, PAGES = ROOT / "README.md", ROOT / "docs" / "validation"
ROW = re.compile(r"^\| \[[A-Z]+\d+\w*\]\(#.*\| ([^|]+) \|$", re.MULTILINE)
PLACE = re.compile(r"(\(\[page\]\(docs/validation/(\w+)\.md\))[^)]*\)")


def counts(page: str) -> str:
    """Verdicts of the rows of a page, counted, in their order."""
    found = Counter(match.group(1).strip() for match in ROW.finditer(page))
    return ", ".join(f"{found[verdict]} {verdict}" for verdict in dict.fromkeys([*VERDICTS, *found]) if found[verdict])


def readme(text: str) -> str:
    """README with the counts behind the link to each page."""
    return PLACE.sub(lambda m: f"{m.group(1)}: {counts((PAGES / f'{m.group(2)}.md').read_text(encoding='utf-8'))})", text)


if __name__ == "__main__":
    README.write_text(readme(README.read_text(encoding="utf-8")), encoding="utf-8")
