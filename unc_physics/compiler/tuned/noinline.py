"""Functions that callers call by address, instead of compiling them into their own code.

numba compiles the whole code of a callee into each caller; a function at the end of a chain of five is
compiled five times. A function marked here is compiled once. Callers load it first (`Callee`).
"""

# pyright: reportAttributeAccessIssue=false

import importlib
from typing import Any, NamedTuple

from llvmlite import binding

_noinline = set()


class Callee(NamedTuple):
    """Compiled function that others call by address."""

    module: str
    name: str
    signature: Any
    symbol: str
    wrapper: str

    def announce(self, codegen):
        """Declare the symbols of its machine code as defined in numba's engine."""
        codegen._engine._defined_symbols |= {self.symbol, self.wrapper}

    def is_loaded(self):
        """Load it, and return whether its symbol is the one that callers use."""
        function = getattr(importlib.import_module(self.module), self.name)
        function.compile(self.signature)
        return function.overloads[self.signature].fndesc.llvm_func_name == self.symbol


def mark_noinline(function):
    """Mark a function to be called by address."""
    _noinline.add(function)


def is_noinline(function):
    """Return whether a function is called by address."""
    return function in _noinline


def keep_address(function, result):
    """If a compiled function is marked, replace its code by its symbol."""
    library = result.library
    if is_noinline(function) and _is_named(function):
        library._shared_module = binding.parse_assembly("")
        library.callee = Callee(
            function.__module__,
            function.__name__,
            tuple(result.signature.args),
            result.fndesc.llvm_func_name,
            result.fndesc.llvm_cpython_wrapper_name,
        )


def needed(library):
    """Return the callees that must be loaded before a library's machine code."""
    found, waiting, seen = set(), [library], {id(library)}
    while waiting:
        caller = waiting.pop()
        found.update(getattr(caller, "needed", ()))
        for called in caller._linking_libraries:
            if id(called) not in seen:
                seen.add(id(called))
                if callee := getattr(called, "callee", None):
                    found.add(callee)
                else:
                    waiting.append(called)
    return tuple(sorted(found, key=lambda one: one.symbol))


def _is_named(function):
    """Return whether a function can be found by its module and name."""
    module = importlib.import_module(function.__module__)
    return getattr(getattr(module, function.__qualname__, None), "py_func", None) is function
