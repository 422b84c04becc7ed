"""Distance from a point to a triangle mesh, by a balanced tree of boxes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

LEAF_SIZE = 4


class TriangleTree(NamedTuple):
    """Triangles in the order of a complete binary tree's leaves; node 1 is the root, node i has 2i and 2i + 1."""

    lower: np.ndarray  # (nodes, 3) boxes
    upper: np.ndarray  # (nodes, 3)
    triangles: np.ndarray  # (leaves * LEAF_SIZE, 9) corner and two edges; the last leaf is filled up with copies
    first_leaf: int


def build_triangle_tree(corners) -> TriangleTree:
    """Build the tree by splitting at the median of the longest side.

    Parameters
    ----------
    corners : ndarray (m, 3, 3)
        The triangles' corners.
    """
    count = len(corners)
    depth = max(0, int(np.ceil(np.log2(count / LEAF_SIZE))))
    slots = LEAF_SIZE << depth
    order = np.resize(np.arange(count), slots)
    centroids = corners.mean(axis=1)
    for level in range(depth):
        groups = centroids[order].reshape(1 << level, -1, 3)
        axis = np.argmax(groups.max(axis=1) - groups.min(axis=1), axis=1)
        keys = np.take_along_axis(groups, axis[:, None, None], axis=2)[:, :, 0]
        rank = np.argsort(keys, axis=1, kind="stable")
        order = np.take_along_axis(order.reshape(1 << level, -1), rank, axis=1).ravel()
    leaves = 1 << depth
    lower, upper = np.empty((2, 2 * leaves, 3))
    lower[leaves:] = corners[order].min(axis=1).reshape(leaves, LEAF_SIZE, 3).min(axis=1)
    upper[leaves:] = corners[order].max(axis=1).reshape(leaves, LEAF_SIZE, 3).max(axis=1)
    for level in range(depth - 1, -1, -1):
        nodes = slice(1 << level, 2 << level)
        children = slice(2 << level, 4 << level)
        lower[nodes] = lower[children].reshape(-1, 2, 3).min(axis=1)
        upper[nodes] = upper[children].reshape(-1, 2, 3).max(axis=1)
    a, b, c = corners[order].transpose(1, 0, 2)
    return TriangleTree(lower, upper, np.ascontiguousarray(np.hstack([a, b - a, c - a])), leaves)


@njit(cache=True, nogil=True)
def box_distance_squared(tree, node, x, y, z):
    """Squared distance from a point to a node's box; 0 inside."""
    dx = max(tree.lower[node, 0] - x, 0.0, x - tree.upper[node, 0])
    dy = max(tree.lower[node, 1] - y, 0.0, y - tree.upper[node, 1])
    dz = max(tree.lower[node, 2] - z, 0.0, z - tree.upper[node, 2])
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def closest_on_triangle(triangle, x, y, z):
    """Barycentric coordinates (v, w) along the two edges of the triangle's point nearest to (x, y, z)."""
    e1x, e1y, e1z = triangle[3], triangle[4], triangle[5]
    e2x, e2y, e2z = triangle[6], triangle[7], triangle[8]
    px, py, pz = x - triangle[0], y - triangle[1], z - triangle[2]
    a11 = e1x * e1x + e1y * e1y + e1z * e1z
    a12 = e1x * e2x + e1y * e2y + e1z * e2z
    a22 = e2x * e2x + e2y * e2y + e2z * e2z
    b1 = e1x * px + e1y * py + e1z * pz
    b2 = e2x * px + e2y * py + e2z * pz
    det = a11 * a22 - a12 * a12
    v = b1 * a22 - b2 * a12
    w = b2 * a11 - b1 * a12
    if v > 0.0 and w > 0.0 and v + w < det:
        return v / det, w / det
    # The nearest point is on an edge. Of the three edges' nearest points take the nearest.
    v1 = min(max(b1 / a11, 0.0), 1.0) if a11 > 0.0 else 0.0
    w2 = min(max(b2 / a22, 0.0), 1.0) if a22 > 0.0 else 0.0
    a33 = a11 - 2.0 * a12 + a22
    w3 = min(max((a11 - a12 - b1 + b2) / a33, 0.0), 1.0) if a33 > 0.0 else 0.0
    d1 = v1 * (v1 * a11 - 2.0 * b1)
    d2 = w2 * (w2 * a22 - 2.0 * b2)
    d3 = a11 - 2.0 * b1 + w3 * (w3 * a33 - 2.0 * (a11 - a12 - b1 + b2))
    if d1 <= d2 and d1 <= d3:
        return v1, 0.0
    if d2 <= d3:
        return 0.0, w2
    return 1.0 - w3, w3


@njit(cache=True, nogil=True)
def nearest_on_mesh(tree, x, y, z, bound):
    """The mesh's point nearest to (x, y, z), if it is nearer than ``bound``.

    Returns
    -------
    distance, qx, qy, qz : float
        Distance and nearest point; ``bound`` and zeros when there is none within it.
    """
    best = bound * bound
    qx = qy = qz = 0.0
    found = False
    nodes = np.empty(64, np.int64)
    distances = np.empty(64)
    top = 0
    node = 1
    lower = box_distance_squared(tree, 1, x, y, z)
    while True:
        if lower < best:
            if node < tree.first_leaf:
                left = 2 * node
                near = box_distance_squared(tree, left, x, y, z)
                far = box_distance_squared(tree, left + 1, x, y, z)
                near_is_left = near <= far
                if not near_is_left:
                    near, far = far, near
                if far < best:
                    nodes[top] = left + 1 if near_is_left else left
                    distances[top] = far
                    top += 1
                node = left if near_is_left else left + 1
                lower = near
                continue
            first = (node - tree.first_leaf) * LEAF_SIZE
            for k in range(first, first + LEAF_SIZE):
                t = tree.triangles[k]
                v, w = closest_on_triangle(t, x, y, z)
                cx = t[0] + v * t[3] + w * t[6]
                cy = t[1] + v * t[4] + w * t[7]
                cz = t[2] + v * t[5] + w * t[8]
                d = (cx - x) * (cx - x) + (cy - y) * (cy - y) + (cz - z) * (cz - z)
                if d < best:
                    best = d
                    qx, qy, qz = cx, cy, cz
                    found = True
        if top == 0:
            break
        top -= 1
        node = nodes[top]
        lower = distances[top]
    return (np.sqrt(best) if found else bound), qx, qy, qz
