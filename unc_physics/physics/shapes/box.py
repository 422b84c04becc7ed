"""A box about the origin; its size is half its edge lengths [m]."""

import math

from ..compiled import inner

NAME = "box"


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Distance and normal by the nearest point outside, by the nearest face inside (`shapes.surface`)."""
    qx, qy, qz = abs(x) - size[e, 0], abs(y) - size[e, 1], abs(z) - size[e, 2]
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
        if qx >= qy and qx >= qz:
            return qx, (sx, 0.0, 0.0)
        if qy >= qz:
            return qy, (0.0, sy, 0.0)
        return qz, (0.0, 0.0, sz)
    qx, qy, qz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    # never 0: what lies outside is beyond a face by a unit in the last place at least
    distance = math.sqrt(qx * qx + qy * qy + qz * qz)
    return distance, (sx * qx / distance, sy * qy / distance, sz * qz / distance)


@inner(forceinline=True)
def bounds(size, e):
    """The box itself (`shapes.bounds`)."""
    return (-size[e, 0], -size[e, 1], -size[e, 2]), (size[e, 0], size[e, 1], size[e, 2])


@inner(forceinline=True)
def thickness(size, e):
    """Half the shortest edge (`shapes.thickness`)."""
    return min(size[e, 0], min(size[e, 1], size[e, 2]))
