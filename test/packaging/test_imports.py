"""What imports what: arrows point one way, and optional parts stay out until they are asked for."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numba", "llvmlite", "trimesh", "rclpy", "ot", "matplotlib", "scipy", "viser", "yourdfpy", "mujoco")


def loaded_modules(code):
    """Which of the heavy packages a fresh interpreter has loaded after some code."""
    code += f"\nimport sys\nprint('LOADED', *[name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.splitlines()[-1].split()[1:]


@pytest.mark.parametrize("module", ["unc_physics", "unc_physics.shapes", "unc_physics.ros"])
def test_importing_loads_nothing_heavy(module):
    assert loaded_modules(f"import {module}") == []


@pytest.mark.parametrize("arguments", [["--help"], ["predict", "--help"], ["--version"]])
def test_help_waits_for_nothing(arguments):
    code = f"""
from unc_physics.__main__ import main
try:
    main({arguments!r})
except SystemExit as end:
    assert end.code == 0
import sys
assert not {{"numpy", "yaml"}} & sys.modules.keys(), "half of the time of --help"
"""
    assert loaded_modules(code) == []


def test_a_prediction_needs_numba_and_no_optional_part():
    code = """
from unc_physics import RigidBody, Scene, Belief, load_model, load_scene, predict
scene = Scene([RigidBody("a", load_model("pin").prefix(10))])
"""
    assert set(loaded_modules(code)) <= {
        "numba",
        "llvmlite",
        "scipy",
    }  # SciPy by numba, where it is installed
