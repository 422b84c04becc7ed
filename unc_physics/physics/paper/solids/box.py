"""Box centred at the origin; its size is half its edge lengths [m]."""

import math

from ....compiler import inner


@inner(error_model="numpy", forceinline=True)
def surface(size, e, x, y, z):
    """Compute distance and normal, to the nearest point outside, the nearest face inside."""
    qx, qy, qz = abs(x) - size[e, 0], abs(y) - size[e, 1], abs(z) - size[e, 2]
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    if qx <= 0.0 and qy <= 0.0 and qz <= 0.0:
        if qx >= qy and qx >= qz:
            return qx, (sx, 0.0, 0.0)
        if qy >= qz:
            return qy, (0.0, sy, 0.0)
        return qz, (0.0, 0.0, sz)
    qx, qy, qz = max(qx, 0.0), max(qy, 0.0), max(qz, 0.0)
    # never 0: an outside point is beyond a face by at least one unit in the last place
    distance = math.sqrt(qx * qx + qy * qy + qz * qz)
    return distance, (sx * qx / distance, sy * qy / distance, sz * qz / distance)


@inner(forceinline=True)
def bounds(size, e):
    """Return the corners of the box (`solids.bounds`)."""
    return (-size[e, 0], -size[e, 1], -size[e, 2]), (size[e, 0], size[e, 1], size[e, 2])
