"""The set-up that make does: shielded from other installations, with a Python that fits, and made again when
needed.
"""

import os
import shutil
import sys

import pytest
from building import ROOT, clean_environment, run

# as a shell has them that sourced another ROS, and as the wheels' own start-up leaves them
FOREIGN = {
    "AMENT_PREFIX_PATH": "/opt/ros/other",
    "CMAKE_PREFIX_PATH": "/opt/ros/other",
    "COLCON_PREFIX_PATH": "/elsewhere",
    "LD_LIBRARY_PATH": "/opt/ros/other/lib",
    "PYTHONPATH": "/opt/ros/other/lib/python3.12/site-packages",
    "ROS_DISTRO": "other",
    "RMW_IMPLEMENTATION": "rmw_other_cpp",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
}


@pytest.fixture
def folder(tmp_path):
    """A folder with no more than what the first step reads."""
    target = tmp_path / "checkout"
    target.mkdir()
    shutil.copy(ROOT / "Makefile", target)
    shutil.copytree(ROOT / "requirements", target / "requirements")
    return target


def test_other_ros_does_not_reach_recipes(folder):
    env = clean_environment(**FOREIGN)
    seen = run(["make", "-s", "--eval", "show: ; @env", "show"], cwd=folder, env=env).stdout
    names = {line.partition("=")[0] for line in seen.splitlines()}
    assert "PATH" in names
    assert not names & FOREIGN.keys()


def test_missing_python_is_said(folder):
    env = clean_environment()
    done = run(["make", "-s", ".venv/made/python", "PYTHON=/bin/false"], cwd=folder, env=env, check=False)
    assert done.returncode
    assert "No Python 3.11 or 3.12" in done.stderr
    assert "/bin/false" in done.stderr
    assert not (folder / ".venv").exists()


def test_python_that_does_not_run_is_passed_over_and_moved_venv_is_made_anew(folder, tmp_path):
    binaries = tmp_path / "bin"
    binaries.mkdir()
    shim = binaries / "python3.12"
    shim.write_text("#!/bin/sh\necho 'not installed' >&2\nexit 127\n")
    shim.chmod(0o755)
    (binaries / "python3.11").symlink_to(os.path.realpath(sys.executable))
    env = clean_environment(**FOREIGN, PATH=f"{binaries}{os.pathsep}{os.environ['PATH']}")
    step = [".venv/made/python"]
    run(["make", "-s", *step], cwd=folder, env=env)
    prefix = run(
        [folder / ".venv/bin/python", "-c", "import sys; print(sys.prefix)"],
        cwd=tmp_path,
        env=clean_environment(),
    )
    assert prefix.stdout.strip() == str(folder / ".venv")
    assert run(["make", "-s", "-n", *step], cwd=folder, env=env).stdout == ""

    moved = folder.rename(tmp_path / "moved")
    assert "-m venv" in run(["make", "-s", "-n", *step], cwd=moved, env=env).stdout


@pytest.mark.parametrize("target", [".venv/made/python", "clean"])
def test_venv_of_somebody_else_stays(folder, target):
    kept = folder / ".venv" / "pyvenv.cfg"
    kept.parent.mkdir()
    kept.write_text("home = elsewhere\n")
    done = run(["make", "-s", target], cwd=folder, env=clean_environment(), check=False)
    assert kept.read_text() == "home = elsewhere\n"
    if target != "clean":
        assert done.returncode
        assert "make VENV=" in done.stderr
