"""A new shape of the environment, from the documentation's page, in a copy of the package."""

import os
import re
import shutil
from pathlib import Path

from example_extensions import PAGE, ROOT, code, edited, run

HERE = Path(__file__).parent
SCENE = """\
physics: paper
dt: 0.01
stiffness: 1.0e+4
gravity: [0, 0, 0]
bodies: [{name: pin, model: pin, spheres: 10, mass: 1.0, position: [0, 0, 1]}]
environment: [{cone: {radius: 0.3, height: 0.8}}]
"""


def test_a_cone_is_a_file_and_a_few_lines(tmp_path):
    ignored = shutil.ignore_patterns("__pycache__", "ros")
    shutil.copytree(ROOT / "unc_physics", tmp_path / "unc_physics", ignore=ignored)
    (tmp_path / "models").symlink_to(ROOT / "models")
    path = "unc_physics/physics/paper/solids/cone.py"
    (tmp_path / path).write_text(code()[path])
    difference = re.search(r"^```diff\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)[1]
    parts = re.split(r"^# (\S+)\n", difference, flags=re.MULTILINE)[1:]
    for file, lines in zip(parts[::2], parts[1::2], strict=True):
        (tmp_path / file).write_text(edited((tmp_path / file).read_text(), lines))
    (tmp_path / "cone.yaml").write_text(SCENE)
    whole = ["rollout"] if os.environ.get("CONE_ROLLOUT") == "ON" else []  # it compiles all kernels anew
    status, output, errors = run(HERE / "cone_contract.py", *whole, folders=[tmp_path], cwd=tmp_path)
    assert (status, output.splitlines()[-1:]) == (0, ["kept"]), errors
