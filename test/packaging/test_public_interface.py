"""The public interface: static names, and types that pyright and mypy see in a user's script."""

import ast
import json
import os
import re
import sys

import pytest
from building import ROOT, run

import unc_physics
import unc_physics.ros

STUB = ROOT / "unc_physics" / "__init__.pyi"
SCRIPTS = ROOT / "test" / "packaging" / "user_scripts"
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in page.parts),
    *sorted((ROOT / "examples").glob("*.py")),
]
EXTENDING = "extending.md"  # shows how to write a propagator or a shape, for which inner modules are needed
MISTAKE = "  # mistake"


def test_the_stub_names_each_once_where_it_is_defined():
    imports = [node for node in ast.parse(STUB.read_text()).body if isinstance(node, ast.ImportFrom)]
    names = [alias.name for node in imports for alias in node.names]
    assert all(alias.asname == alias.name for node in imports for alias in node.names), (
        "else it stays private"
    )
    assert len(set(names)) == len(names) and names == unc_physics.__all__
    assert set(unc_physics.__all__) <= set(dir(unc_physics))
    for name in names:
        value = getattr(unc_physics, name)
        assert value is not None
        if hasattr(value, "__module__"):
            assert value.__module__ == f"unc_physics{unc_physics._HOMES[name]}"
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        unc_physics.nothing_of_the_kind  # noqa: B018


@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.name != EXTENDING], ids=lambda page: str(page.relative_to(ROOT))
)
def test_pages_import_public_names_only(page):
    text = page.read_text()
    deep = re.findall(r"^(?:from|import) unc_physics\.(?!ros import )\S+.*", text, re.MULTILINE)
    assert not deep, "the package itself should export what users need"
    for names in re.findall(r"^from unc_physics\.ros import (.*)", text, re.MULTILINE):
        assert set(re.split(r"\W+", names)) <= {*unc_physics.ros.__all__, ""}
    for names in re.findall(r"^from unc_physics import (.*)", text, re.MULTILINE):
        assert set(re.split(r"\W+", names)) <= {*unc_physics.__all__, ""}
    assert set(re.findall(r"unc_physics\.([A-Z]\w+)", text)) <= set(unc_physics.__all__)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A user's folder, and an environment in which the package is found as one that is installed."""
    folder = tmp_path_factory.mktemp("user")
    for script in SCRIPTS.glob("*.py"):
        (folder / script.name).write_text(script.read_text())
    for k, script in enumerate(
        re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    ):
        (folder / f"readme_{k}.py").write_text(script)
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return folder, os.environ | {"PYTHONPATH": path, "MYPYPATH": str(ROOT)}


def pyright(folder, env):
    """The lines of each script that pyright calls wrong."""
    (folder / "pyrightconfig.json").write_text(
        json.dumps({"extraPaths": [str(ROOT)], "typeCheckingMode": "strict"})
    )
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable]
    found = json.loads(run(command, cwd=folder, env=env, check=False).stdout)["generalDiagnostics"]
    return {
        (os.path.basename(each["file"]), each["range"]["start"]["line"] + 1): each["message"]
        for each in found
    }


def mypy(folder, env):
    """The lines of each script that mypy calls wrong."""
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--follow-imports=silent",
        "--no-incremental",
        *sorted(path.name for path in folder.glob("*.py")),
    ]
    found = re.findall(
        r"^(\w+\.py):(\d+): error: (.*)", run(command, cwd=folder, env=env, check=False).stdout, re.MULTILINE
    )
    return {(name, int(line)): message for name, line, message in found}


@pytest.mark.parametrize("checker", [pyright, mypy])
def test_checkers_see_types_and_find_mistakes(checker, elsewhere):
    folder, env = elsewhere
    wrong = {
        (script.name, k)
        for script in folder.glob("*.py")
        for k, line in enumerate(script.read_text().splitlines(), 1)
        if line.endswith(MISTAKE)
    }
    assert wrong
    found = checker(folder, env)
    assert found.keys() == wrong, found
