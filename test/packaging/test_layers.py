"""Imports point one way, and what is optional stays out of the core."""

import ast
import os
import sys

from building import ROOT, run

from unc_physics import __version__


def test_imports_keep_to_the_layers():
    command = os.path.join(sys.prefix, "bin", "lint-imports")
    path = os.pathsep.join([str(ROOT), str(ROOT / "evaluation")])
    run(
        [command, "--config", "pyproject.toml", "--no-cache"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
    )


def test_only_the_evaluations_own_tests_import_it():
    for path in (ROOT / "test").rglob("*.py"):
        if path.parent.name != "evaluation":
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom | ast.Import):
                    modules = [getattr(node, "module", None), *(name.name for name in node.names)]
                    assert not any("unc_physics_evaluation" in (module or "") for module in modules), path


def test_one_version_everywhere():
    assert f"<version>{__version__}</version>" in (ROOT / "package.xml").read_text()
    assert f"<version>{__version__}</version>" in (ROOT / "unc_physics_msgs" / "package.xml").read_text()
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f'version="{__version__}"' in (ROOT / "setup.py").read_text()
    evaluation = (ROOT / "evaluation" / "pyproject.toml").read_text()
    assert f'version = "{__version__}"' in evaluation
    assert f'"unc_physics=={__version__}"' in evaluation
    assert f"\n{__version__} (" in (ROOT / "CHANGELOG.rst").read_text()
