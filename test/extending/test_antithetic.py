"""A propagator of another package, from the documentation's page: named nowhere, and at home everywhere."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from example_extensions import ROOT, code, environment, install
from example_scenes import two_bodies

from unc_physics.propagators.names import BUILT_IN

HERE = Path(__file__).parent
HALF = """
from unc_physics.propagators.base import Propagator, Traits


class Half(Propagator):
    name = "half"
    traits = Traits("nominal", "none", False, False, "none")
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder in which `antithetic` is installed, and a scene file."""
    folder = tmp_path_factory.mktemp("antithetic")
    install(folder, "antithetic_propagator", "antithetic")
    content = two_bodies() | {"islands": True, "horizon": 0.2}
    (folder / "scene.yaml").write_text(yaml.safe_dump(content))
    return folder


def run(installed, *command):
    """A process's exit status, output and errors, where `antithetic` is installed."""
    done = subprocess.run(
        [sys.executable, *command],
        env=environment(installed, HERE.parent),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def test_the_whole_contract(installed):
    status, output, errors = run(installed, str(HERE / "antithetic_contract.py"))
    assert (status, output.splitlines()[-1:]) == (0, ["kept"]), errors


def test_on_the_command_line(installed):
    scene = str(installed / "scene.yaml")
    command = ["-m", "unc_physics", "predict", scene, "--propagator", "antithetic", "--seed", "3", "--option"]
    status, output, errors = run(
        installed, *command, "pairs=20", "--json", "--probabilities", "--samples-out", "3"
    )
    assert status == 0, errors
    found = json.loads(output)
    assert found["propagator"] == "antithetic"
    expected = np.array(two_bodies()["bodies"][0]["position"]) + 0.2 * np.array(
        two_bodies()["bodies"][0]["linear_velocity"]
    )
    assert np.linalg.norm(np.array(found["bodies"][0]["position"]) - expected) < 0.05
    assert len(found["bodies"][1]["samples"]) == 3
    status, _, errors = run(installed, *command, "pairs=0")
    assert status != 0 and "pairs must be at least 1" in errors
    assert "python" not in errors.lower()


def test_it_is_listed(installed):
    status, output, _ = run(installed, "-m", "unc_physics", "predict", "--help")
    assert status == 0 and ", ".join([*BUILT_IN, "antithetic"]) in " ".join(output.split())
    status, output, _ = run(installed, "-m", "unc_physics", "propagators")
    assert status == 0
    assert "antithetic: Monte Carlo with antithetic samples.\n    pairs: number of pairs of samples" in output


def test_the_file_is_short():
    assert len(code()["antithetic_propagator.py"].splitlines()) < 120


def test_what_cannot_be_loaded_is_left_out(installed, tmp_path):
    package = tmp_path / "broken-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (tmp_path / "halves.py").write_text(HALF)
    points = "broken = not_there:Broken\nhalf = halves:Half\nother = halves:Half\nsurrogate = halves:Half\n"
    (package / "entry_points.txt").write_text(f"[unc_physics.propagators]\n{points}")
    done = subprocess.run(
        [sys.executable, "-c", "from unc_physics import PROPAGATORS; print(*PROPAGATORS)"],
        env=environment(tmp_path, installed),
        capture_output=True,
        text=True,
        check=True,
    )
    names = " ".join([*BUILT_IN, "antithetic"])
    assert done.stdout.split() == names.split()
    assert "the propagator 'broken' is left out: No module named 'not_there'" in done.stderr
    assert "the propagator 'half' is left out: Can't instantiate abstract class Half" in done.stderr
    assert (
        "the propagator 'other' is left out: halves:Half is no subclass of Propagator whose name is 'other'"
        in done.stderr
    )
