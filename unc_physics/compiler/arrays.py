"""Array constructors for kernels.

numba compiles its own constructors again for each mix of constant and variable lengths, as part of each
caller. These functions are compiled once for each number of dimensions, and are not inlined.
"""

import numpy as np

from .decorators import inner, kernel


@kernel(noinline=True)
def empty(shape):
    """Return an uninitialized array."""
    return np.empty(shape)


@kernel(noinline=True)
def zeros(shape):
    """Return an array of zeros."""
    return np.zeros(shape)


@kernel(noinline=True)
def full(shape, value):
    """Return an array with equal entries."""
    return np.full(shape, value)


@kernel(noinline=True)
def integers(shape):
    """Return 64-bit integer zeros."""
    return np.zeros(shape, np.int64)


@kernel(noinline=True)
def small_integers(shape):
    """Return 32-bit integer zeros."""
    return np.zeros(shape, np.int32)


@kernel(noinline=True)
def singles(shape):
    """Return single-precision zeros."""
    return np.zeros(shape, np.float32)


@kernel(noinline=True)
def booleans(shape):
    """Return an array of False."""
    return np.zeros(shape, np.bool_)


@inner
def assign(target, source):
    """Copy a matrix, as ``target[:] = source``; numba would compile an error message for unequal shapes."""
    for i in range(len(source)):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]
