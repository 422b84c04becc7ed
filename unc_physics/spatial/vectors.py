"""Arithmetic of vectors as tuples of three floats."""

import numpy as np

from ..compiler import inner


@inner(forceinline=True)
def dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner(forceinline=True)
def plus(a, b):
    """Return the sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inner(forceinline=True)
def minus(a, b):
    """Return the difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner(forceinline=True)
def times(s, a):
    """Return a scalar multiple."""
    return s * a[0], s * a[1], s * a[2]


@inner(forceinline=True)
def triple(row, at):
    """Return three entries of a row, from ``at`` on."""
    return row[at], row[at + 1], row[at + 2]


@inner(forceinline=True)
def three(array, row, column):
    """Return three columns of a row, from ``column`` on."""
    return array[row, column], array[row, column + 1], array[row, column + 2]


@inner(forceinline=True)
def single(v):
    """Return the first three entries in single precision."""
    return np.float32(v[0]), np.float32(v[1]), np.float32(v[2])
