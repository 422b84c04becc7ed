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


def test_the_page_on_the_paper_names_code_that_exists():
    text = (ROOT / "docs" / "explanation" / "paper.md").read_text(encoding="utf-8")
    table = re.search(r"^\| Eq\. \| .*?\n\n", text, re.MULTILINE | re.DOTALL)[0]
    numbers, named = [], 0
    for line in table.strip().splitlines()[2:]:
        equations, _, code = (cell.strip() for cell in line.strip("|").split("|"))
        first, *last = (int(n) for n in re.findall(r"\d+", equations))
        numbers += range(first, (last or [first])[-1] + 1)
        for part in re.split(r"[;,] (?=`[\w/]+\.py`)", code) if "`" in code else ():
            file, *names = re.findall(r"`([^`]+)`", part)
            source = (ROOT / "unc_physics" / file).read_text(encoding="utf-8")
            named += len(names)
            for name in names:
                assert re.search(rf"^(def|class) {name}\b", source, re.MULTILINE), (equations, file, name)
    assert numbers == list(range(1, 36)) and named > 15
