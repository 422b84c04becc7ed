"""Functions that a call passes, by a static walk through the sources of a package.

The walk starts at one function. It follows each name that stands for a function, a method or a property of
the package, called or handed on, in all branches. What an expression stands for is read from

- definitions, imports, ``self`` and ``super``,
- annotations of arguments, fields and returned values, of which the first class of the package counts; so a
  container stands for its elements,
- constructors, and assignments, loops and ``with`` of one name.

An instance of a base class of the given implementation counts as one of that implementation. A table of a
module leads to the functions that it names, and to those that a decorator enters into it. Compiled functions
count, but the walk ends there. It leaves out what these rules do not tell.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
#: Decorators of functions that numba compiles.
COMPILING = {"kernel", "inner", "stage", "intrinsic", "njit", "overload"}
_CONSTRUCTORS = "__new__", "__init__", "__post_init__"


class Place(NamedTuple):
    """Module, and a name in it: ``function``, ``Class`` or ``Class.method``; none for the module itself."""

    module: str
    name: str = ""


class Value(NamedTuple):
    """What an expression stands for: a definition, or an instance of a class."""

    place: Place
    is_instance: bool = False


class Package:
    """Definitions and imports in the sources of a package.

    Parameters
    ----------
    folder : Path
        Of the package; its name is that of the package.

    Attributes
    ----------
    files : dict of str to Path
        By module.
    functions, classes, variables : dict of Place to ast node
        Functions and methods, classes, and values of variables of modules.
    """

    def __init__(self, folder):
        self.files, self.functions, self.classes, self.variables = {}, {}, {}, {}
        self._imports = {}
        for path in sorted(Path(folder).rglob("*.py")):
            parts = path.relative_to(Path(folder).parent).with_suffix("").parts
            parent = parts[:-1]
            module = ".".join(parent if parts[-1] == "__init__" else parts)
            self.files[module] = path
            tree = ast.parse(path.read_text(encoding="utf-8"))
            self._define(module, tree)
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom):
                    source = (
                        (*parent[: len(parent) + 1 - node.level], node.module)
                        if node.level
                        else [node.module]
                    )
                    for alias in node.names:
                        origin = Place(".".join(filter(None, source)), alias.name)
                        self._imports[Place(module, alias.asname or alias.name)] = origin

    def _define(self, module, tree):
        for node in tree.body:
            if isinstance(node, _FUNCTIONS):
                self.functions[Place(module, node.name)] = node
            elif isinstance(node, ast.ClassDef):
                self.classes[Place(module, node.name)] = node
                for part in node.body:
                    if isinstance(part, _FUNCTIONS):
                        self.functions[Place(module, f"{node.name}.{part.name}")] = part
            elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                for target in getattr(node, "targets", None) or [node.target]:
                    if isinstance(target, ast.Name):
                        self.variables[Place(module, target.id)] = node.value

    def resolve(self, place: Place) -> Place | None:
        """Return the definition or module that a name of a module stands for; None for other names."""
        while place in self._imports:
            place = self._imports[place]
            if (module := f"{place.module}.{place.name}") in self.files:
                return Place(module)
        known = place in self.functions or place in self.classes or place in self.variables
        return place if known else None

    def bases(self, kind: Place) -> Iterator[Place]:
        """Yield a class and its base classes in the package."""
        yield kind
        for base in self.classes[kind].bases:
            found = self.resolve(Place(kind.module, base.id)) if isinstance(base, ast.Name) else None
            if found in self.classes:
                yield from self.bases(found)

    def member(self, kind: Place, name: str) -> Place | None:
        """Return the method or property of a class or its bases."""
        places = (Place(owner.module, f"{owner.name}.{name}") for owner in self.bases(kind))
        return next((place for place in places if place in self.functions), None)

    def annotated(self, module: str, annotation) -> Value | None:
        """Return an instance of the first class of the package in an annotation."""
        for part in ast.walk(annotation) if annotation is not None else ():
            if isinstance(part, ast.Name) and (kind := self.resolve(Place(module, part.id))) in self.classes:
                return Value(kind, True)
        return None

    def is_compiled(self, function: Place) -> bool:
        """Return whether numba compiles a function."""
        decorators = self.functions[function].decorator_list
        return any(ast.unparse(part).partition("(")[0] in COMPILING for part in decorators)


def passed(package: Package, entry: Place, implementation: Place | None = None) -> list[Place]:
    """Return the functions and methods that a call passes.

    Parameters
    ----------
    package : Package
    entry : Place
        Function where the call starts.
    implementation : Place, optional
        Class that stands for its base classes.
    """
    found, left = {}, [entry]
    while left:
        place = left.pop()
        if place not in found:
            found[place] = None
            if not package.is_compiled(place):
                left += _Body(package, place, implementation).named()
    return list(found)


class _Body:
    """Names in the body of a function."""

    def __init__(self, package, place, implementation):
        self._package, self._module = package, place.module
        self._node = package.functions[place]
        self._implementation = implementation
        self._own = Place(place.module, place.name.partition(".")[0]) if "." in place.name else None
        self._locals = {}
        arguments = self._node.args
        for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs):
            self._locals[argument.arg] = package.annotated(self._module, argument.annotation)
        if self._own is not None:
            self._locals["self"] = self._locals["cls"] = self._instance(self._own)
        for node in ast.walk(self._node):
            for target, value in _bound(node):
                self._locals.setdefault(target.id, self._value(value))

    def named(self) -> Iterator[Place]:
        """Yield the functions that the body names."""
        for statement in self._node.body:
            for node in ast.walk(statement):
                if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
                    yield from self._functions(self._definition(node))
                elif isinstance(node, ast.Call):
                    place = self._definition(node.func)
                    if place in self._package.classes:
                        members = (self._package.member(place, name) for name in _CONSTRUCTORS)
                        yield from filter(None, members)

    def _functions(self, place):
        """Yield a function, or the functions in a table."""
        package = self._package
        if place in package.functions:
            yield place
        elif place in package.variables:
            for node in ast.walk(package.variables[place]):
                if isinstance(node, ast.Name):
                    found = package.resolve(Place(place.module, node.id))
                    if found in package.functions:
                        yield found
            yield from _entered(package, place)

    def _definition(self, node) -> Place | None:
        """Return the definition that a name or an attribute stands for."""
        if isinstance(node, ast.Name) and node.id not in self._locals:
            return self._package.resolve(Place(self._module, node.id))
        if isinstance(node, ast.Attribute) and (owner := self._value(node.value)) is not None:
            if owner.place in self._package.classes:
                return self._package.member(owner.place, node.attr)
            if not owner.place.name:
                return self._package.resolve(Place(owner.place.module, node.attr))
        return None

    def _value(self, node) -> Value | None:
        """Return what an expression stands for."""
        if isinstance(node, ast.Name) and node.id in self._locals:
            return self._locals[node.id]
        if isinstance(node, ast.Subscript | ast.Starred):
            return self._value(node.value)
        if isinstance(node, ast.Call):
            return self._returned(node)
        place = self._definition(node)
        if place is None:
            return self._field(node) if isinstance(node, ast.Attribute) else None
        if isinstance(node, ast.Attribute) and place in self._package.functions:  # a property
            return self._annotated(place.module, self._package.functions[place].returns)
        return Value(place)

    def _returned(self, call):
        """Return what a call returns."""
        if isinstance(call.func, ast.Name) and call.func.id == "super" and self._own is not None:
            base = next((kind for kind in list(self._package.bases(self._own))[1:]), None)
            return base and Value(base, True)
        place = self._definition(call.func)
        if place in self._package.classes:
            return self._instance(place)
        function = self._package.functions.get(place)
        return self._annotated(place.module, function.returns) if place and function else None

    def _field(self, node):
        """Return what an instance's field stands for, by its annotation or its assignment in `__init__`."""
        owner = self._value(node.value)
        for kind in (
            self._package.bases(owner.place) if owner and owner.place in self._package.classes else ()
        ):
            for part in self._package.classes[kind].body:
                if isinstance(part, ast.AnnAssign) and ast.unparse(part.target) == node.attr:
                    return self._annotated(kind.module, part.annotation)
            start = Place(kind.module, f"{kind.name}.__init__")
            for part in ast.walk(self._package.functions[start]) if start in self._package.functions else ():
                if isinstance(part, ast.AnnAssign) and ast.unparse(part.target) == f"self.{node.attr}":
                    return self._annotated(kind.module, part.annotation)
                if isinstance(part, ast.Assign) and ast.unparse(part.targets[0]) == f"self.{node.attr}":
                    return _Body(self._package, start, self._implementation)._value(part.value)
        return None

    def _annotated(self, module, annotation):
        value = self._package.annotated(module, annotation)
        return value and self._instance(value.place)

    def _instance(self, kind):
        """Return an instance of a class; of the implementation for its base classes."""
        chosen = self._implementation
        return Value(chosen if chosen and kind in self._package.bases(chosen) else kind, True)


def _bound(node) -> Iterator[tuple[ast.Name, ast.expr]]:
    """Yield the single names that a statement binds, and the expressions that they or their elements are."""
    if isinstance(node, ast.Assign):
        pairs = [(target, node.value) for target in node.targets]
    elif isinstance(node, ast.For | ast.comprehension):
        pairs = [(node.target, node.iter)]
    elif isinstance(node, ast.withitem):
        pairs = [(node.optional_vars, node.context_expr)]
    elif isinstance(node, ast.NamedExpr):
        pairs = [(node.target, node.value)]
    else:
        pairs = []
    return ((target, value) for target, value in pairs if isinstance(target, ast.Name))


def _entered(package, table) -> Iterator[Place]:
    """Yield the functions of a table's module that a decorator enters into it."""
    for place, function in package.functions.items():
        for part in function.decorator_list if place.module == table.module else ():
            name = ast.unparse(part).partition("(")[0]
            decorator = package.functions.get(Place(place.module, name))
            if decorator is not None and any(getattr(n, "id", "") == table.name for n in ast.walk(decorator)):
                yield place
