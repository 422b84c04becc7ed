"""The arrays that kernels make.

numba compiles its own functions for this anew for each mix of written-out and computed lengths, and makes
them part of each caller. These are compiled once for each number of dimensions, and are not inlined.
"""

import numpy as np

from .decorators import inner, kernel


@kernel(noinline=True)
def empty(shape):
    """Numbers of no value yet."""
    return np.empty(shape)


@kernel(noinline=True)
def zeros(shape):
    """Zeros."""
    return np.zeros(shape)


@kernel(noinline=True)
def aligned_zeros(shape):
    """Zeros whose first one begins a line of the cache (64 bytes): eight of them are then read at once."""
    size = 1
    for count in shape:
        size *= count
    room = np.zeros(size + 7)
    first = -(room.ctypes.data // 8) % 8
    return room[first : first + size].reshape(shape)


@kernel(noinline=True)
def full(shape, value):
    """The same number everywhere."""
    return np.full(shape, value)


@kernel(noinline=True)
def integers(shape):
    """Zeros of 64 bits."""
    return np.zeros(shape, np.int64)


@kernel(noinline=True)
def small_integers(shape):
    """Zeros of 32 bits."""
    return np.zeros(shape, np.int32)


@kernel(noinline=True)
def singles(shape):
    """Zeros in single precision."""
    return np.zeros(shape, np.float32)


@kernel(noinline=True)
def booleans(shape):
    """False everywhere."""
    return np.zeros(shape, np.bool_)


@inner
def assign(target, source):
    """``target[:] = source`` of matrices of one shape; numba would compile a message for other ones."""
    for i in range(len(source)):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]
