"""Which spheres of a packing can touch a plane: those on its convex hull."""

import math

import numpy as np

from .arrays import booleans, empty, full, zeros
from .compiled import kernel

_DIRECTIONS, _ROUNDS = 4096, 700
_SHORTER = 0.99  # each step than the one before
_WAY = 1.0 / (1.0 - _SHORTER)  # of all steps that are left, in units of the next
_APART = 3.0 / math.sqrt(_DIRECTIONS)  # no direction is farther from all of these [rad]
# of the packing's radius: what sticks out less is inside, such as spheres that a flat face just touches
_TOLERANCE = 1e-8


@kernel
def hull_spheres(centers, radii):
    """Indices of the spheres that some plane touches before all others.

    Parameters
    ----------
    centers : (n, 3) array
        Body frame [m].
    radii : (n,) array
        [m]

    Returns
    -------
    (h,) int64 array
        Ascending.

    Notes
    -----
    The supports in many directions are found first. A sphere that lies so far below each that turning to the
    next direction does not bring it up is hidden: it comes up by its distance to the support times the angle.
    The others are compared with the supports in the direction in which each does best, improved step by step.
    """
    n = len(radii)
    size = 0.0
    for k in range(n):
        size = max(size, math.sqrt(centers[k, 0] ** 2 + centers[k, 1] ** 2 + centers[k, 2] ** 2) + radii[k])
    kept = booleans(n)
    lead, most, best = full(n, -np.inf), full(n, -np.inf), zeros((n, 3))
    height = empty(n)
    for d in range(_DIRECTIONS):
        z = 1.0 - (2.0 * d + 1.0) / _DIRECTIONS
        angle = math.pi * (1.0 + math.sqrt(5.0)) * d
        across = math.sqrt(1.0 - z * z)
        x, y = across * math.cos(angle), across * math.sin(angle)
        highest, support = -np.inf, 0
        for k in range(n):
            height[k] = x * centers[k, 0] + y * centers[k, 1] + z * centers[k, 2] + radii[k]
            if height[k] > highest:
                highest, support = height[k], k
        kept[support] = True
        for k in range(n):
            if height[k] - highest > lead[k]:
                lead[k] = height[k] - highest
                best[k, 0], best[k, 1], best[k, 2] = x, y, z
            u, v = centers[k, 0] - centers[support, 0], centers[k, 1] - centers[support, 1]
            w = centers[k, 2] - centers[support, 2]
            most[k] = max(most[k], height[k] - highest + _APART * math.sqrt(u * u + v * v + w * w))
    supports = np.flatnonzero(kept)
    for s in range(n):
        if kept[s] or most[s] < 0.0:
            continue
        x, y, z = best[s, 0], best[s, 1], best[s, 2]
        step = 0.05
        for _ in range(_ROUNDS):
            highest, support = -np.inf, 0
            for k in supports:
                up = x * centers[k, 0] + y * centers[k, 1] + z * centers[k, 2] + radii[k]
                if up > highest:
                    highest, support = up, k
            if (
                x * centers[s, 0] + y * centers[s, 1] + z * centers[s, 2] + radii[s] - highest
                > _TOLERANCE * size
            ):
                kept[s] = True
                break
            # towards the sphere and away from the support that hides it
            gx, gy = centers[s, 0] - centers[support, 0], centers[s, 1] - centers[support, 1]
            gz = centers[s, 2] - centers[support, 2]
            along = gx * x + gy * y + gz * z
            gx, gy, gz = gx - along * x, gy - along * y, gz - along * z
            length = math.sqrt(gx * gx + gy * gy + gz * gz)
            if length == 0.0:
                break
            below = highest - x * centers[s, 0] - y * centers[s, 1] - z * centers[s, 2] - radii[s]
            if below > _WAY * step * math.sqrt(length * length + along * along):
                break  # no step that is left brings it up
            x, y, z = x + step * gx / length, y + step * gy / length, z + step * gz / length
            length = math.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
            step *= _SHORTER
    return np.flatnonzero(kept)
