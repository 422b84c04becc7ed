"""Compilation is refused in a thread and in those that work for it, and loading is not."""

import numba
import numpy as np
import pytest

from unc_physics.compiler.refusal import CompilationRefused, refused_compilation
from unc_physics.compiler.threads import in_threads, watched
from unc_physics.compiler.tuned import compile_cache


def fresh():
    """Return a function that is not compiled yet."""
    return numba.njit(lambda x: np.sort(x).sum())


@pytest.mark.parametrize("count", [1, 8, 200])
def test_a_kernel_is_not_compiled_where_that_is_refused(count):
    kernel, values = fresh(), np.arange(3.0)
    with watched(lambda: None):
        with pytest.raises(CompilationRefused), refused_compilation():
            in_threads(count, lambda some: kernel(values))
        in_threads(count, lambda some: kernel(values))
        with refused_compilation():  # compiled now
            in_threads(count, lambda some: kernel(values))
    assert kernel(values) == 3.0


def test_a_refused_kernel_stays_free_for_others_to_compile(monkeypatch):
    """A worker that held its lock kept the process that compiles for all waiting for five minutes."""
    kernel, locked = fresh(), []
    monkeypatch.setattr(compile_cache, "_FOLDERS", [])
    monkeypatch.setattr(compile_cache._KernelCache, "_locks", lambda self, sig: locked.append(sig) or True)
    monkeypatch.setattr(compile_cache._KernelCache, "save_overload", lambda self, sig, data: None)
    kernel._cache = compile_cache._KernelCache(kernel.py_func)
    with pytest.raises(CompilationRefused), refused_compilation():
        kernel(np.arange(3.0))
    assert not locked
    assert kernel(np.arange(3.0)) == 3.0 and locked
