"""Completion of the command line, as a shell asks for it."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("argcomplete", reason="the extra 'completion' is not installed")


@pytest.mark.parametrize(
    ("line", "expected"),
    [("unc_physics pre", ["predict", "predict-many"]), ("unc_physics rank --ro", ["--rollouts"])],
)
def test_a_word_is_completed(line, expected, tmp_path):
    answer = tmp_path / "answer"
    answer.touch()
    environment = os.environ | {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    subprocess.run([sys.executable, "-m", "unc_physics"], env=environment, check=False)
    assert [word.strip() for word in answer.read_text().splitlines()] == expected
