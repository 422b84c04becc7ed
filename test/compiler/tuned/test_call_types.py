"""The compiler finds the type of a call once, while it compiles our kernels alone."""

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError
from numba.core.types.functions import BaseFunction

from unc_physics.compiler import kernel
from unc_physics.compiler.tuned import compile_cache
from unc_physics.compiler.tuned.call_types import remembering

FIND = BaseFunction.get_call_type


@pytest.fixture
def asked(monkeypatch):
    """Calls for which numba's own search was asked: the called function, and types of arguments."""
    calls = []

    def find(called, context, args, kws):
        calls.append((called, tuple(args)))
        return FIND(called, context, args, kws)

    find.__module__ = FIND.__module__
    monkeypatch.setattr(BaseFunction, "get_call_type", find)
    monkeypatch.setattr(compile_cache, "_FOLDERS", [])  # what is loaded asks for nothing
    return calls


def many(x, y):
    return x * y + x * y + x * y + x * y + x * y


def test_a_kernel_asks_once_for_each_combination_of_types(asked):
    assert kernel(many)(2.0, 3.0) == 30.0
    assert asked
    assert len(set(asked)) == len(asked)


def test_other_code_than_ours_is_compiled_as_before(asked):
    assert njit(many)(2.0, 3.0) == 30.0
    assert len(set(asked)) < len(asked)


def test_types_that_differ_have_calls_of_their_own():
    @kernel
    def both(i, x, a):
        return i + i, x + x, (a + a)[0], i + x

    whole, real, item, mixed = both(2, 0.25, np.array([1.5]))
    assert (whole, real, item, mixed) == (4, 0.5, 3.0, 2.25)
    assert isinstance(whole, int)


def test_what_it_replaces_is_there_again_after_an_error():
    @kernel
    def wrong(x):
        return x + "text"

    with pytest.raises(TypingError):
        wrong(1.0)
    assert BaseFunction.get_call_type is FIND
    with pytest.raises(ZeroDivisionError):
        remembering(divmod, 1, 0)
    assert BaseFunction.get_call_type is FIND
    assert remembering(divmod, 7, 2) == (3, 1)
