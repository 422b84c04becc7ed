"""Sphere trees: eight-wide hierarchies of bounding spheres over the spheres of a packing.

An inner node holds eight entries, each a bounding sphere and a child. Bounding spheres are in single
precision, inflated to contain their content. A child is a node, a sphere of the packing, or empty. The
division into entries minimizes box surface times number of spheres, which puts the few large spheres near the
root.

The search for overlaps only uses the bounds and returns candidates, a superset of the overlapping pairs. The
contact has the exact test in double precision (`narrow_phase`).
"""

import math
from typing import NamedTuple

import numpy as np

from ...compiler import kernel
from ...compiler.arrays import empty, full, integers, singles, small_integers
from ...compiler.simd import lowest_bit, overlap_mask, overlap_masks
from ...spatial.vectors import single

WIDTH = 8
#: Largest number of pairs from a search's stack that are tested before any is divided.
AT_ONCE = 8
#: Room for candidates that the test of one pair needs.
ROOM = WIDTH * WIDTH
EMPTY = np.int32(2**31 - 1)  # no child; a child c >= 0 is a node, c < 0 the sphere ~c

_FAR = np.float32(1e30)  # position of empty entries, which overlap nothing


class Scratch(NamedTuple):
    """Temporary arrays of one search.

    Attributes
    ----------
    stack : (depth, 2) int32
    pairs : (capacity, 2) int32
    tested, masks : (AT_ONCE, 2) int32 and (AT_ONCE,) int64
        Pairs from the stack, and their `compiler.simd.overlap_masks`.
    records : (capacity, 8) float64
        Contacts of the pairs (`narrow_phase`).
    """

    stack: np.ndarray
    pairs: np.ndarray
    tested: np.ndarray
    masks: np.ndarray
    records: np.ndarray


class Tree(NamedTuple):
    """Sphere trees of several packings, concatenated.

    Attributes
    ----------
    bounds : (nodes, 4, 8) float32
        Centres x, y, z and radii of each node's entries, body frame [m].
    child : (nodes, 8) int32
        Node index, ``~sphere`` index, or `EMPTY`.
    centers : (spheres, 3) float64
        Sphere centres, body frame [m].
    radii : (spheres,) float64
        Sphere radii [m].
    """

    bounds: np.ndarray
    child: np.ndarray
    centers: np.ndarray
    radii: np.ndarray


@kernel
def _enclosing_sphere(centers, radii, order, start, stop):
    """Return a small bounding sphere of the spheres ``order[start:stop]``.

    The centre is moved towards the farthest sphere repeatedly; the radius is then exact.
    """
    x = y = z = 0.0
    n = stop - start
    for k in range(start, stop):
        i = order[k]
        x += centers[i, 0] / n
        y += centers[i, 1] / n
        z += centers[i, 2] / n
    reach = 0.0
    for iteration in range(1, 40):
        reach, far = -1.0, start
        for k in range(start, stop):
            i = order[k]
            d = (
                math.sqrt((centers[i, 0] - x) ** 2 + (centers[i, 1] - y) ** 2 + (centers[i, 2] - z) ** 2)
                + radii[i]
            )
            if d > reach:
                reach, far = d, i
        d = reach - radii[far]
        if d <= 0.0:
            break
        s = 1.0 / (iteration + 1.0)  # Badoiu and Clarkson's iteration for balls
        x += s * (centers[far, 0] - x) * (reach / max(d, 1e-300)) * 0.5
        y += s * (centers[far, 1] - y) * (reach / max(d, 1e-300)) * 0.5
        z += s * (centers[far, 2] - z) * (reach / max(d, 1e-300)) * 0.5
    reach = 0.0
    for k in range(start, stop):
        i = order[k]
        d = (
            math.sqrt((centers[i, 0] - x) ** 2 + (centers[i, 1] - y) ** 2 + (centers[i, 2] - z) ** 2)
            + radii[i]
        )
        reach = max(reach, d)
    return x, y, z, reach


@kernel
def _area(low, high):
    """Return half the surface of a box, the usual estimate of how often it is hit."""
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return x * y + y * z + z * x


@kernel(noinline=True)
def _split(centers, radii, order, start, stop):
    """Divide ``order[start:stop]`` in two parts with the least sum of box surface times number of spheres.

    Sorts along each axis and sweeps from both ends. Returns the index of the second part's first sphere.
    """
    n = stop - start
    best, best_axis, best_at = np.inf, 0, n // 2
    sorts = integers((3, n))
    behind, keys = empty(n), empty(n)
    low, high = empty(3), empty(3)
    for axis in range(3):
        for k in range(n):
            keys[k] = centers[order[start + k], axis]
        places = np.argsort(keys, kind="mergesort")
        for k in range(n):
            sorts[axis, k] = order[start + places[k]]
        for backwards in (True, False):
            for a in range(3):
                low[a], high[a] = np.inf, -np.inf
            for step in range(n - 1):
                k = n - 1 - step if backwards else step
                i = sorts[axis, k]
                for a in range(3):
                    low[a] = min(low[a], centers[i, a] - radii[i])
                    high[a] = max(high[a], centers[i, a] + radii[i])
                if backwards:
                    behind[k] = _area(low, high) * (n - k)
                else:
                    cost = _area(low, high) * (k + 1) + behind[k + 1]
                    if cost < best:
                        best, best_axis, best_at = cost, axis, k + 1
    for k in range(n):
        order[start + k] = sorts[best_axis, k]
    return start + best_at


@kernel
def _box_area(centers, radii, order, start, stop):
    low, high = full(3, np.inf), full(3, -np.inf)
    for k in range(start, stop):
        i = order[k]
        for a in range(3):
            low[a] = min(low[a], centers[i, a] - radii[i])
            high[a] = max(high[a], centers[i, a] + radii[i])
    return _area(low, high)


@kernel
def build(centers, radii):
    """Build the tree of one packing, with nodes and spheres counted from 0.

    Each node's spheres are divided top-down: the part with the largest box is divided repeatedly, until there
    are eight parts.

    Parameters
    ----------
    centers : (n, 3) array
        Sphere centres, body frame [m].
    radii : (n,) array
        Sphere radii [m].

    Returns
    -------
    bounds : (nodes, 4, 8) float32
    child : (nodes, 8) int32
        Node 0 is the root.
    depth : int
        Number of nodes on the longest path from the root.
    """
    n = len(radii)
    order = np.arange(n)
    bounds = singles((n + 1, 4, WIDTH))
    child = small_integers((n + 1, WIDTH))
    task = [(0, 0, n, 1)]  # node, its range of `order`, its level
    nodes, depth = 1, 1
    first, last = integers(WIDTH), integers(WIDTH)
    area = empty(WIDTH)
    while len(task) > 0:
        node, start, stop, level = task.pop()
        depth = max(depth, level)
        first[0], last[0], area[0] = start, stop, 1.0
        parts = 1
        while parts < WIDTH:
            widest = -1
            for k in range(parts):
                if last[k] - first[k] > 1 and (widest < 0 or area[k] > area[widest]):
                    widest = k
            if widest < 0:
                break
            first[parts] = _split(centers, radii, order, first[widest], last[widest])
            last[parts] = last[widest]
            last[widest] = first[parts]
            for k in (widest, parts):
                area[k] = _box_area(centers, radii, order, first[k], last[k])
            parts += 1
        for k in range(parts, WIDTH):
            bounds[node, 0, k] = bounds[node, 1, k] = bounds[node, 2, k] = _FAR
            bounds[node, 3, k] = 0.0
            child[node, k] = EMPTY
        for k in range(parts):
            x, y, z, reach = _enclosing_sphere(centers, radii, order, first[k], last[k])
            bounds[node, 0, k] = x
            bounds[node, 1, k] = y
            bounds[node, 2, k] = z
            # rounding the centre to single precision moves it; the radius grows by more than that
            bounds[node, 3, k] = reach * (1.0 + 1e-6) + 2e-7 * (abs(x) + abs(y) + abs(z))
            if last[k] - first[k] == 1:
                child[node, k] = ~order[first[k]]
            else:
                child[node, k] = nodes
                task.append((nodes, first[k], last[k], level + 1))
                nodes += 1
    return bounds[:nodes].copy(), child[:nodes].copy(), depth


@kernel(arrays=False)
def candidates(tree, R_ij, t_ij, slack, scratch, top, at_once):
    """Continue the search for overlapping spheres of two bodies until it is complete or the buffer is full.

    Parameters
    ----------
    tree : Tree
    R_ij : (3, 3) array
        Rotation from body j's to body i's coordinates.
    t_ij : tuple of 3 floats
        Body j's centre of mass in body i's frame [m].
    slack : float
        Largest gap of candidates [m]; at least the single-precision round-off in a change of frame.
    scratch : Scratch
        Its ``stack`` holds the remaining pairs of children (i's, j's); a search begins with the two roots.
        Its ``pairs`` are filled with candidates (sphere of i, sphere of j), which include all overlapping
        pairs.
    top : int
        Height of the stack; 1 when a search begins, 0 when it is complete.
    at_once : int
        Number of pairs from the stack that are tested before any is divided, at most `AT_ONCE`. More is
        faster; the candidates are the same in another order.

    Returns
    -------
    found : int
        Number of pairs written.
    top : int
        Height of the stack; call again while it is positive, after using the pairs.
    """
    bounds, child = tree.bounds, tree.child
    R, t = (single(R_ij[0]), single(R_ij[1]), single(R_ij[2])), single(t_ij)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    tx, ty, tz = t
    slack = np.float32(slack)
    stack, pairs, tested, masks = scratch.stack, scratch.pairs, scratch.tested, scratch.masks
    found = 0
    while top > 0:
        some = min(top, at_once, (len(pairs) - found) // ROOM)
        if some == 0:
            break
        top -= some
        # tests of some pairs first, then their consequences, so that neither waits for the other
        for k in range(some):
            a, b = np.int64(stack[top + k, 0]), np.int64(stack[top + k, 1])
            tested[k, 0], tested[k, 1] = a, b
            mask = np.uint64(0)
            if a < 0:  # a sphere of body i against a node of body j, in body j's frame
                sphere = ~a
                dx = np.float32(tree.centers[sphere, 0]) - tx
                dy = np.float32(tree.centers[sphere, 1]) - ty
                dz = np.float32(tree.centers[sphere, 2]) - tz
                x = xx * dx + yx * dy + zx * dz
                y = xy * dx + yy * dy + zy * dz
                z = xz * dx + yz * dy + zz * dz
                mask = overlap_mask(bounds, b, x, y, z, np.float32(tree.radii[sphere]) + slack)
            elif b < 0:
                sphere = ~b
                px, py = np.float32(tree.centers[sphere, 0]), np.float32(tree.centers[sphere, 1])
                pz = np.float32(tree.centers[sphere, 2])
                x = xx * px + xy * py + xz * pz + tx
                y = yx * px + yy * py + yz * pz + ty
                z = zx * px + zy * py + zz * pz + tz
                mask = overlap_mask(bounds, a, x, y, z, np.float32(tree.radii[sphere]) + slack)
            else:
                mask = overlap_masks(bounds, a, b, R, t, slack)
            masks[k] = mask
        for k in range(some):
            a, b, mask = np.int64(tested[k, 0]), np.int64(tested[k, 1]), np.uint64(masks[k])
            while mask != 0:
                place = lowest_bit(mask)
                mask &= mask - np.uint64(1)
                if a < 0:
                    c_i, c_j = np.int32(a), child[b, place]
                elif b < 0:
                    c_i, c_j = child[a, place], np.int32(b)
                else:
                    c_i, c_j = child[a, place & (WIDTH - 1)], child[b, place // WIDTH]
                # written to both, and counted in one: faster than an unpredictable branch
                here, next_up = np.uint64(found), np.uint64(top)
                pairs[here, 0], pairs[here, 1] = ~c_i, ~c_j
                stack[next_up, 0], stack[next_up, 1] = c_i, c_j
                spheres = np.int64(c_i < 0 and c_j < 0)
                found += spheres
                top += 1 - spheres
    return found, top
