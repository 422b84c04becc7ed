"""A cylinder about the z axis, its middle at the origin; its size is (radius, half length, 0) [m]."""

import math

from ...compiler import inner
from .direction import unit

NAME = "cylinder"


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Distance and normal by the nearest point outside, by the nearest face inside (`shapes.surface`).

    On the axis the side's normal is the x axis. Where the side and a flat end are equally near, the side
    counts.
    """
    length, out = unit(x, y, 0.0)
    radial, axial = length - size[e, 0], abs(z) - size[e, 1]
    end = math.copysign(1.0, z)
    if radial <= 0.0 and axial <= 0.0:
        if radial >= axial:
            return radial, (out[0], out[1], 0.0)
        return axial, (0.0, 0.0, end)
    distance, n = unit(max(radial, 0.0), 0.0, max(axial, 0.0))
    return distance, (n[0] * out[0], n[0] * out[1], n[2] * end)


@inner(forceinline=True)
def bounds(size, e):
    """The box about the cylinder (`shapes.bounds`)."""
    r, half = size[e, 0], size[e, 1]
    return (-r, -r, -half), (r, r, half)


@inner(forceinline=True)
def thickness(size, e):
    """The radius or half the length, whichever is less (`shapes.thickness`)."""
    return min(size[e, 0], size[e, 1])


@inner(forceinline=True)
def flat_side(size, e, mx, my, mz, rx, ry, rz):
    """The end that all of the points are over (`shapes.flat_side`)."""
    x, y = abs(mx) + rx, abs(my) + ry
    if abs(mz) - rz > size[e, 1] and x * x + y * y <= size[e, 0] ** 2:
        return 2, math.copysign(1.0, mz), size[e, 1]
    return -1, 0.0, 0.0
