"""Shapes of the environment, one module each, with the solid in its own frame.

To add a shape, write a module with the functions ``surface``, ``bounds``, ``thickness`` and ``flat_side``.
Their argument is a row of sizes. Then add the module's name to `NAMES`. All shapes must be convex.
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
_thickness = _by_kind("thickness", math.inf)
_flat_side = _by_kind("flat_side", (-1, 0.0, 0.0))


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


@kernel(arrays=False, forceinline=True)
def thickness(kind, size, e):
    """Return the largest depth inside element e [m]; a deeper sphere exits on the other side."""
    return _thickness(kind, size, e)


@kernel(arrays=False, forceinline=True)
def flat_side(kind, size, e, mx, my, mz, rx, ry, rz):
    """Find the flat side of element e that is nearest to every point of a box; its distance is linear there.

    Parameters
    ----------
    kind, size, e
        As in `surface`.
    mx, my, mz, rx, ry, rz : float
        Centre of the box, and half its sides, along the element's axes [m].

    Returns
    -------
    axis : int
        Axis of the side's normal; -1 if no flat side is nearest to all points.
    sign : float
        1 or -1, the sign of the normal along the axis.
    offset : float
        Distance of the side from the origin [m].
    """
    return _flat_side(kind, size, e, mx, my, mz, rx, ry, rz)


@kernel
def surfaces(kind, size, e, points):
    """Compute `surface` for points (n, 3): distances (n,) and normals (n, 3)."""
    distances, normals = empty(len(points)), empty((len(points), 3))
    for k in range(len(points)):
        distances[k], n = surface(kind, size, e, points[k, 0], points[k, 1], points[k, 2])
        normals[k, 0], normals[k, 1], normals[k, 2] = n
    return distances, normals
