"""Mutants: one change at a time in code that numba does not compile, and whether tests find it.

The checkout is copied. There the tests run once, and coverage records the lines that each executes, but not
what other processes execute. A mutant is found if one of the tests that execute its line fails or hangs.
"""

from __future__ import annotations

import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from .call_walk import COMPILING

_LEAST_TIME = 120.0  # s, after which a test of a mutant counts as hung
_OPERATORS = (
    *((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn)),
    *((ast.And, ast.Or), (ast.Add, ast.Sub), (ast.Mult, ast.Div)),
)
_NAMES = ("min", "max"), ("any", "all"), ("minimum", "maximum"), ("argmin", "argmax"), ("floor", "ceil")
_OTHER = {a: b for pair in (*_OPERATORS, *_NAMES) for a, b in (pair, pair[::-1])}
_SKIPPED = ast.Import | ast.ImportFrom | ast.Assert | ast.JoinedStr | ast.Global | ast.Nonlocal


class Mutant(NamedTuple):
    """A file with one change."""

    path: str  # relative to the checkout
    line: int
    last_line: int  # of the changed statement; of its head if it contains others
    change: str
    source: str  # of the whole changed file

    def __str__(self):
        return f"{self.path}:{self.line}: {self.change}"


def mutants(path: str, source: str) -> Iterator[Mutant]:
    """Yield all mutants of a file."""
    tree = ast.parse(source)
    for owner, field, index, statement in list(_places(tree, tree)):
        original = getattr(owner, field) if index is None else getattr(owner, field)[index]
        for changed in _changes(original):
            _put(owner, field, index, changed)
            text = f"{_short(original)} -> {_short(changed)}"
            yield Mutant(path, statement.lineno, _end_of_head(statement), text, ast.unparse(tree))
            _put(owner, field, index, original)


def _places(node, statement) -> Iterator[tuple[ast.AST, str, int | None, ast.AST]]:
    """Yield where nodes are that can change: parent, field, index in a list, and the statement."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "type_params", "bases"):
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(child, ast.AST) or isinstance(child, _SKIPPED) or _is_left_alone(child):
                continue
            inside = child if isinstance(child, ast.stmt) else statement
            yield node, field, index, inside
            if not isinstance(child, ast.Raise):
                yield from _places(child, inside)


def _is_left_alone(node):
    """Return whether a node is a compiled function, a text for people, or a string."""
    if isinstance(node, ast.FunctionDef):
        decorators = {ast.unparse(part).partition("(")[0] for part in node.decorator_list}
        return bool(decorators & COMPILING) or node.name in ("__repr__", "__str__")
    value = node.value if isinstance(node, ast.Expr) else node
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


def _changes(node) -> Iterator[ast.AST]:
    """Yield what a node can be replaced by."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield ast.Compare(node.left, [_OTHER[type(node.ops[0])]()], node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in _OTHER:
        yield ast.BinOp(node.left, _OTHER[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(_OTHER[type(node.op)](), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield node.operand
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield ast.Constant(node.value + 1 if isinstance(node.value, int) else 1.5 * node.value or 1.0)
    elif isinstance(node, ast.Call):
        for k in range(len(node.keywords)):
            yield ast.Call(node.func, node.args, node.keywords[:k] + node.keywords[k + 1 :])
    elif isinstance(node, ast.Name) and node.id in _OTHER:
        yield ast.Name(_OTHER[node.id], node.ctx)
    elif isinstance(node, ast.Attribute) and node.attr in _OTHER:
        yield ast.Attribute(node.value, _OTHER[node.attr], node.ctx)
    elif isinstance(node, ast.Return) and node.value is not None:
        yield ast.Return(None)
    elif isinstance(node, ast.If | ast.While):
        yield type(node)(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)
    elif isinstance(node, ast.Expr | ast.AugAssign | ast.Raise | ast.Continue | ast.Break):
        yield ast.Pass()


def _put(owner, field, index, node):
    if index is None:
        setattr(owner, field, node)
    else:
        getattr(owner, field)[index] = node


def _end_of_head(statement):
    body = getattr(statement, "body", None)
    return max(statement.lineno, body[0].lineno - 1) if body else statement.end_lineno


def _short(node):
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


class _Tests:
    """Tests in a copy of a checkout, with the lines of the package that each of them executes."""

    def __init__(self, root, folder, tests):
        self._root, self._folder = root, folder
        listed = subprocess.run(["git", "-C", root, "ls-files", "-z"], capture_output=True, check=True).stdout
        for name in filter(None, listed.decode().split("\0")):
            if (root / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(root / name, folder / name)
        settings = folder / ".coveragerc"
        settings.write_text("[run]\ndynamic_context = test_function\nsource = unc_physics\n")
        if self._run(["-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest", "-q", *tests]):
            raise SystemExit("the tests fail without a mutant")
        import coverage

        self._lines = coverage.CoverageData(str(folder / ".coverage"))
        self._lines.read()
        self._files = {path.stem: path.relative_to(folder) for path in (folder / "test").rglob("test_*.py")}
        known = self._named(self._lines.measured_contexts())
        if self._run(["-m", "pytest", "--collect-only", "-q", *known]):
            raise SystemExit("pytest has other names for the tests than coverage")

    def that_execute(self, mutant: Mutant) -> list[str]:
        """Return the tests that execute the changed lines; for lines run at import, any line of the file."""
        contexts = self._lines.contexts_by_lineno(str(self._folder / mutant.path))
        found = {name for line in range(mutant.line, mutant.last_line + 1) for name in contexts.get(line, ())}
        if "" in found:
            found = {name for names in contexts.values() for name in names}
        return self._named(found)

    def _named(self, contexts):
        """Return the tests as pytest names them."""
        parts = [name.split(".")[-2:] for name in sorted(contexts) if "." in name]
        return [f"{self._files[module]}::{test}" for module, test in parts if module in self._files]

    def verdict(self, mutant: Mutant) -> str:
        """Return whether a test fails with a mutant: ``found``, ``not found`` or ``not executed``."""
        tests = self.that_execute(mutant)
        if not tests:
            return "not executed"
        place = self._folder / mutant.path
        original = place.read_text(encoding="utf-8")
        place.write_text(mutant.source, encoding="utf-8")
        try:
            failed = self._run(["-m", "pytest", "-x", "-q", *tests], _LEAST_TIME + 20.0 * len(tests))
        finally:
            place.write_text(original, encoding="utf-8")
        return "found" if failed else "not found"

    def _run(self, arguments, timeout=None):
        """Return the exit status of Python in the copy; not 0 after the timeout."""
        path = os.pathsep.join([str(self._folder), str(self._folder / "evaluation")])
        cache = self._root / "unc_physics" / "__pycache__"
        process = subprocess.Popen(
            [sys.executable, "-B", *arguments],
            cwd=self._folder,
            env=os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(cache)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            return process.wait()


def tried(
    root: Path, files: Sequence[str], tests: Sequence[str], count: int, seed: int
) -> Iterator[tuple[Mutant, str]]:
    """Yield mutants that are drawn by a seed from files, and whether tests find them (`_Tests.verdict`).

    Files and tests are relative to the checkout ``root``.
    """
    found = [mutant for path in files for mutant in mutants(path, (root / path).read_text(encoding="utf-8"))]
    with tempfile.TemporaryDirectory() as folder:
        run = _Tests(root, Path(folder).resolve(), tests)
        for mutant in random.Random(seed).sample(found, min(count, len(found))):
            yield mutant, run.verdict(mutant)
