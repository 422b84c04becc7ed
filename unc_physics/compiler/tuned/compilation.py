"""Compilation once per combination of types, with our cache and with NamedTuples by reference."""

from functools import partial
from typing import Any

from numba import njit, types
from numba.core.dispatcher import Dispatcher

from .call_types import remembering
from .compile_cache import FOLDER, keep
from .frame_room import with_room
from .noinline import mark_noinline
from .references import referred, refers

__all__ = ["FOLDER", "STAGE_OPTIONS", "compile_function"]

_NO_REFERENCES: Any = {"_nrt": False}
_NO_PYTHON: Any = {"no_cpython_wrapper": True}
_ALWAYS: Any = {"nogil": True, "no_cfunc_wrapper": True}

#: Options of the functions that a `stage` chooses.
STAGE_OPTIONS: Any = _NO_REFERENCES | _NO_PYTHON | {"forceinline": True, "no_cfunc_wrapper": True}


def compile_function(function, *, arrays, python, noinline, **options) -> Any:
    """Return the compiled function; parameters are as in `decorators.kernel`.

    ``python`` is whether Python calls it. Python wrappers and reference counting are slow to compile.
    """
    if noinline:
        mark_noinline(function)
    settings = _ALWAYS | ({} if arrays else _NO_REFERENCES) | ({} if python else _NO_PYTHON) | options
    return keep(_taking_references(njit(**settings)(function)))


def _taking_references(compiled):
    """Make a compiled function take numbers by value and NamedTuples by reference.

    To numba, a literal number is a separate type, and so are all functions that receive it. A counter that
    starts at 0 would compile everything in a loop twice.
    """
    if isinstance(compiled, Dispatcher):  # a plain function with NUMBA_DISABLE_JIT
        template_of = compiled.get_call_template

        def get_call_template(args, kws):
            args = [types.unliteral(kind) for kind in args]
            kws = {name: types.unliteral(kind) for name, kind in kws.items()}
            found = template_of(
                [referred(kind) for kind in args], {name: referred(kind) for name, kind in kws.items()}
            )
            returned = [signature.return_type for signature in compiled.nopython_signatures]
            if compiled.targetoptions.get("_nrt") is False and any(map(_holds_arrays, returned)):
                raise TypeError(
                    f"{compiled.py_func.__qualname__} is an inner function and returns an array, whose"
                    " references it does not count: make it a kernel"
                )
            if any(map(refers, returned)):
                return template_of(args, kws)  # the returned value may outlive the reference
            return found

        compiled.get_call_template = get_call_template
        compiled.compile = partial(with_room, remembering, compiled.compile)
    return compiled


def _holds_arrays(kind):
    """Return whether a type is an array, or a tuple that contains one."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return any(map(_holds_arrays, parts))
    return isinstance(kind, types.Array)
