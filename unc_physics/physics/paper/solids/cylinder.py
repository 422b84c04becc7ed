"""Cylinder along the z axis, centred at the origin; its size is (radius, half length, 0) [m]."""

import math

from ....compiler import inner
from .direction import unit


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Compute distance and normal (`solids.surface`): to the nearest point outside, the nearest face inside.

    On the axis, the normal of the curved side is the x axis. If side and end are equally near, the side is
    used.
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
    """Return the bounding box (`solids.bounds`)."""
    r, half = size[e, 0], size[e, 1]
    return (-r, -r, -half), (r, r, half)
