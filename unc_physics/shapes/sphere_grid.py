"""Distance from a point to the nearest of many disjoint spheres, by a grid of cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiler import kernel

EMPTY = -1
COVERED = -2  # the whole cell lies inside one sphere


class SphereGrid(NamedTuple):
    """Cells, each with a linked list of the spheres within ``reach`` of the cell."""

    lower: np.ndarray  # (3,) corner of the first cell
    inverse_width: float
    reach: float  # queries are exact up to this distance
    heads: np.ndarray  # (nx, ny, nz) int32, first entry of each cell's list, or EMPTY, or COVERED
    entries: np.ndarray  # (capacity, 2) int32: sphere, next entry
    used: np.ndarray  # (1,) int64


def empty_grid(lower, upper, width, reach, capacity) -> SphereGrid:
    """Return a grid without spheres over the box from ``lower`` to ``upper``."""
    cells = np.maximum(1, np.ceil((upper - lower) / width)).astype(int)
    heads = np.full(cells, EMPTY, dtype=np.int32)
    return SphereGrid(
        lower, 1.0 / width, reach, heads, np.empty((capacity, 2), np.int32), np.zeros(1, np.int64)
    )


def grown(grid) -> SphereGrid:
    """Return the same grid with room for twice as many entries."""
    return grid._replace(entries=np.concatenate([grid.entries, np.empty_like(grid.entries)]))


@kernel
def cell_range(grid, axis, low, high):
    """Return the first and last cell that the interval from ``low`` to ``high`` touches along an axis."""
    last = grid.heads.shape[axis] - 1
    first_cell = int(np.floor((low - grid.lower[axis]) * grid.inverse_width))
    last_cell = int(np.floor((high - grid.lower[axis]) * grid.inverse_width))
    return max(0, min(last, first_cell)), max(0, min(last, last_cell))


@kernel
def insert_sphere(grid, spheres, index):
    """Enter a sphere in all cells that have a point outside it and within reach of it.

    Returns False, without changing the lists, if there is not enough room for the entries.
    """
    cx, cy, cz, r = spheres[index, 0], spheres[index, 1], spheres[index, 2], spheres[index, 3]
    outer = r + grid.reach
    width = 1.0 / grid.inverse_width
    before = grid.used[0]
    i0, i1 = cell_range(grid, 0, cx - outer, cx + outer)
    j0, j1 = cell_range(grid, 1, cy - outer, cy + outer)
    k0, k1 = cell_range(grid, 2, cz - outer, cz + outer)
    heads, entries = grid.heads, grid.entries
    for pass_ in range(2):  # count first, then link
        needed = 0
        for i in range(i0, i1 + 1):
            x = grid.lower[0] + i * width - cx
            near_x = max(x, 0.0, -x - width)
            far_x = max(-x, x + width)
            for j in range(j0, j1 + 1):
                y = grid.lower[1] + j * width - cy
                near_y = max(y, 0.0, -y - width)
                far_y = max(-y, y + width)
                near_xy = near_x * near_x + near_y * near_y
                far_xy = far_x * far_x + far_y * far_y
                if near_xy >= outer * outer:
                    continue
                for k in range(k0, k1 + 1):
                    z = grid.lower[2] + k * width - cz
                    near_z = max(z, 0.0, -z - width)
                    far_z = max(-z, z + width)
                    if heads[i, j, k] == COVERED or near_xy + near_z * near_z >= outer * outer:
                        continue
                    if far_xy + far_z * far_z <= r * r:
                        if pass_ == 1:
                            heads[i, j, k] = COVERED
                    else:
                        if pass_ == 1:
                            entry = before + needed
                            entries[entry, 0] = index
                            entries[entry, 1] = heads[i, j, k]
                            heads[i, j, k] = entry
                        needed += 1
        if before + needed > len(entries):
            return False
    grid.used[0] = before + needed
    return True


@kernel
def insert_spheres(grid, spheres, start, stop):
    """Insert spheres one by one; return the first that found no room, or ``stop`` if all did."""
    for index in range(start, stop):
        if not insert_sphere(grid, spheres, index):
            return index
    return stop


@kernel
def nearest_sphere(grid, spheres, x, y, z, excluded):
    """Return the distance to the nearest sphere and its index; ``reach`` and -1 if none is nearer.

    Inside a sphere the distance is negative. ``excluded`` is a sphere to look past (-1: none).
    """
    last = grid.heads.shape
    i = max(0, min(last[0] - 1, int((x - grid.lower[0]) * grid.inverse_width)))
    j = max(0, min(last[1] - 1, int((y - grid.lower[1]) * grid.inverse_width)))
    k = max(0, min(last[2] - 1, int((z - grid.lower[2]) * grid.inverse_width)))
    best = grid.reach
    nearest = -1
    entry = grid.heads[i, j, k]
    if entry == COVERED:
        return -1.0 / grid.inverse_width, -1
    while entry >= 0:
        index = grid.entries[entry, 0]
        entry = grid.entries[entry, 1]
        dx = x - spheres[index, 0]
        dy = y - spheres[index, 1]
        dz = z - spheres[index, 2]
        r = spheres[index, 3]
        limit = best + r
        d = dx * dx + dy * dy + dz * dz
        if limit > 0.0 and d < limit * limit and index != excluded:
            best = np.sqrt(d) - r
            nearest = index
    return best, nearest
