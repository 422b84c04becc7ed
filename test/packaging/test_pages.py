"""Directives in the pages that Sphinx would take for text, without a warning."""

import re

from building import ROOT

from unc_physics.compiler.compile_time import FIRST_USE


def test_no_title_of_a_directive_has_a_backtick():
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("*/*.md")]
    assert pages
    for page in pages:
        assert not re.findall(r"^```\{.*`", page.read_text(encoding="utf-8"), re.MULTILINE), page


def test_the_first_use_takes_the_same_time_everywhere():
    for place in ("docs/how-to/install.md", "unc_physics_msgs/msg/PredictionRequest.msg"):
        assert FIRST_USE in (ROOT / place).read_text(encoding="utf-8"), place
