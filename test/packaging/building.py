"""What the tests of builds share: a copy of the sources, and an environment that knows no other
installation.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOT_SOURCES = shutil.ignore_patterns(
    ".git", "*venv", "build", "install", "log", "*.egg-info", "__pycache__", ".*_cache", ".hypothesis"
)
FOREIGN = (
    "AMENT_",
    "COLCON_",
    "CMAKE_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "_ROS_WHEELS",
    "UNC_PHYSICS",
)


def copy_sources(target):
    """Copy the working tree, since builds write into it."""
    return shutil.copytree(ROOT, target, ignore=NOT_SOURCES, symlinks=True)


def clean_environment(**extra):
    """The environment without any trace of ROS, wheels or this test's venv, and with ``extra``."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(FOREIGN)}
    return {**kept, **extra}


def wheels_environment():
    """The environment in which colcon and CMake find the ROS wheels of the running Python."""
    binaries = os.path.join(sys.prefix, "bin")
    return clean_environment(
        PATH=f"{binaries}{os.pathsep}{os.environ['PATH']}",
        AMENT_PREFIX_PATH=sys.prefix,
        CMAKE_PREFIX_PATH=sys.prefix,
    )


def run(command, *, cwd, env, check=True, timeout=3600):
    """Run a command; a failure shows the end of all that it printed."""
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=env,
        text=True,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=timeout,
    )
    if check and done.returncode:
        raise AssertionError(
            f"{command} ended with {done.returncode}:\n{(done.stdout + done.stderr)[-6000:]}"
        )
    return done
