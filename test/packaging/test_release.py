"""A release: one version everywhere, notes from the changelog, and wheels that say for whom they are."""

import ast
import re
import sys
import zipfile
from xml.etree import ElementTree

import pytest
import yaml
from building import ROOT, clean_environment, copy_sources, run

from unc_physics import __version__

sys.path.append(str(ROOT / "release"))
from wheels import kernel_folder

from notes import notes, version

CHANGELOG = """\
0.3.0 (not released yet)
------------------------
* New.

0.2.0 (2026-11-25)
------------------
* Older: ``this``.

0.1.0 (2025-01-01)
------------------
* Oldest.
"""


def test_all_files_have_the_same_version():
    found = {"setup.py": version(), "unc_physics": __version__}
    released = {}  # as ROS has no versions of a development state
    for file in ("package.xml", "unc_physics_msgs/package.xml", "examples/cpp/package.xml"):
        released[file] = re.findall(r"<version>(.*)</version>", (ROOT / file).read_text())[0]
    found["CITATION.cff"] = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[
        0
    ]
    evaluation = (ROOT / "evaluation" / "pyproject.toml").read_text()
    found["evaluation"] = re.findall(r'^version = "(.*)"$', evaluation, re.MULTILINE)[0]
    found["evaluation's dependency"] = re.findall(r'"unc_physics==(.*?)"', evaluation)[0]
    found["recipe"] = re.findall(
        r"^  version: (.*)$", (ROOT / "release/conda/recipe.yaml").read_text(), re.MULTILINE
    )[0]
    released["changelog"] = re.findall(r"^(\S+) \(", (ROOT / "CHANGELOG.rst").read_text(), re.MULTILINE)[0]
    assert set(found.values()) == {__version__}, found
    assert set(released.values()) == {__version__.partition(".dev")[0]}, released


def test_all_files_name_the_same_dependencies():
    setup = (ROOT / "setup.py").read_text()
    (listed,) = re.findall(r"install_requires=(\[.*?\])", setup)
    needed = set(ast.literal_eval(listed))
    recipe = (ROOT / "release/conda/recipe.yaml").read_text()
    run = yaml.safe_load(recipe)["requirements"]["run"]
    (python,) = re.findall(r'python_requires="(.*)"', setup)
    assert {one.replace(" ", "") for one in run} == needed | {f"python{python}"}
    (numba,) = (one for one in needed if one.startswith("numba"))
    for file in ("Dockerfile", "docs/how-to/install.md"):
        assert f'"{numba}"' in (ROOT / file).read_text(), file


def test_ros_installs_what_the_node_needs():
    setup = (ROOT / "setup.py").read_text()
    needed = re.findall(r"install_requires=(\[.*?\])", setup) + re.findall(r'"association": (\[.*?\])', setup)
    names = {re.split("[<>=]", one)[0] for text in needed for one in ast.literal_eval(text)}
    keys = {"python3-" + name.replace("pyyaml", "yaml") for name in names}
    keys.add("python3-trimesh-pip")  # reads meshes of own objects and of robots; rosdep's key
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    found = {one.text for one in package.iter("exec_depend") if (one.text or "").startswith("python3-")}
    assert found == keys


def test_notes_are_the_changelogs_section():
    assert notes("0.2.0", CHANGELOG) == "# unc_physics 0.2.0, 2026-11-25\n\n* Older: `this`.\n"
    for missing in ("0.3.0", "0.3.0.dev0", "0.2"):
        with pytest.raises(SystemExit, match=re.escape(missing)):
            notes(missing, CHANGELOG)
    assert "0.2.0" in notes("0.2.0", (ROOT / "CHANGELOG.rst").read_text())


@pytest.mark.parametrize("compiled", [False, True])
def test_only_a_wheel_with_kernels_is_for_one_python_and_platform(compiled, tmp_path):
    sources = copy_sources(tmp_path / "sources")
    kernel = "unc_physics/kernels/0123456789abcdef/a.b-01234567-0123456789abcdef.kernel"
    (sources / kernel).parent.parent.mkdir(exist_ok=True)
    for other in (sources / "unc_physics" / "kernels").glob("*/*"):
        other.unlink()
    where = []
    if compiled:
        (sources / kernel).parent.mkdir()
        (sources / kernel).write_bytes(b"machine code")
        where = ["--plat-name", "manylinux_2_17_x86_64"]
    command = [sys.executable, "setup.py", "-q", "bdist_wheel", "-d", tmp_path, *where]
    run(command, cwd=sources, env=clean_environment())
    (wheel,) = tmp_path.glob("*.whl")
    python = "cp{}{}".format(*sys.version_info[:2])
    tag = f"{python}-{python}-manylinux_2_17_x86_64" if compiled else "py3-none-any"
    assert wheel.name == f"unc_physics-{__version__}-{tag}.whl"
    assert (kernel in zipfile.ZipFile(wheel).namelist()) == compiled


def test_kernels_of_a_wheel_are_kept_until_a_source_changes(tmp_path):
    work, sources = tmp_path / "work", tmp_path / "sources"
    (sources / "unc_physics").mkdir(parents=True)
    module = sources / "unc_physics" / "step.py"
    module.write_text("step = 1")
    first = kernel_folder(work, sources)
    (first / "step.kernel").touch()
    assert (kernel_folder(work, sources) / "step.kernel").exists()
    module.write_text("step = 2")
    second = kernel_folder(work, sources)
    assert second.exists() and list(work.rglob("step.kernel")) == []
