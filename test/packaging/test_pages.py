"""Directives in the pages that Sphinx would take for text, without a warning."""

import re

from building import ROOT


def test_no_title_of_a_directive_has_a_backtick():
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("*/*.md")]
    assert pages
    for page in pages:
        assert not re.findall(r"^```\{.*`", page.read_text(encoding="utf-8"), re.MULTILINE), page
