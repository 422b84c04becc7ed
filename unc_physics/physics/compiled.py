"""How kernels are compiled: once for each combination of types, cached, without the interpreter's lock."""

from functools import partial
from typing import Any

from numba import njit, types
from numba.core.dispatcher import Dispatcher
from numba.extending import overload

from . import compile_time  # noqa: F401  (from the first kernel on)
from .by_reference import referred, refers
from .call_types import remembering
from .calls import stay_apart
from .compile_cache import keep
from .frame_room import with_room
from .kernel_stamp import WORK

#: No wrapper for Python, no counted references: both take long to compile.
_INNER: Any = {"_nrt": False, "no_cpython_wrapper": True}


def kernel(function=None, *, apart=False, **options):
    """A function that Python calls; with ``apart`` kernels call it by its address, however short it is."""
    return _compiled(function, options, apart)


def inner(function=None, **options):
    """A function that kernels alone call, that makes and returns no arrays; Python would crash with it."""
    return _compiled(function, _INNER | options)


def stage(function) -> Any:
    """A stage of a time loop, at which a method does work of its own; unless a method says so, nothing.

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

    overload(function, strict=False, jit_options=_INNER | {"forceinline": True, "no_cfunc_wrapper": True})(
        choose
    )
    function.of = of
    return function


def _compiled(function, options, apart=False) -> Any:  # numba's own types say little about what it compiles
    settings: Any = {"nogil": True, "no_cfunc_wrapper": True} | options

    def decorate(function):
        if apart:
            stay_apart(function)
        return keep(_taking_references(njit(**settings)(function)))

    return decorate if function is None else decorate(function)


def _taking_references(compiled):
    """A compiled function that takes numbers as values, and NamedTuples by reference.

    To numba a number that is written out is a type of its own, and so are all functions to which it is passed
    on: a counter that begins at 0 would compile all that is below a loop twice.
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
                return template_of(args, kws)  # what is returned may live longer than the reference
            return found

        compiled.get_call_template = get_call_template
        compiled.compile = partial(with_room, remembering, compiled.compile)
    return compiled


def _holds_arrays(kind):
    """Whether a value of a type is an array, or a tuple that holds one."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        return any(map(_holds_arrays, parts))
    return isinstance(kind, types.Array)
