"""Compilation is refused in a thread and in those that work for it, and loading is not."""

import numba
import numpy as np
import pytest

from unc_physics.compiler.refusal import CompilationRefused, refused_compilation
from unc_physics.compiler.threads import in_threads, watched


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
