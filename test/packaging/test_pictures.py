"""The pictures of the docs: which there are, and whether those of seconds are as their sources."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "docs"))

from pictures import IMAGES, pictures, stamp, stamps

SHOWN = {
    re.search(r"images/([\w/]+\.\w+)", line)[1]: line
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    for line in re.findall(r"!\[[^]]*\]\([^)]*images/[^)]*\)", page.read_text(encoding="utf-8"))
}


def test_each_picture_is_shown_and_known_how_to_make():
    assert (
        set(SHOWN) == set(pictures()) == {str(path.relative_to(IMAGES)) for path in IMAGES.rglob("*.*[gf]")}
    )


@pytest.mark.parametrize("name", [name for name, picture in pictures().items() if not picture.figure])
def test_a_picture_is_as_what_it_is_made_from(name):
    """``python docs/pictures.py`` makes it anew; of experiments, which take hours, ``--check`` tells."""
    assert stamps().get(name) == stamp(pictures()[name])


def test_the_check_tells_which_are_old():
    known = stamps()
    run = subprocess.run(
        [sys.executable, ROOT / "docs" / "pictures.py", "--check", "models_mug.png", "evaluation/orders.png"],
        capture_output=True,
        text=True,
        check=False,
    )
    old = known.get("evaluation/orders.png") != stamp(pictures()["evaluation/orders.png"])
    assert (run.returncode, "evaluation/orders.png" in run.stdout) == (int(old), old)
    assert "models_mug" not in run.stdout
