"""Compilation by `numba.njit`, with numba's own cache: slower than the tuned one, for any supported numba.

numba checks the file of a cached function for changes, but not the functions that it calls. The folder of the
cache is therefore named by a hash of all sources of this package.
"""

import contextlib
import hashlib
import sys
from typing import Any

import numba
import numpy

from .cache_folder import PACKAGE, find_folders


def _fingerprint():
    """Return a hash of the package's sources and of the versions that compile them."""
    versions = numba.__version__, numpy.__version__, sys.implementation.cache_tag
    digest = hashlib.sha256("\0".join(versions).encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(str(path.relative_to(PACKAGE)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


FOLDER, _ = find_folders(f"kernels-plain-{_fingerprint()}")

#: Options of the functions that a `stage` chooses.
STAGE_OPTIONS: Any = {"forceinline": True}


def compile_function(function, *, arrays, python, noinline, **options) -> Any:
    """Return the compiled function; numba decides about references, wrappers and calls."""
    with _cache_in_folder():
        return numba.njit(nogil=True, cache=FOLDER is not None, **options)(function)


@contextlib.contextmanager
def _cache_in_folder():
    """Let numba choose our folder for the functions that are decorated inside, and for no others."""
    before = numba.config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
    numba.config.CACHE_DIR = str(FOLDER or before)  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before  # pyright: ignore[reportAttributeAccessIssue]
