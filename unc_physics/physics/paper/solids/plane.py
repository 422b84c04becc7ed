"""Half-space; the solid is z <= 0."""

import math

from ....compiler import inner


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Return the height of a point above the plane, and the z axis (`solids.surface`)."""
    return z, (0.0, 0.0, 1.0)


@inner(forceinline=True)
def bounds(size, e):
    """Return bounds that are finite only above (`solids.bounds`)."""
    return (-math.inf, -math.inf, -math.inf), (math.inf, math.inf, 0.0)
