"""A text that changes with whatever the compiled code of a kernel depends on, and with nothing else.

numba notices an edit of the file that holds a function, not one of the functions that it calls. A stamp is
made of the byte code of a function and of all that it calls, of the constants and types that they name, and
of how each is compiled. Comments, docstrings and the places of lines do not count.
"""

import hashlib
import sys
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.extending import _Intrinsic

from ..stage_work import WORK
from .noinline import is_noinline

#: The versions of these are in the name of the kernels' folder.
_OTHERS = {*sys.stdlib_module_names, "numba", "numpy", "llvmlite"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...), slice, np.generic, types.Type)


def stamp(function, signature=()):
    """The stamp of a kernel.

    Parameters
    ----------
    function : function
        The plain function.
    signature : iterable of numba types
        Of its arguments: methods among them choose what stages do.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    met: dict[int, bytes] = {}
    _meet(function, met)
    for kind in signature:
        for method in _named_tuples(kind):
            _meet(method, met)
    return _digest(*sorted(met.values())).hex()[:16]


def _named_tuples(kind):
    """Classes of the NamedTuples in a numba type."""
    kind = getattr(kind, "of", kind)  # of a reference
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        yield kind.instance_class
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        for part in parts:
            yield from _named_tuples(part)


def _meet(value, met):
    """Add the digests of a function or NamedTuple, and of all that it names, each once."""
    if id(value) in met:
        return
    if isinstance(value, Dispatcher):
        options = sorted((key, _in_order(option)) for key, option in value.targetoptions.items())
        met[id(value)] = _digest(_text(value), repr((options, is_noinline(value.py_func))))
        _meet(value.py_func, met)
    elif isinstance(value, _Intrinsic):
        _meet(value._defn, met)
    elif isinstance(value, tuple):
        for part in value:
            _meet(part, met)
    elif _is_named_tuple(value):
        met[id(value)] = _digest(_text(value), *value._fields)
        for work in WORK.get(value, ()):
            _meet(work, met)
    elif isinstance(value, FunctionType) and not _is_of_others(value):
        names, parts = _read(value.__code__)
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        globals_ = list(_globals(value, names))
        met[id(value)] = b""  # it may call itself
        for name, named in [*((None, cell) for cell in cells), *globals_]:
            text = _text(named)
            parts += [str(name), text if text is not None else _file(value)]
            _meet(named, met)
        met[id(value)] = _digest(_text(value), *parts, repr(value.__defaults__))


def _globals(function, names):
    """Global values that a function's code names, and those in modules that it names."""
    spaces = [function.__globals__]
    for space in spaces:
        for name in names:
            if name in space:
                value = space[name]
                if not isinstance(value, ModuleType):
                    yield name, value
                elif not _is_of_others(value) and vars(value) not in spaces:
                    spaces.append(vars(value))


def _read(code: CodeType):
    """Names in a function's code and in that of functions in it; the code itself, without its docstring."""
    names, parts = list(code.co_names), [code.co_code, repr((code.co_varnames, code.co_freevars))]
    for place, constant in enumerate(code.co_consts):
        if isinstance(constant, CodeType):
            more_names, more_parts = _read(constant)
            names, parts = names + more_names, parts + more_parts
        elif place > 0 or not isinstance(constant, str):
            parts.append(_in_order(constant))
    return names, parts


def _text(value) -> Any:
    """Text of a value that code names, the same in each process; None of one that kernels cannot use."""
    if isinstance(value, _PLAIN):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {_digest(value.tobytes()).hex()}"
    if isinstance(value, tuple):
        parts = [_text(part) for part in value]
        return None if None in parts else repr(parts)
    if isinstance(value, Dispatcher):
        return "compiled " + _text(value.py_func)
    if isinstance(value, _Intrinsic):
        return "intrinsic " + _text(value._defn)
    if isinstance(value, type | FunctionType | BuiltinFunctionType):
        return f"{value.__module__}.{value.__qualname__}"
    return f"ufunc {value.__name__}" if isinstance(value, np.ufunc) else None


def _in_order(constant):
    """Text of a constant; processes differ in the order of sets."""
    return repr(sorted(constant, key=repr) if isinstance(constant, set | frozenset) else constant)


def _is_named_tuple(value):
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")


def _is_of_others(value):
    module = value.__name__ if isinstance(value, ModuleType) else value.__module__ or ""
    return module.partition(".")[0] in _OTHERS


def _file(function):
    """All of a function's file: the code may depend on what is not understood here."""
    return Path(function.__code__.co_filename).read_bytes()


def _digest(*parts):
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else part.encode()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.digest()
