"""Inner functions count no references, so an array that one makes is never freed."""

import ast
from pathlib import Path

import pytest

import unc_physics

ROOT = Path(unc_physics.__file__).parent
#: Constructors of arrays, of `compiler.arrays` and of NumPy.
MAKERS = {"empty", "zeros", "ones", "full", "integers", "small_integers", "singles", "booleans", "array"}


def inner_functions():
    """Yield the inner functions, and the functions that implement stages, by file and name."""
    for path in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                marks = [ast.unparse(mark) for mark in node.decorator_list]
                if any(mark.split("(")[0] == "inner" or ".of(" in mark for mark in marks):
                    yield f"{path.relative_to(ROOT)}: {node.name}", node


def makers(function):
    """Return the calls in a function that make arrays."""
    calls = [ast.unparse(node.func) for node in ast.walk(function) if isinstance(node, ast.Call)]
    return [call for call in calls if call.removeprefix("np.") in MAKERS or call.endswith(".copy")]


def test_no_inner_function_makes_an_array():
    found = dict(inner_functions())
    assert len(found) > 100
    assert {name: made for name, function in found.items() if (made := makers(function))} == {}


@pytest.mark.parametrize("body", ["x = empty((3, 3))", "x = np.zeros(3)", "y = x.copy()"])
def test_an_array_that_is_made_is_found(body):
    assert makers(ast.parse(f"def f(x):\n    {body}\n"))
