"""Decorators of compiled functions: `kernel`, `inner` and `stage`."""

from typing import Any

from numba.extending import overload

from .backend import STAGE_OPTIONS, compile_function
from .stage_work import WORK


def kernel(function=None, *, arrays=True, noinline=False, **options) -> Any:
    """Compile a function that Python and other compiled functions call, with a cache and without the GIL.

    Parameters
    ----------
    function : function, optional
    arrays : bool, optional
        Whether it makes or returns arrays. Without them numba counts no references, which compiles faster.
    noinline : bool, optional
        Compile it once, and let callers call it by its address, instead of compiling it into each caller.
        For long functions, and for functions with many callers.
    **options
        Of `numba.njit`.
    """
    return _decorated(function, arrays=arrays, python=True, noinline=noinline, **options)


def inner(function=None, *, noinline=False, **options) -> Any:
    """Compile a function that only compiled functions call, and that makes and returns no arrays.

    It has no wrapper for Python, which would crash calling it. Parameters as in `kernel`.
    """
    return _decorated(function, arrays=False, python=False, noinline=noinline, **options)


def _decorated(function, **options):
    if function is None:
        return lambda function: compile_function(function, **options)
    return compile_function(function, **options)


def stage(function) -> Any:
    """Make a function a stage of a time loop, at which a method does work of its own; by default nothing.

    The method is the first argument: None, or a NamedTuple of what the method works on. A function decorated
    with ``@name_of_the_stage.of(Method)`` is the stage's work for NamedTuples of that class. It is chosen by
    type when the loop is compiled, and becomes part of the loop's code, so that a loop without a method is
    compiled as if it had no stages.
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
