"""Imports point one way, and what is optional stays out of the core."""

import ast
import os
import sys

import tomllib
from building import ROOT, run


def test_imports_keep_to_the_layers():
    command = os.path.join(sys.prefix, "bin", "lint-imports")
    path = os.pathsep.join([str(ROOT), str(ROOT / "evaluation")])
    run(
        [command, "--config", "pyproject.toml", "--no-cache"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
    )


def test_each_folder_is_under_the_rules_of_imports():
    """Of contracts without wildcards: a new folder is missing in their lists until it is added."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    contracts = {contract["name"]: contract for contract in settings["contracts"]}
    layers = [layer.strip("()") for layer in contracts["arrows point one way"]["layers"]]

    def sources(name):
        return {module.split(".")[1] for module in contracts[name]["source_modules"]}

    def folders(name):
        return {module for module in contracts[name]["source_modules"] if module.count(".") == 1}

    kernels = layers[layers.index("checks") + 1 : layers.index("programs")]
    # `physics` builds on the kernels of `shapes`, which has these beside what checks and makes pieces
    assert sources("kernels know numpy and numba only") == {*kernels, "physics", "shapes"}
    assert folders("kernels know numpy and numba only") == {
        f"unc_physics.{layer}" for layer in [*kernels, "physics"]
    }
    assert sources("internals of numba are behind the compiler's decorators") == set(layers)


def test_only_the_evaluations_own_tests_import_it():
    for path in (ROOT / "test").rglob("*.py"):
        if path.parent.name != "evaluation":
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom | ast.Import):
                    modules = [getattr(node, "module", None), *(name.name for name in node.names)]
                    assert not any("unc_physics_evaluation" in (module or "") for module in modules), path
