"""Stamp of a kernel: a text that depends exactly on the inputs of its compiled code.

numba notices edits of the file with a function, but not of functions that it calls. A stamp is a digest of
the byte code of a function and its callees. It includes the constants and types that they name, and compile
options. Comments, docstrings and line numbers do not affect it.
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

#: Versions of these are part of the folder's name.
_OTHERS = {*sys.stdlib_module_names, "numba", "numpy", "llvmlite"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...), slice, np.generic, types.Type)


def stamp(function, signature=()):
    """Return the stamp of a kernel.

    Parameters
    ----------
    function : function
        The plain function.
    signature : iterable of numba types
        Types of its arguments; methods among them determine the stages.

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
    """Yield the classes of NamedTuples in a numba type."""
    kind = getattr(kind, "of", kind)  # of a reference
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        yield kind.instance_class
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        for part in parts:
            yield from _named_tuples(part)


def _meet(value, met):
    """Add the digests of a function or NamedTuple, and of everything that it names, once each."""
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
    """Yield global values that a function's code names, directly or through modules."""
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
    """Return the names in a function's code and the code without docstring, with nested functions."""
    names = list(code.co_names)
    parts = [code.co_code, repr((code.co_names, code.co_varnames, code.co_freevars))]
    for place, constant in enumerate(code.co_consts):
        if isinstance(constant, CodeType):
            more_names, more_parts = _read(constant)
            names, parts = names + more_names, parts + more_parts
        elif place > 0 or not isinstance(constant, str):
            parts.append(_in_order(constant))
    return names, parts


def _text(value) -> Any:
    """Return a process-independent text of a value that code names, or None if kernels cannot use it."""
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
    """Return the text of a constant; the order of sets differs between processes."""
    return repr(sorted(constant, key=repr) if isinstance(constant, set | frozenset) else constant)


def _is_named_tuple(value):
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")


def _is_of_others(value):
    module = value.__name__ if isinstance(value, ModuleType) else value.__module__ or ""
    return module.partition(".")[0] in _OTHERS


def _file(function):
    """Return the content of a function's file, as the code may depend on parts that are not analysed."""
    return Path(function.__code__.co_filename).read_bytes()


def _digest(*parts):
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else part.encode()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.digest()
