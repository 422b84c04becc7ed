"""A propagator of another package, from the documentation's page: named nowhere, and at home everywhere."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from example_extensions import code, install, run
from example_scenes import two_bodies

from unc_physics import ErrorCode
from unc_physics.propagators.names import BUILT_IN

HERE = Path(__file__).parent
MARK = "\n=== end of a command\n"
#: Runs commands, and prints the status of each.
EACH = f"""
import json, sys
from unc_physics.__main__ import main
for command in json.loads(sys.argv[1]):
    try:
        status = main(command)
    except SystemExit as ended:
        status = ended.code
    print("", int(status), sep="\\n", end={MARK!r})
"""
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
    content = two_bodies() | {"horizon": 0.2}
    (folder / "scene.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_the_whole_contract(installed):
    status, output, errors = run(HERE / "antithetic_contract.py", folders=(installed, HERE.parent))
    assert (status, output.splitlines()[-1:]) == (0, ["kept"]), errors


def test_the_tests_of_every_propagator_cover_it(installed):
    tests = HERE.parent / "propagators" / "test_propagators.py"
    selected = "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "antithetic", tests
    status, output, errors = run(*selected, folders=[installed])
    assert status == 0, output + errors
    assert int(re.search(r"(\d+) passed", output)[1]) >= 7


def test_on_the_command_line(installed):
    """One process for several commands: each would import and load the same."""
    predicts = [
        "predict",
        str(installed / "scene.yaml"),
        "--propagator",
        "antithetic",
        "--seed",
        "3",
        "--option",
    ]
    commands = [
        [*predicts, "pairs=20", "--json", "--probabilities", "--samples-out", "3"],
        [*predicts, "pairs=0"],
        ["propagators"],
        ["predict", "--help"],
    ]
    status, output, errors = run("-c", EACH, json.dumps(commands), folders=[installed])
    assert status == 0, errors
    answer, wrong, listed, help_text = (part.rpartition("\n") for part in output.split(MARK)[:-1])
    assert [int(part[2]) for part in (answer, wrong, listed, help_text)] == [
        0,
        ErrorCode.INVALID_OPTION,
        0,
        0,
    ]
    found = json.loads(answer[0])
    assert found["propagator"] == "antithetic"
    body = two_bodies()["bodies"][0]
    expected = np.array(body["position"]) + 0.2 * np.array(body["linear_velocity"])
    assert np.linalg.norm(np.array(found["bodies"][0]["position"]) - expected) < 0.05
    assert len(found["bodies"][1]["samples"]) == 3
    assert "pairs must be at least 1" in errors and "python" not in errors.lower()
    assert (
        "antithetic: Monte Carlo with antithetic samples.\n    pairs: number of pairs of samples" in listed[0]
    )
    assert ", ".join([*BUILT_IN, "antithetic"]) in " ".join(help_text[0].split())


def test_the_file_is_short():
    assert len(code()["antithetic_propagator.py"].splitlines()) < 120


def test_what_cannot_be_loaded_is_left_out(installed, tmp_path):
    package = tmp_path / "broken-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (tmp_path / "halves.py").write_text(HALF)
    points = "broken = not_there:Broken\nhalf = halves:Half\nother = halves:Half\nsurrogate = halves:Half\n"
    (package / "entry_points.txt").write_text(f"[unc_physics.propagators]\n{points}")
    program = "from unc_physics import PROPAGATORS; print(*PROPAGATORS)"
    status, output, errors = run("-c", program, folders=[tmp_path, installed])
    assert (status, output.split()) == (0, [*BUILT_IN, "antithetic"]), errors
    for name, reason in (
        ("broken", "No module named 'not_there'"),
        ("half", "Can't instantiate abstract class Half"),
        ("other", "halves:Half is no subclass of Propagator whose name is 'other'"),
    ):
        assert f"the propagator '{name}' is left out: {reason}" in errors
