"""Names in backticks in docstrings and comments of the package exist."""

import ast
import importlib.util
import re
from pathlib import Path

from building import ROOT

PACKAGE = ROOT / "unc_physics"
DOTTED = re.compile(r"(?<![`\w])`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)+)`(?!`)")
SINGLE = re.compile(r"(?<![`\w])`([A-Za-z_]\w*)`(?!`)")
ABBREVIATED = {"np": "numpy"}


def assigned(node):
    """Names that a statement assigns, with those of attributes of ``self``."""
    for target in [getattr(node, "target", None), *getattr(node, "targets", [])]:
        for each in ast.walk(target) if target is not None else ():
            if isinstance(each, ast.Name | ast.Attribute):
                yield each.id if isinstance(each, ast.Name) else each.attr


def statements(body):
    """Statements of a module, with those in branches."""
    for node in body:
        yield node
        if isinstance(node, ast.If | ast.Try):
            yield from statements([*node.body, *node.orelse])


def defined(tree):
    """What a module defines: its names, and for each class its bases and the names in it."""
    names, classes = set(), {}
    for node in statements(tree.body):
        names.update(assigned(node))
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.ImportFrom):
            names.update(each.asname or each.name for each in node.names)
        if isinstance(node, ast.ClassDef):
            members = {name for each in ast.walk(node) for name in assigned(each)}
            members |= {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
            bases = {getattr(base, "id", getattr(base, "attr", "")) for base in node.bases}
            classes[node.name] = bases, members
    return names, classes


def has_member(classes, name, member):
    """Whether a class or one of its bases has a member; ``classes`` are all of the package."""
    bases, members = classes.get(name, ((), ()))
    return member in members or any(has_member(classes, base, member) for base in bases)


def exists(name, modules, classes):
    """Whether a dotted name is a module, something in a module, a class's member, or another package's."""
    parts = name.split(".")
    if parts[0] == PACKAGE.name and len(parts) == 2 and parts[1] in (PACKAGE / "__init__.pyi").read_text():
        return True
    for k in range(len(parts), 0, -1):
        end = "." + ".".join(parts[:k])
        for module, names in modules.items():
            if f".{PACKAGE.name}.{module}".endswith(end):
                rest = parts[k:]
                if not rest or (rest[0] in names and (len(rest) < 2 or has_member(classes, *rest[:2]))):
                    return True
    if len(parts) == 2 and parts[0] in classes:
        return has_member(classes, *parts)
    other = importlib.util.find_spec(ABBREVIATED.get(parts[0], parts[0]))
    return name == "setup.py" or (other is not None and other.origin is not None)  # no folder of tests


def used(tree):
    """Every identifier of a module."""
    for node in ast.walk(tree):
        for field in ("name", "id", "attr", "arg", "asname"):
            if isinstance(getattr(node, field, None), str):
                yield getattr(node, field).rpartition(".")[2]


def mentions(files, pattern):
    """Names that a pattern finds, each with its place."""
    for path, text in files.items():
        for match in pattern.finditer(text):
            yield match[1], f"{path}:{text[: match.start()].count(chr(10)) + 1}: {match[1]}"


def test_names_in_docstrings_and_comments_exist():
    files = {path.relative_to(PACKAGE): path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}
    trees = {path: ast.parse(text) for path, text in files.items()}
    found = {path: defined(tree) for path, tree in trees.items()}
    modules = {dotted(folder): set() for path in files for folder in path.parents if folder.name}
    modules |= {dotted(path): names for path, (names, _) in found.items()}
    classes = {name: each for _, own in found.values() for name, each in own.items()}
    known = {name for tree in trees.values() for name in used(tree)}
    known |= {part for module in modules for part in module.split(".")}
    assert not exists("collision.hull.World", modules, classes)  # a check that finds nothing would pass, too
    missing = [place for name, place in mentions(files, DOTTED) if not exists(name, modules, classes)]
    missing += [place for name, place in mentions(files, SINGLE) if name not in known]
    assert not missing, "\n".join(missing)


def dotted(path: Path):
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")
