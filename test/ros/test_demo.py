"""The demo as a user starts it."""

import subprocess
import sys

from unc_physics.checks.errors import ErrorCode


def run_demo(output):
    command = [sys.executable, "-m", "unc_physics.ros.demo", "--output", str(output)]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=300)


def test_the_demo_prints_a_table_and_writes_a_picture(tmp_path):
    output = tmp_path / "picture.png"
    done = run_demo(output)
    assert done.returncode == 0, done.stderr
    for word in ("auto", "linearization", "monte_carlo, 200", "truth", str(output), "shut down cleanly"):
        assert word in done.stdout
    assert output.read_bytes().startswith(b"\x89PNG") and output.stat().st_size > 50_000


def test_a_folder_that_is_not_there(tmp_path):
    done = run_demo(tmp_path / "nowhere" / "picture.png")
    assert done.returncode == ErrorCode.OUTPUT_FAILED
    assert "nowhere" in done.stderr
