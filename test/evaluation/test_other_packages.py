"""A propagator of another package, from the documentation's page, is evaluated beside the built-in ones."""

from pathlib import Path

from example_extensions import ROOT, install, run

HERE = Path(__file__).parent


def test_a_propagator_of_another_package_is_evaluated(tmp_path):
    install(tmp_path, "antithetic_propagator", "antithetic")
    folders = tmp_path, HERE.parent, ROOT / "evaluation"
    status, output, errors = run(HERE / "antithetic_evaluation.py", tmp_path, folders=folders)
    assert status == 0, errors
    assert "\n| antithetic, pairs=20 | " in output
