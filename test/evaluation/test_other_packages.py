"""A propagator of another package, from the documentation's page, is evaluated beside the built-in ones."""

import subprocess
import sys
from pathlib import Path

from example_extensions import ROOT, environment, install

HERE = Path(__file__).parent


def test_a_propagator_of_another_package_is_evaluated(tmp_path):
    install(tmp_path, "antithetic_propagator", "antithetic")
    done = subprocess.run(
        [sys.executable, HERE / "antithetic_evaluation.py", tmp_path],
        env=environment(tmp_path, HERE.parent, ROOT / "evaluation"),
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "\n| antithetic | " in done.stdout
