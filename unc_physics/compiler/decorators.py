"""Decorators of compiled functions: `kernel`, `inner` and `stage`."""

from typing import Any

from numba.extending import overload

from .backend import STAGE_OPTIONS, compile_function
from .stage_work import WORK


def kernel(function=None, *, arrays=True, noinline=False, **options) -> Any:
    """Compile a function for Python and other compiled functions, with a cache and without the GIL.

    Parameters
    ----------
    function : function, optional
    arrays : bool, optional
        Whether it creates or returns arrays. Otherwise numba skips reference counting, which compiles faster.
    noinline : bool, optional
        Whether to compile it once and let callers call its address, instead of compiling it into each caller.
        For long functions, and for functions with many callers.
    **options
        Options of `numba.njit`.
    """
    return _decorated(function, arrays=arrays, python=True, noinline=noinline, **options)


def inner(function=None, *, noinline=False, **options) -> Any:
    """Compile a function that only compiled functions call, and that creates and returns no arrays.

    It has no Python wrapper; calling it from Python would crash. Parameters are as in `kernel`.
    """
    return _decorated(function, arrays=False, python=False, noinline=noinline, **options)


def _decorated(function, **options):
    if function is None:
        return lambda function: compile_function(function, **options)
    return compile_function(function, **options)


def stage(function) -> Any:
    """Make a function a stage of a time loop, at which a method adds its work; the default does nothing.

    The method is the first argument: None, or a NamedTuple of the method's data. A function decorated with
    ``@name_of_the_stage.of(Method)`` implements the stage for NamedTuples of that class. It is selected by
    type at compilation and becomes part of the loop's code. A loop without a method therefore compiles as if
    it had no stages.
    """
    work_of = {}

    def choose(method, *_):
        return work_of.get(getattr(method, "instance_class", None), function)

    def of(method):
        def register(work):
            work_of[method] = work
            WORK.setdefault(method, []).append(work)
            return work

        return register

    overload(function, strict=False, jit_options=STAGE_OPTIONS)(choose)
    function.of = of
    return function
