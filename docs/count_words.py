"""Print the words of each page, and fail above 1 500: ``python docs/count_words.py [PAGE ...]``.

Code, link targets, pictures' files and markup do not count.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = "README.md", "docs/*.md", "docs/*/*.md"
MOST = 1500
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
        print(f"{count:6}  {page.resolve().relative_to(ROOT)}{'  TOO LONG' * (count > MOST)}")
    print(f"{sum(counts.values()):6}  in all")
    return int(max(counts.values()) > MOST)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
