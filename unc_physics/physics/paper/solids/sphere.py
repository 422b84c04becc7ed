"""Ball centred at the origin; its size is (radius, 0, 0) [m]."""

from ....compiler import inner
from .direction import unit


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Compute distance and outward normal, which is the x axis at the centre (`solids.surface`)."""
    length, normal = unit(x, y, z)
    return length - size[e, 0], normal


@inner(forceinline=True)
def bounds(size, e):
    """Return the bounding cube (`solids.bounds`)."""
    r = size[e, 0]
    return (-r, -r, -r), (r, r, r)
