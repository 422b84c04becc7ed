"""Imports point one way, and what is optional stays out of the core."""

import os
import sys

from building import ROOT, run

from unc_physics import __version__


def test_imports_keep_to_the_layers():
    command = os.path.join(sys.prefix, "bin", "lint-imports")
    run([command, "--config", "pyproject.toml", "--no-cache"], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})


def test_one_version_everywhere():
    assert f"<version>{__version__}</version>" in (ROOT / "package.xml").read_text()
    assert f"<version>{__version__}</version>" in (ROOT / "unc_physics_msgs" / "package.xml").read_text()
    assert f'version="{__version__}"' in (ROOT / "setup.py").read_text()
    assert f"\n{__version__} (" in (ROOT / "CHANGELOG.rst").read_text()
