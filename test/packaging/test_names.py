"""Nothing outside the propagators' folder names one but the default one, and class names are unique."""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

from unc_physics.propagators.names import ANYTIME, BUILT_IN, DEFAULT

ROOT = Path(__file__).resolve().parents[2] / "unc_physics"
PLACES = {name: place.partition(":") for name, place in BUILT_IN.items()}
#: Of modules, of classes, of their carries, and as users write them.
NAMES = {
    *BUILT_IN,
    *(module for module, _, _ in PLACES.values()),
    *(cls for _, _, cls in PLACES.values()),
    *(f"{cls.removesuffix('s')}Carry" for _, _, cls in PLACES.values()),
    *(name.replace("_", " ") for name in BUILT_IN),
} - {ANYTIME}  # which is also what stiffness and overlap may be
FILES = [
    path
    for folder in ("scene", "collision", "dynamics", "prediction", "cli", "ros")
    for path in sorted((ROOT / folder).rglob("*.py"))
]


def docstrings(tree):
    """The nodes of a module's docstrings."""
    with_docstring = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, with_docstring) and ast.get_docstring(node)
    }


def words(tree):
    """All names and texts of a module but its docstrings, with their lines."""
    left_out = docstrings(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute):
            yield node.lineno, node.attr
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            for text in [*(alias.name for alias in node.names), getattr(node, "module", None) or ""]:
                yield node.lineno, text
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in left_out:
            yield node.lineno, node.value


def named(text):
    """The propagators that a text names, the default one's name aside."""
    if text == DEFAULT:
        return []
    spaced = f" {''.join(c if c.isalnum() or c == '_' else ' ' for c in text)} "
    return [name for name in NAMES if f" {name} " in spaced]


@pytest.mark.parametrize("path", FILES, ids=[str(path.relative_to(ROOT)) for path in FILES])
def test_no_propagator_is_named(path):
    found = [
        f"line {line}: {name}" for line, text in words(ast.parse(path.read_text())) for name in named(text)
    ]
    assert not found, f"{path.relative_to(ROOT.parent)} names propagators: {', '.join(found)}"


def test_names_are_found():
    source = (
        '"""Of MonteCarlo."""\nfrom ..propagators.surrogate import SurrogateCarry\nx = "by monte_carlo'
        ' alone"\ny = "'
        f'{DEFAULT}"'
    )
    found = [name for _, text in words(ast.parse(source)) for name in named(text)]
    assert sorted(found) == ["SurrogateCarry", "monte_carlo", "surrogate"]


def test_class_names_are_unique():
    texts = [path.read_text() for path in ROOT.rglob("*.py")]
    classes = [name for text in texts for name in re.findall(r"^ *class (\w+)", text, re.MULTILINE)]
    assert "RigidBody" in classes
    assert [name for name, count in Counter(classes).items() if count > 1] == []
