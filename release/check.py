"""Check a wheel with kernels: ``python release/check.py WHEEL [--node PYTHON]``.

The wheel is installed into an empty environment, and compiling is an error there
(``UNC_PHYSICS_COMPILER=off``). All kinds of prediction must run. ``--node`` names a Python that has ROS and
the interfaces; the demo runs in it with the wheel's package.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOREIGN = "PYTHON", "NUMBA", "UNC_PHYSICS", "XDG_CACHE"
GOAL = 3.0  # s of CPU from the start of Python to the first prediction; wall time on an idle machine

FIRST = """
import sys
from unc_physics import load_scene, predict
scene, belief, horizon = load_scene(sys.argv[1])
predict(scene, belief, horizon=horizon)
"""


def main():
    """Install the wheel, run all kinds and the node, and measure a first prediction."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--python", default=sys.executable, help="for the environment (default: this one)")
    parser.add_argument("--node", metavar="PYTHON", help="Python with ROS and unc_physics_msgs")
    options = parser.parse_args()
    wheel = options.wheel.resolve()
    with tempfile.TemporaryDirectory() as folder:
        python, env = install_wheel(wheel, options.python, folder)
        examples = python.parents[1] / "share" / "unc_physics" / "examples"
        first = [python, "-c", FIRST, examples / "scenes" / "table.yaml"]
        wall, cpu = measured(first, env, folder)
        print(f"first prediction: {wall:.2f} s of wall time, {cpu:.2f} s of CPU", flush=True)
        if cpu > GOAL:
            raise SystemExit(f"the first prediction takes more than {GOAL} s of CPU")
        subprocess.run([*_install(python), f"{wheel}[geometry,calibration]"], check=True, env=env)
        subprocess.run([python, ROOT / "release" / "kinds.py", examples], check=True, env=env, cwd=folder)
        if options.node:
            target = Path(folder) / "node"
            where = ["--no-deps", "--target", target]
            subprocess.run([options.node, "-m", "pip", "install", "-q", *where, wheel], check=True, env=env)
            output = Path(folder) / "demo.png"
            demo = [options.node, "-m", "unc_physics.ros.demo", "--all-methods", "--output", output]
            models = {
                "PYTHONPATH": str(target),
                "UNC_PHYSICS_MODELS": str(target / "share/unc_physics/models"),
            }
            subprocess.run(demo, check=True, env=env | models, cwd=folder)
    print("no kernel was compiled")


def install_wheel(wheel, base_python, folder):
    """Install a wheel into an empty environment in a folder.

    Returns
    -------
    python : Path
        The Python of the environment.
    env : dict
        Variables of processes in it, with the compiler switched off.
    """
    env = clean_environment() | {"UNC_PHYSICS_COMPILER": "off"}
    venv = Path(folder) / "venv"
    subprocess.run([base_python, "-m", "venv", venv], check=True, env=env)
    python = venv / "bin" / "python"
    subprocess.run([*_install(python), wheel], check=True, env=env)
    return python, env


def clean_environment():
    """Return the environment variables without those that choose other packages or kernels."""
    return {name: value for name, value in os.environ.items() if not name.startswith(FOREIGN)}


def _install(python):
    return [python, "-m", "pip", "install", "-q", "-c", ROOT / "requirements" / "constraints.txt"]


def measured(command, env, folder):
    """Run a command; return its wall time and its CPU time [s]."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, env=env, cwd=folder)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
