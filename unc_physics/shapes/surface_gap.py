"""Distances of a body's surface from its packing."""

from __future__ import annotations

import numpy as np

from ..compiler import kernel
from .sphere_grid import empty_grid, grown, insert_spheres, nearest_sphere

ACCURACY = 0.01  # of the gap
STACK = 256  # halves of triangles waiting: each halving adds one, so the limit is never met


def surface_gap(corners, spheres) -> float:
    """Return the farthest that a point of a surface lies from the nearest sphere [m].

    ``corners`` (m, 3, 3) are those of the surface's triangles, and ``spheres`` (n, 4) centres and radii [m].
    It is an upper bound, at most 1 % above the gap.
    """
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = float(np.max(upper - lower))
    reach = 0.25 * size / np.cbrt(len(spheres))  # a guess, doubled until it is enough
    spheres = np.ascontiguousarray(spheres)
    while True:
        grid = empty_grid(lower, upper, reach, reach, 8 * len(spheres) + 1000)
        inserted = 0
        while inserted < len(spheres):
            inserted = insert_spheres(grid, spheres, inserted, len(spheres))
            if inserted < len(spheres):
                grid = grown(grid)
        gap = bounded_gap(grid, spheres, corners)
        if gap < reach or reach > 2.0 * size:
            return float(gap)
        reach *= 2.0


@kernel
def bounded_gap(grid, spheres, corners):
    """Return an upper bound of the gap by branch and bound, or the grid's reach if a point is beyond it.

    The distance to one sphere is convex. Over a triangle, the distance to the packing is therefore at most
    that of the farthest corner from the sphere that is nearest to the middle. Triangles that may hold more
    than the gap found so far are halved.
    """
    stack = np.empty((STACK, 3, 3))
    middle = np.empty(3)
    gap = 0.0
    bound = 0.0
    for i in range(len(corners)):
        copy_triangle(corners[i], stack[0])
        top = 1
        while top > 0:
            t = stack[top - 1]
            for axis in range(3):
                middle[axis] = (t[0, axis] + t[1, axis] + t[2, axis]) / 3.0
            d, nearest = nearest_sphere(grid, spheres, middle[0], middle[1], middle[2], -1)
            if d >= grid.reach:
                return grid.reach
            gap = max(gap, d)
            # in a cell that a sphere covers, it is not named: the distance to the middle stands for it
            cx, cy, cz, r = middle[0], middle[1], middle[2], -d
            if nearest >= 0:
                cx, cy, cz = spheres[nearest, 0], spheres[nearest, 1], spheres[nearest, 2]
                r = spheres[nearest, 3]
            far = 0.0
            for corner in range(3):
                x, y, z = t[corner, 0] - cx, t[corner, 1] - cy, t[corner, 2] - cz
                far = max(far, x * x + y * y + z * z)
            most = np.sqrt(far) - r
            if most <= gap * (1.0 + ACCURACY) or top == STACK:
                bound = max(bound, most)
                top -= 1
                continue
            a = distance_squared(t[0], t[1])
            b = distance_squared(t[1], t[2])
            c = distance_squared(t[2], t[0])
            one = 0 if a >= b and a >= c else (1 if b >= c else 2)
            two = (one + 1) % 3
            other = stack[top]
            copy_triangle(t, other)
            for axis in range(3):
                half = 0.5 * (t[one, axis] + t[two, axis])
                t[one, axis] = half
                other[two, axis] = half
            top += 1
    return bound


@kernel
def copy_triangle(source, target):
    for corner in range(3):
        for axis in range(3):
            target[corner, axis] = source[corner, axis]


@kernel
def distance_squared(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
