"""Measures of the code: lines, files that a request passes, tuned constants, and mutants that tests find.

.. code-block:: bash

   python -m unc_physics_evaluation.code_metrics            # the table
   python -m unc_physics_evaluation.code_metrics --list     # and the files and constants behind it
   python -m unc_physics_evaluation.code_metrics --mutants 20 --tests test/scene -- FILE...
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import unc_physics

from .call_walk import Package, Place, passed
from .mutation import tried
from .tables import table

ROOT = Path(unc_physics.__file__).resolve().parents[1]
#: What answers a call of the node's service ``~/predict``, and the propagator of the request.
ENTRY = Place("unc_physics.ros.server", "PredictionServer._predict")
PROPAGATOR = Place("unc_physics.propagators.sigma_points", "SigmaPoints")
#: Layers of the physics.
LAYERS = ("physics",)
_ROUND_OFF = 1e-8
_COMPARING = ast.Lt | ast.LtE | ast.Gt | ast.GtE
_BOUNDED = "range", "min", "max"


class Constant(NamedTuple):
    """A tuned constant."""

    path: Path
    line: int
    name: str  # empty if it has none
    value: float


def count_lines(folder: Path) -> int:
    """Return the number of lines of all Python files in a folder."""
    return sum(len(path.read_bytes().splitlines()) for path in folder.rglob("*.py"))


def tuned_constants(paths: Sequence[Path]) -> Iterator[Constant]:
    """Yield constants that somebody chose, and could choose differently.

    At the top level of a module, these are numbers in upper case, and numbers in tuples: fractions, and whole
    numbers that bound a loop, a comparison, a minimum or a maximum. Other whole numbers are indices, columns
    and codes. In functions, these are fractions that are no multiple of a quarter; such multiples are
    coefficients of formulas. Numbers within 1e-8 of 0, 1 or -1 guard against round-off and do not count.
    """
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    bounds = {name for tree in trees.values() for name in _bounds(tree)}
    for path, tree in trees.items():
        for node in tree.body:
            for name, part in _assigned(node) if isinstance(node, ast.Assign) else ():
                value = _number(part)
                if value is not None and (name in bounds if isinstance(value, int) else _is_chosen(value)):
                    yield Constant(path, part.lineno, name, value)
        places = set()
        for function in ast.walk(tree):
            if isinstance(function, ast.FunctionDef):
                places |= {
                    (part.lineno, part.col_offset, part.value)
                    for part in ast.walk(function)
                    if isinstance(part, ast.Constant) and isinstance(part.value, float)
                }
        for line, _, value in sorted(places):
            if not (4.0 * value).is_integer() and _is_chosen(value):
                yield Constant(path, line, "", value)


def _is_chosen(value):
    return min(abs(value), abs(abs(value) - 1.0)) > _ROUND_OFF or abs(value) == 1.0


def _assigned(node) -> Iterator[tuple[str, ast.expr]]:
    """Yield names in upper case and their numbers."""
    target = node.targets[0]
    several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
    pairs = zip(target.elts, node.value.elts, strict=False) if several else [(target, node.value)]
    for name, value in pairs:
        if isinstance(name, ast.Name) and name.id.isupper():
            for part in value.elts if isinstance(value, ast.Tuple) else [value]:
                yield name.id, part


def _number(node) -> float | None:
    """Return the value of a number or of a sum, product or power of numbers."""
    if isinstance(node, ast.Constant):
        return node.value if type(node.value) in (int, float) else None
    if isinstance(node, ast.UnaryOp | ast.BinOp):
        parts = [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)]
        if all(_number(part) is not None for part in parts):
            return eval(compile(ast.Expression(node), "", "eval"))
    return None


def _bounds(tree) -> Iterator[str]:
    """Yield names that bound loops, comparisons, minima or maxima."""
    for node in ast.walk(tree):
        parts = []
        if isinstance(node, ast.Compare) and all(isinstance(op, _COMPARING) for op in node.ops):
            parts = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in _BOUNDED:
            parts = node.args
        while parts:
            part = parts.pop()
            if isinstance(part, ast.Name):
                yield part.id
            elif not isinstance(part, ast.Subscript | ast.Call):
                parts += ast.iter_child_nodes(part)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the measures."""
    parser = argparse.ArgumentParser(prog="code_metrics", description=__doc__.partition("\n")[0])
    parser.add_argument("--list", action="store_true", help="print the files and the constants")
    parser.add_argument(
        "--mutants", type=int, default=0, metavar="N", help="change N places; takes minutes to hours"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the draw of places (default 0)")
    parser.add_argument(
        "--tests", nargs="+", default=["test"], metavar="PATH", help="that look for mutants (default: test)"
    )
    parser.add_argument(
        "files", nargs="*", metavar="FILE", help="in which mutants are (default: the package)"
    )
    options = parser.parse_args(arguments)
    package = Package(ROOT / "unc_physics")
    functions = passed(package, ENTRY, PROPAGATOR)
    files = Counter(package.files[place.module].relative_to(ROOT) for place in functions)
    paths = [path for layer in LAYERS for path in sorted((ROOT / "unc_physics" / layer).rglob("*.py"))]
    constants = list(tuned_constants(paths))
    lines = [
        ["lines of the package", count_lines(ROOT / "unc_physics")],
        ["lines of tests", count_lines(ROOT / "test")],
        ["lines of the evaluation", count_lines(ROOT / "evaluation")],
        ["files that a service call passes", len(files)],
        ["functions that it passes", len(functions)],
        ["tuned constants", len(constants)],
    ]
    if options.mutants:
        names = options.files or [
            str(p.relative_to(ROOT)) for p in sorted((ROOT / "unc_physics").rglob("*.py"))
        ]
        verdicts = Counter()
        for mutant, verdict in tried(ROOT, names, options.tests, options.mutants, options.seed):
            verdicts[verdict] += 1
            print(f"{verdict}: {mutant}", flush=True)
        lines.append(["mutants found", f"{verdicts['found']} of {verdicts.total()}"])
    if options.list:
        for path, number in sorted(files.items()):
            print(f"{path}: {number} functions")
        for constant in constants:
            print(f"{constant.path.relative_to(ROOT)}:{constant.line}: {constant.name} {constant.value:g}")
    print(table(["measure", ""], [[name, str(value)] for name, value in lines]))


if __name__ == "__main__":
    main()
