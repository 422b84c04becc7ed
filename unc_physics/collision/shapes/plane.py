"""A half-space: the solid is where z <= 0."""

import math

from ...compiler import inner

NAME = "plane"


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Height of a point over the plane, and the z axis (`shapes.surface`)."""
    return z, (0.0, 0.0, 1.0)


@inner(forceinline=True)
def bounds(size, e):
    """Bounded from above only (`shapes.bounds`)."""
    return (-math.inf, -math.inf, -math.inf), (math.inf, math.inf, 0.0)


@inner(forceinline=True)
def thickness(size, e):
    """Nothing comes out at the other side of a half-space (`shapes.thickness`)."""
    return math.inf


@inner(forceinline=True)
def flat_side(size, e, mx, my, mz, rx, ry, rz):
    """The surface itself (`shapes.flat_side`)."""
    return 2, 1.0, 0.0
