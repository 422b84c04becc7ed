"""The demo as a user starts it, with fewer methods and samples."""

import subprocess
import sys

from unc_physics.checks.errors import ErrorCode

FEW = """
import sys
from unc_physics.ros import demo
demo.METHODS, demo.TRUTH = demo.METHODS[:2] + (("linearization", None),), 50
sys.exit(demo.main(sys.argv[1:]))
"""


def run_demo(output, *program):
    command = [sys.executable, *program, "--output", str(output)]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)


def test_the_demo_prints_a_table_and_writes_a_picture(tmp_path):
    output = tmp_path / "picture.png"
    done = run_demo(output, "-c", FEW)
    assert done.returncode == 0, done.stderr
    for word in ("auto", "linearization", "monte_carlo, 32", "truth", str(output), "shut down cleanly"):
        assert word in done.stdout
    assert output.read_bytes().startswith(b"\x89PNG") and output.stat().st_size > 50_000


def test_a_folder_that_is_not_there(tmp_path):
    done = run_demo(tmp_path / "nowhere" / "picture.png", "-m", "unc_physics.ros.demo")
    assert done.returncode == ErrorCode.OUTPUT_FAILED
    assert "nowhere" in done.stderr
