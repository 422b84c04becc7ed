"""All points near a piece of the z axis, its middle at the origin; the size is (radius, half the piece's length, 0) [m]."""

from ..compiled import inner
from .direction import unit

NAME = "capsule"


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Distance and normal from the nearest point of the piece of the axis; on it the normal is the x axis (`shapes.surface`)."""
    half = size[e, 1]
    length, normal = unit(x, y, z - min(max(z, -half), half))
    return length - size[e, 0], normal


@inner(forceinline=True)
def bounds(size, e):
    """The box about the capsule (`shapes.bounds`)."""
    r, half = size[e, 0], size[e, 0] + size[e, 1]
    return (-r, -r, -half), (r, r, half)


@inner(forceinline=True)
def thickness(size, e):
    """The radius (`shapes.thickness`)."""
    return size[e, 0]
