"""Shapes of the environment, one module each, with the solid in its own frame.

To add a shape, write a module with the functions ``surface`` and ``bounds``. Their argument is a row
of sizes. Then add the module's name to `NAMES`. All shapes must be convex.
"""

import math
from importlib import import_module

from numba import njit

from ....compiler import kernel
from ....compiler.arrays import empty

#: Names of all shapes and of their modules; the index is the number of the shape's kind.
NAMES = "plane", "box", "sphere", "cylinder", "capsule"
SHAPES = tuple(import_module(f".{name}", __name__) for name in NAMES)
KINDS = {name: kind for kind, name in enumerate(NAMES)}


def _by_kind(name, nothing):
    """Return a function that dispatches on element e's kind; unknown kinds return ``nothing``."""

    @njit(nogil=True, forceinline=True)
    def chosen(kind, size, e, *point):
        return nothing

    for kind in reversed(range(len(SHAPES))):
        chosen = _either(kind, getattr(SHAPES[kind], name), chosen)
    return chosen


def _either(number, function, other):
    # not cached separately: the cache could not distinguish the shapes' functions, and callers' caches
    # include it
    @njit(nogil=True, forceinline=True)
    def either(kind, size, e, *point):
        if kind[e] == number:
            return function(size, e, *point)
        return other(kind, size, e, *point)

    return either


_surface = _by_kind("surface", (math.inf, (0.0, 0.0, 1.0)))
_bounds = _by_kind("bounds", ((math.inf,) * 3, (-math.inf,) * 3))


@kernel(arrays=False, error_model="numpy", forceinline=True)
def surface(kind, size, e, x, y, z):
    """Compute the signed distance of a point from the surface of element e, and the surface normal.

    Outside, both refer to the nearest point of the surface. Inside, they refer to the nearest face; ties go
    to the lowest axis. They are defined everywhere, including axes of symmetry and the centre.

    Parameters
    ----------
    kind : (E,) int64 array
        Kinds of the elements, from `KINDS`.
    size : (E, 3) float64 array
        Sizes [m], as defined in each shape's module.
    e : int
    x, y, z : float
        The point, in the element's frame [m].

    Returns
    -------
    distance : float
        [m], negative inside.
    normal : tuple of 3 floats
        Outward unit vector, in the element's frame.
    """
    return _surface(kind, size, e, x, y, z)


@kernel(arrays=False, forceinline=True)
def bounds(kind, size, e):
    """Return the lowest and highest corner of element e, in its own frame [m]; infinite where unbounded."""
    return _bounds(kind, size, e)


@kernel
def surfaces(kind, size, e, points):
    """Compute `surface` for points (n, 3): distances (n,) and normals (n, 3)."""
    distances, normals = empty(len(points)), empty((len(points), 3))
    for k in range(len(points)):
        distances[k], n = surface(kind, size, e, points[k, 0], points[k, 1], points[k, 2])
        normals[k, 0], normals[k, 1], normals[k, 2] = n
    return distances, normals
