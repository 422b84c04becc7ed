"""Ball centred at the origin; its size is (radius, 0, 0) [m]."""

from ....compiler import inner
from .direction import unit


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Compute distance and outward normal, which is the x axis at the centre (`shapes.surface`)."""
    length, normal = unit(x, y, z)
    return length - size[e, 0], normal


@inner(forceinline=True)
def bounds(size, e):
    """Return the bounding cube (`shapes.bounds`)."""
    r = size[e, 0]
    return (-r, -r, -r), (r, r, r)


@inner(forceinline=True)
def thickness(size, e):
    """Return the radius (`shapes.thickness`)."""
    return size[e, 0]


@inner(forceinline=True)
def flat_side(size, e, mx, my, mz, rx, ry, rz):
    """Return -1: a ball has no flat side (`shapes.flat_side`)."""
    return -1, 0.0, 0.0
