"""A cylinder about the z axis with half a ball on each end, its middle at the origin.

Its size is (radius, half the length of the straight part, 0) [m].
"""

from ...compiler import inner
from .direction import unit

NAME = "capsule"


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Distance and normal from the nearest point of the straight part's axis (`shapes.surface`).

    On that axis the normal is the x axis.
    """
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


@inner(forceinline=True)
def flat_side(size, e, mx, my, mz, rx, ry, rz):
    """None (`shapes.flat_side`)."""
    return -1, 0.0, 0.0
