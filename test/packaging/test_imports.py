"""What imports what: arrows point one way, and optional parts stay out until they are asked for."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numba", "llvmlite", "trimesh", "rclpy", "ot", "matplotlib", "scipy", "viser", "yourdfpy")


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


def test_importing_the_package_loads_nothing_heavy():
    assert loaded_modules("import unc_physics") == []


def test_shapes_load_nothing_heavy():
    assert loaded_modules("import unc_physics.shapes") == []


def test_the_client_of_the_node_waits_until_it_is_asked_for():
    assert loaded_modules("import unc_physics.ros") == []


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


def test_kernels_import_numpy_and_numba_alone():
    """Of what is not in the standard library."""
    import ast

    allowed = {"numpy", "numba", "llvmlite", *sys.stdlib_module_names}
    folders = "collision", "compiler", "dynamics", "initialization", "spatial"
    package = ROOT / "unc_physics"
    kernels = [package / "shapes" / f"{name}.py" for name in ("columns", "manifold", "nearest", "support")]
    kernels += [path for folder in folders for path in (package / folder).rglob("*.py")]
    for path in sorted(kernels):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                assert all(alias.name.split(".")[0] in allowed for alias in node.names), path
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                assert node.module.split(".")[0] in allowed, path
            elif isinstance(node, ast.ImportFrom):
                level = len(path.relative_to(package).parts) - node.level
                own = (*folders, path.parent.name)
                assert level > 0 or node.module.split(".")[0] in own, path
