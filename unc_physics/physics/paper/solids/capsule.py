"""Cylinder along the z axis with hemispherical ends, centred at the origin.

Its size is (radius, half the length of the straight part, 0) [m].
"""

from ....compiler import inner
from .direction import unit


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Compute distance and normal from the nearest point of the axis segment (`solids.surface`).

    On the axis the normal is the x axis.
    """
    half = size[e, 1]
    length, normal = unit(x, y, z - min(max(z, -half), half))
    return length - size[e, 0], normal


@inner(forceinline=True)
def bounds(size, e):
    """Return the bounding box (`solids.bounds`)."""
    r, half = size[e, 0], size[e, 0] + size[e, 1]
    return (-r, -r, -half), (r, r, half)
