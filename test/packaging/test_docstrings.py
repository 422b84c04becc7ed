"""Names in backticks in docstrings and comments of the package exist."""

import ast
import importlib.util
import re

from building import ROOT

PACKAGE = ROOT / "unc_physics"
#: Names and dotted names; double backticks are for formulas and code.
NAME = re.compile(r"(?<![`\w])`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)`(?!`)")
ABBREVIATED = {"np": "numpy"}


def identifiers(path, tree):
    """Every identifier of a module, with the parts of its own name."""
    yield from path.with_suffix("").parts
    for node in ast.walk(tree):
        for field in ("name", "id", "attr", "arg", "asname"):
            if isinstance(getattr(node, field, None), str):
                yield from getattr(node, field).split(".")


def is_elsewhere(name):
    """Whether the first part of a dotted name is a package of others, or a file of the repository."""
    first = ABBREVIATED.get(name.partition(".")[0], name.partition(".")[0])
    other = importlib.util.find_spec(first) if "." in name else None
    return name == "setup.py" or (first != PACKAGE.name and other is not None and other.origin is not None)


def test_names_in_docstrings_and_comments_exist():
    """Each part of a dotted name is an identifier of the package."""
    files = {path.relative_to(PACKAGE): path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}
    known = {
        PACKAGE.name,
        *(name for path, text in files.items() for name in identifiers(path, ast.parse(text))),
    }
    assert "rollout" in known and "no_such_name" not in known
    missing = [
        f"{path}:{text[: match.start()].count(chr(10)) + 1}: {match[1]}"
        for path, text in files.items()
        for match in NAME.finditer(text)
        if not known.issuperset(match[1].split(".")) and not is_elsewhere(match[1])
    ]
    assert not missing, "\n".join(missing)
