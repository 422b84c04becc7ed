"""Compilation by `numba.njit` with numba's cache: slower than the tuned one, for any supported numba.

numba checks the file of a cached function for changes, but not the functions that it calls. Therefore the
cache folder is named by a hash of all sources of this package.
"""

import contextlib
import hashlib
import sys
from typing import Any

import numba
import numpy
from numba import types

from .cache_folder import PACKAGE, find_folders


def _fingerprint():
    """Return a hash of the package's sources and of the versions that compile them."""
    versions = numba.__version__, numpy.__version__, sys.implementation.cache_tag
    digest = hashlib.sha256("\0".join(versions).encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(str(path.relative_to(PACKAGE)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


FOLDER, _ = find_folders(f"kernels-plain-{_fingerprint()}")

#: Options of `numba.njit` without reference counting, and for functions that Python does not call.
_NO_REFERENCES: Any = {"_nrt": False}
_NO_PYTHON: Any = {"no_cpython_wrapper": True}
_ALWAYS: Any = {"nogil": True, "no_cfunc_wrapper": True, "cache": FOLDER is not None}

#: Options of the functions that a `stage` chooses.
STAGE_OPTIONS: Any = _NO_REFERENCES | _NO_PYTHON | {"forceinline": True, "no_cfunc_wrapper": True}


def compile_function(function, *, arrays, python, noinline, **options) -> Any:
    """Return the compiled function; ``noinline`` has no effect.

    Plain numba passes a NamedTuple as several hundred numbers. Wrappers that unpack them, and reference
    counts, are omitted where possible. With them, a first implicit prediction takes four times as long to
    compile.
    """
    settings = _ALWAYS | ({} if arrays else _NO_REFERENCES) | ({} if python else _NO_PYTHON) | options
    with _cache_in_folder():
        return _taking_values(numba.njit(**settings)(function))


def _taking_values(compiled):
    """Make a compiled function take literal numbers by value.

    To numba, each literal number is a separate type. It would compile the function and its callees for each.
    """
    template_of = getattr(compiled, "get_call_template", None)
    if template_of is not None:  # None with NUMBA_DISABLE_JIT
        compiled.get_call_template = lambda args, kws: template_of(
            [types.unliteral(kind) for kind in args],
            {name: types.unliteral(kind) for name, kind in kws.items()},
        )
    return compiled


@contextlib.contextmanager
def _cache_in_folder():
    """Make numba use our folder for functions decorated in the ``with`` block only."""
    before = numba.config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
    numba.config.CACHE_DIR = str(FOLDER or before)  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before  # pyright: ignore[reportAttributeAccessIssue]
