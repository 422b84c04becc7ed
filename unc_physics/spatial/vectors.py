"""Arithmetic of vectors that are tuples of three floats."""

import numpy as np

from ..compiler import inner


@inner(forceinline=True)
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner(forceinline=True)
def plus(a, b):
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inner(forceinline=True)
def minus(a, b):
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner(forceinline=True)
def times(s, a):
    """Multiple."""
    return s * a[0], s * a[1], s * a[2]


@inner(forceinline=True)
def triple(row, at):
    """Three entries of a row, from ``at`` on."""
    return row[at], row[at + 1], row[at + 2]


@inner(forceinline=True)
def vector(array, row, column):
    """Three rows of a column, from ``row`` on."""
    return array[row, column], array[row + 1, column], array[row + 2, column]


@inner(forceinline=True)
def three(array, row, column):
    """Three columns of a row, from ``column`` on."""
    return array[row, column], array[row, column + 1], array[row, column + 2]


@inner(forceinline=True)
def put(array, row, column, a):
    """Write a vector into three rows of a column, from ``row`` on."""
    array[row, column], array[row + 1, column], array[row + 2, column] = a[0], a[1], a[2]


@inner(forceinline=True)
def single(v):
    """The first three numbers, in single precision."""
    return np.float32(v[0]), np.float32(v[1]), np.float32(v[2])
