"""The core library installs by pip into a plain venv, without ROS, and works from there; its evaluation joins
it.

The venv's dependencies are links to those of the running Python. Where BASE_PYTHON names a Python to do so
with, they are installed from the package index.
"""

import json
import os
import sys
import tarfile
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest
from building import ROOT, clean_environment, copy_sources, run

from unc_physics import ErrorCode, __version__

DEPENDENCIES = ("llvmlite", "numba", "numpy", "pyyaml", "tqdm")
SCENE = """
physics: paper
dt: 0.01
horizon: 0.5
stiffness: 1.0e+4
damping: 0.5
bodies:
  - {name: left, model: bunny, spheres: 10, mass: 1, position: [-0.7, 0, 0], linear_velocity: [0.8, 0, 0],
     position_std: 0.02}
  - {name: right, model: pin, spheres: 10, mass: 1, position: [0.7, 0, 0], linear_velocity: [-0.8, 0, 0]}
"""

DATA = """
from unc_physics_evaluation.hard_cases import load, names
from unc_physics_evaluation.recorded_tosses import recorded_tosses
load("rod_on_floor")
recorded_tosses()
"""


def link_dependencies(venv):
    """Let a venv have what the package depends on, and nothing else of the running Python's packages."""
    (site,) = venv.glob("lib/python3.*/site-packages")
    for name in DEPENDENCIES:
        of = distribution(name)
        for top in {file.parts[0] for file in of.files or ()} - {".."}:
            (site / top).symlink_to(of.locate_file(top))


def built_wheel(sources, folder):
    """A wheel made of the source distribution, after a look at what both hold."""
    made = f"unc_physics-{__version__}"
    run([sys.executable, "setup.py", "-q", "sdist", "-d", folder], cwd=sources, env=clean_environment())
    with tarfile.open(folder / f"{made}.tar.gz") as archive:
        held = {name.removeprefix(f"{made}/") for name in archive.getnames()}
        archive.extractall(folder, filter="data")
    wanted = {f"models/{path.name}" for path in (ROOT / "models").glob("*.npz")}
    wanted |= {f"examples/scenes/{path.name}" for path in (ROOT / "examples" / "scenes").glob("*.yaml")}
    assert wanted | {"LICENSE", "README.md", "CITATION.cff", "CHANGELOG.rst", "package.xml"} <= held
    assert not any(name.startswith(("test/", "evaluation/", "docs/", ".")) for name in held)
    options = ["-q", "--no-deps", "--no-build-isolation", "-w", folder, folder / made]
    run([sys.executable, "-m", "pip", "wheel", *options], cwd=folder, env=clean_environment())
    (wheel,) = folder.glob("*.whl")
    shared = {name.partition("/share/unc_physics/")[2] for name in zipfile.ZipFile(wheel).namelist()}
    assert wanted <= shared
    return wheel


def test_ros2_run_and_launch_find_an_editable_install(tmp_path):
    index = pytest.importorskip("ament_index_python.packages")
    sources, prefix = copy_sources(tmp_path / "sources"), tmp_path / "prefix"
    # without --ignore-installed pip would remove the package that the tests run in
    options = ["-q", "--no-deps", "--no-build-isolation", "--no-compile", "--ignore-installed"]
    options += ["--prefix", prefix, "-e", "."]
    run([sys.executable, "-m", "pip", "install", *options], cwd=sources, env=clean_environment())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AMENT_PREFIX_PATH", str(prefix))
        share = Path(index.get_package_share_directory("unc_physics"))
    assert (share / "package.xml").read_bytes() == (ROOT / "package.xml").read_bytes()
    assert {*os.listdir(share / "launch")} >= {path.name for path in (ROOT / "launch").glob("*.launch.py")}
    installed = {path.name: os.access(path, os.X_OK) for path in (prefix / "lib" / "unc_physics").iterdir()}
    assert installed == {path.name: True for path in (ROOT / "scripts").iterdir()}


@pytest.mark.long
def test_core_installs_and_predicts_without_ros(tmp_path):
    env = clean_environment(PIP_CONSTRAINT=str(ROOT / "requirements" / "constraints.txt"), PIP_NO_INPUT="1")
    # kernels go by their code, not by their place
    env["NUMBA_CACHE_DIR"] = str(ROOT / "unc_physics" / "__pycache__")
    other = os.environ.get("BASE_PYTHON")
    base = other or getattr(sys, "_base_executable", sys.executable)
    run([base, "-m", "venv", "--without-pip", tmp_path / "venv"], cwd=tmp_path, env=env)
    python = tmp_path / "venv" / "bin" / "python"
    if not other:
        link_dependencies(python.parents[1])
    sources = copy_sources(tmp_path / "sources")
    wheel = built_wheel(sources, tmp_path / "dist")
    pip = [sys.executable, "-m", "pip", "--python", python]
    index = [] if other else ["--no-index"]
    run([*pip, "install", "--no-compile", *index, wheel], cwd=tmp_path, env=env)

    listed = json.loads(run([*pip, "list", "--format", "json"], cwd=tmp_path, env=env).stdout)
    installed = {package["name"].lower().replace("-", "_") for package in listed}
    assert installed == {*DEPENDENCIES, "unc_physics"}, "a core install stays small"
    location = run(
        [python, "-c", "import unc_physics; print(unc_physics.__file__)"], cwd=tmp_path, env=env
    ).stdout.strip()
    folder = Path(location).parent
    assert (folder / "py.typed").is_file(), "without it type checkers take everything for Any"
    assert (folder / "__init__.pyi").is_file(), "without it nothing is public"
    assert sorted(path.name for path in (folder / "schemas").iterdir()) == [
        "prediction.schema.json",
        "scene.schema.json",
    ]
    assert run([python, "-c", "import rclpy"], cwd=tmp_path, env=env, check=False).returncode

    help_text = run([python, "-m", "unc_physics", "--help"], cwd=tmp_path, env=env).stdout
    assert "predict" in help_text
    assert run([python.with_name("unc_physics"), "--help"], cwd=tmp_path, env=env).stdout == help_text

    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    command = [python, "-m", "unc_physics", "predict", scene, "--propagator", "sigma_points", "--json"]
    prediction = json.loads(run(command, cwd=tmp_path, env=env).stdout)
    assert [body["name"] for body in prediction["bodies"]] == ["left", "right"]
    left, right = (body["position"][0] for body in prediction["bodies"])
    assert -0.7 < left < right < 0.7, "models of the package's share folder, moving towards each other"

    without = run([python, "-m", "unc_physics", "evaluate", "--quick"], cwd=tmp_path, env=env, check=False)
    assert without.returncode == ErrorCode.NOT_SUPPORTED
    assert without.stderr.endswith("from the repository: pip install ./evaluation\n")
    # its dependencies are large, and neither the command's help nor the data need them
    options = ["--no-compile", "--no-deps", "--no-build-isolation", "--target", tmp_path / "added"]
    run([*pip[:3], "install", *options, sources / "evaluation"], cwd=tmp_path, env=env)
    env["PYTHONPATH"] = str(tmp_path / "added")
    assert (
        "EXPERIMENT" in run([python, "-m", "unc_physics", "evaluate", "--help"], cwd=tmp_path, env=env).stdout
    )
    run([python, "-c", DATA], cwd=tmp_path, env=env)
