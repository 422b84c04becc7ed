"""Shapes of the environment, one file each: what the kernels know of a solid, in its own frame.

A new shape is a file with a ``NAME`` and the functions ``surface``, ``bounds``, ``thickness`` and
``flat_side`` of a row of sizes, and an entry in `SHAPES`. All of them are convex.
"""

import math

from numba import njit

from ...compiler import kernel
from ...compiler.arrays import empty
from . import box, capsule, cylinder, plane, sphere

#: All shapes; the number of a shape's kind is its place here.
SHAPES = (plane, box, sphere, cylinder, capsule)
KINDS = {shape.NAME: kind for kind, shape in enumerate(SHAPES)}


def _by_kind(name, nothing):
    """The function of that name of element e's shape; ``nothing`` for an unknown kind, which no scene has."""

    @njit(nogil=True, forceinline=True)
    def chosen(kind, size, e, *point):
        return nothing

    for kind in reversed(range(len(SHAPES))):
        chosen = _either(kind, getattr(SHAPES[kind], name), chosen)
    return chosen


def _either(number, function, other):
    # without a cache of its own, which could not tell the shapes' functions apart: callers' caches hold its
    # code
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
    """Signed distance of a point from the surface of element e, and the surface's normal there.

    Outside, both come from the nearest point of the surface; inside, from its nearest face, ties to the
    lowest axis. They are defined everywhere: on an axis of symmetry as well, and in the middle.

    Parameters
    ----------
    kind : (E,) int64 array
        Of the elements, from `KINDS`.
    size : (E, 3) float64 array
        [m]; each shape's file says what its numbers are.
    e : int x, y, z : float
        The point, in the element's frame [m].

    Returns
    -------
    distance : float
        [m], negative inside.
    normal : tuple of 3 floats
        Unit vector out of the solid, in the element's frame.
    """
    return _surface(kind, size, e, x, y, z)


@kernel(arrays=False, forceinline=True)
def bounds(kind, size, e):
    """Lowest and highest corner of element e, in its own frame [m]; infinite where it has no end."""
    return _bounds(kind, size, e)


@kernel(arrays=False, forceinline=True)
def thickness(kind, size, e):
    """Largest distance from the surface inside element e [m]: what goes deeper comes out elsewhere."""
    return _thickness(kind, size, e)


@kernel(arrays=False, forceinline=True)
def flat_side(kind, size, e, mx, my, mz, rx, ry, rz):
    """Which flat side of element e is nearest to every point of a box: its distance is linear there.

    Parameters
    ----------
    kind, size, e
        As in `surface`.
    mx, my, mz, rx, ry, rz : float
        The box's middle, and half its sides, along the axes of the element's frame [m].

    Returns
    -------
    axis : int
        Of the side's normal; -1 where no flat side is nearest to all.
    sign : float
        1 or -1: which way the normal points.
    offset : float
        The side's distance from the origin [m].
    """
    return _flat_side(kind, size, e, mx, my, mz, rx, ry, rz)


@kernel
def surfaces(kind, size, e, points):
    """`surface` for points (n, 3): distances (n,) and normals (n, 3)."""
    distances, normals = empty(len(points)), empty((len(points), 3))
    for k in range(len(points)):
        distances[k], n = surface(kind, size, e, points[k, 0], points[k, 1], points[k, 2])
        normals[k, 0], normals[k, 1], normals[k, 2] = n
    return distances, normals
