"""How kernels are compiled: once per combination of types, into a cache on disk, without the interpreter's lock."""

from numba import njit

from . import compile_time  # noqa: F401  (from the first kernel on)
from .compile_cache import keep


def kernel(function=None, **options):
    """A function that Python calls."""
    return _compiled(function, options)


def inner(function=None, **options):
    """A function that kernels alone call, and that allocates nothing: no wrapper for Python, no counted references.

    Both take long to compile, and a call from Python would end the process.
    """
    return _compiled(function, {"_nrt": False, "no_cpython_wrapper": True} | options)


def _compiled(function, options):
    def decorate(function):
        return keep(njit(nogil=True, no_cfunc_wrapper=True, **options)(function))

    return decorate if function is None else decorate(function)
