"""Print the words of each page, and fail above 20 000 in all: ``python docs/count_words.py [PAGE ...]``.

All text written by hand counts, in README.md and below docs/: paragraphs, lists, cells of tables, and code
within a line. Fenced blocks do not count: code, outputs, terms of the glossary, and tables from CSV files.
Link targets, pictures' files, included files and generated pages do not count, either.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = "README.md", "docs/*.md", "docs/*/*.md"
MOST = 20_000
NO_TEXT = re.compile(r"^```.*?^```$|^:::.*?$|^\(.*\)=$|\]\([^)]*\)|<[^>]+>", re.MULTILINE | re.DOTALL)
WORD = re.compile(r"\w[\w'.,-]*")


def words(text: str) -> int:
    """The number of words of a page."""
    return len(WORD.findall(NO_TEXT.sub(" ", text)))


def main(names: list[str]) -> int:
    """Print the words of pages; returns the exit status."""
    pages = [Path(name) for name in names] or [
        path for pattern in PAGES for path in sorted(ROOT.glob(pattern))
    ]
    counts = {page: words(page.read_text(encoding="utf-8")) for page in pages}
    for page, count in counts.items():
        print(f"{count:6}  {page.resolve().relative_to(ROOT)}")
    total = sum(counts.values())
    print(f"{total:6}  in all{'  TOO MANY' * (total > MOST)}")
    return int(total > MOST)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
