"""How compiled functions call each other: short ones become part of their callers, long ones stay apart.

numba makes all that a function calls part of it, and compiles it anew with it; what is called at the end of a
chain of five functions is compiled five times. A long function gains nothing by that, so its callers get its
address alone, and it is loaded before them (`Needed`).
"""

# pyright: reportAttributeAccessIssue=false

import importlib
from typing import Any, NamedTuple

from llvmlite import binding

LONG = 20_000  # of machine code [bytes]: a call costs such a function little, a copy of it long compiling


# functions that are called by their address however short they are
_apart = set()


class Needed(NamedTuple):
    """A compiled function that others call by its address."""

    module: str
    name: str
    signature: Any
    symbol: str
    wrapper: str

    def announce(self, codegen):
        """Tell numba the symbols of machine code that comes without the code to make it from."""
        codegen._engine._defined_symbols |= {self.symbol, self.wrapper}

    def is_loaded(self):
        """Load it; whether what was loaded has the symbol that callers know."""
        function = getattr(importlib.import_module(self.module), self.name)
        function.compile(self.signature)
        return function.overloads[self.signature].fndesc.llvm_func_name == self.symbol


def stay_apart(function):
    """Have a function called by its address, however short it is."""
    _apart.add(function)


def stays_apart(function):
    """Whether a function is called by its address, however short it is."""
    return function in _apart


def keep_apart(function, result):
    """Let callers of a function that was just compiled have its address, if it is long or to stay apart."""
    library = result.library
    if _is_named(function) and (stays_apart(function) or len(library._get_compiled_object()) > LONG):
        library._shared_module = binding.parse_assembly("")
        library.apart = Needed(
            function.__module__,
            function.__name__,
            tuple(result.signature.args),
            result.fndesc.llvm_func_name,
            result.fndesc.llvm_cpython_wrapper_name,
        )


def needed(library):
    """What must be loaded before a library's machine code."""
    found, waiting, seen = set(), [library], {id(library)}
    while waiting:
        caller = waiting.pop()
        found.update(getattr(caller, "needed", ()))
        for called in caller._linking_libraries:
            if id(called) not in seen:
                seen.add(id(called))
                if apart := getattr(called, "apart", None):
                    found.add(apart)
                else:
                    waiting.append(called)
    return tuple(sorted(found, key=lambda one: one.symbol))


def _is_named(function):
    """Whether a function can be found by its module and name."""
    module = importlib.import_module(function.__module__)
    return getattr(getattr(module, function.__qualname__, None), "py_func", None) is function
