"""Notes of a release, from the changelog: ``python release/notes.py``."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def version() -> str:
    """Return the version that `setup.py` builds."""
    found = re.search(r'version="([^"]+)"', (ROOT / "setup.py").read_text())
    assert found
    return found[1]


def notes(of: str, changelog: str) -> str:
    """Return the changelog's section of a version as Markdown.

    Raises
    ------
    SystemExit
        If the section is missing, or its heading has no date.
    """
    heading = rf"^{re.escape(of)} \((\d{{4}}-\d\d-\d\d)\)\n-+\n"
    section = re.search(heading + r"(.*?)(?=^\S+ \(.*\)\n-+\n|\Z)", changelog, re.MULTILINE | re.DOTALL)
    if section is None:
        raise SystemExit(f"CHANGELOG.rst has no section '{of} (YEAR-MONTH-DAY)'; add it")
    entries = section[2].replace("``", "`").strip()
    return f"# unc_physics {of}, {section[1]}\n\n{entries}\n"


if __name__ == "__main__":
    print(notes(version(), (ROOT / "CHANGELOG.rst").read_text()), end="")
