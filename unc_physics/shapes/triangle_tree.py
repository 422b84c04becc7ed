"""Distances of points from a triangle mesh, and winding numbers, by a balanced tree of boxes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiler import kernel

LEAF_SIZE = 4  # triangles in a leaf, at most
# A triangle's record: corner, unit normal, two edges e1 and e2, 1 / |e1|^2, 1 / |e2|^2, 1 / |e1 - e2|^2,
# 1 / |e1 x e2|^2 (0 instead of an infinity)
RECORD = 16
#: Direction of the rays whose crossings say what is inside; it lies in no plane of symmetry of usual meshes.
_U, _V, _W = 0.5406, 0.3127, 0.7810


class TriangleTree(NamedTuple):
    """Triangles in the order of the leaves of a complete binary tree.

    Node 1 is the root; the children of node i are 2 i and 2 i + 1.
    """

    boxes: np.ndarray  # (nodes, 6) lower and upper corner
    triangles: np.ndarray  # (leaves * leaf_size, RECORD); corners of some fill up the leaves
    first_leaf: int
    leaf_size: int


def build_triangle_tree(corners) -> TriangleTree:
    """Build the tree of triangles (m, 3, 3) by splitting at the median of the longest side."""
    count = len(corners)
    depth = max(0, int(np.ceil(np.log2(count / LEAF_SIZE))))
    leaf_size = -(-count // (1 << depth))
    order = np.resize(np.arange(count), leaf_size << depth)
    centroids = np.ascontiguousarray(corners.mean(axis=1).T)
    for level in range(depth):
        groups = centroids[:, order].reshape(3, 1 << level, -1)
        axis = np.argmax(groups.max(axis=2) - groups.min(axis=2), axis=0)
        keys = groups[axis, np.arange(1 << level)]
        rank = np.argpartition(keys, keys.shape[1] // 2, axis=1)
        order = np.take_along_axis(order.reshape(1 << level, -1), rank, axis=1).ravel()
    leaves = 1 << depth
    boxes = np.empty((2 * leaves, 2, 3))
    boxes[leaves:, 0] = corners[order].min(axis=1).reshape(leaves, leaf_size, 3).min(axis=1)
    boxes[leaves:, 1] = corners[order].max(axis=1).reshape(leaves, leaf_size, 3).max(axis=1)
    for level in range(depth - 1, -1, -1):
        nodes = slice(1 << level, 2 << level)
        children = boxes[2 << level : 4 << level].reshape(-1, 2, 2, 3)
        boxes[nodes, 0] = children[:, :, 0].min(axis=1)
        boxes[nodes, 1] = children[:, :, 1].max(axis=1)
    records, copies = triangle_records(corners)[order], np.ones(len(order), bool)
    copies[np.unique(order, return_index=True)[1]] = False
    records[copies, 6:12] = 0.0  # without an area, a copy is crossed by no ray
    return TriangleTree(boxes.reshape(-1, 6), records, leaves, leaf_size)


def triangle_records(corners):
    """Return the data of each triangle for distance queries, (m, RECORD)."""
    a, b, c = corners.transpose(1, 0, 2)
    e1, e2 = b - a, c - a
    cross = np.cross(e1, e2)
    squares = np.stack([np.sum(e**2, axis=1) for e in (e1, e2, e1 - e2, cross)], axis=1)
    inverses = np.divide(1.0, squares, out=np.zeros_like(squares), where=squares > 0.0)
    normals = cross * np.sqrt(inverses[:, 3:])
    return np.ascontiguousarray(np.hstack([a, normals, e1, e2, inverses]))


@kernel
def box_distance_squared(boxes, node, x, y, z):
    """Return the squared distance from a point to a node's box, 0 inside."""
    dx = max(boxes[node, 0] - x, 0.0, x - boxes[node, 3])
    dy = max(boxes[node, 1] - y, 0.0, y - boxes[node, 4])
    dz = max(boxes[node, 2] - z, 0.0, z - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@kernel
def offset_from_triangle(t, px, py, pz, height):
    """Return the vector from a triangle's nearest point to a point.

    The point is p from the triangle's corner, and ``height`` above its plane.
    """
    b1 = t[6] * px + t[7] * py + t[8] * pz
    b2 = t[9] * px + t[10] * py + t[11] * pz
    a11 = t[6] * t[6] + t[7] * t[7] + t[8] * t[8]
    a12 = t[6] * t[9] + t[7] * t[10] + t[8] * t[11]
    a22 = t[9] * t[9] + t[10] * t[10] + t[11] * t[11]
    v = (b1 * a22 - b2 * a12) * t[15]
    w = (b2 * a11 - b1 * a12) * t[15]
    if v > 0.0 and w > 0.0 and v + w < 1.0:
        return height * t[3], height * t[4], height * t[5]
    # On an edge, then: of the three edges' nearest points the nearest.
    v1 = min(max(b1 * t[12], 0.0), 1.0)
    w2 = min(max(b2 * t[13], 0.0), 1.0)
    b3 = a11 - a12 - b1 + b2
    w3 = min(max(b3 * t[14], 0.0), 1.0)
    d1 = v1 * (v1 * a11 - 2.0 * b1)
    d2 = w2 * (w2 * a22 - 2.0 * b2)
    d3 = a11 - 2.0 * b1 + w3 * (w3 * (a11 - 2.0 * a12 + a22) - 2.0 * b3)
    v, w = 1.0 - w3, w3
    if d1 <= d2 and d1 <= d3:
        v, w = v1, 0.0
    elif d2 <= d3:
        v, w = 0.0, w2
    return px - v * t[6] - w * t[9], py - v * t[7] - w * t[10], pz - v * t[8] - w * t[11]


@kernel
def nearest_on_mesh(tree, x, y, z, bound):
    """Find the mesh's point nearest to (x, y, z), if it is nearer than ``bound``.

    Returns
    -------
    distance, qx, qy, qz : float
        Distance and nearest point; ``bound`` and zeros when there is none within it.
    """
    boxes, triangles = tree.boxes, tree.triangles
    best = bound * bound
    qx = qy = qz = 0.0
    found = False
    nodes = np.empty(64, np.int64)
    distances = np.empty(64)
    top = 0
    node = 1
    nearest = box_distance_squared(boxes, 1, x, y, z)
    while True:
        if nearest < best:
            if node < tree.first_leaf:
                near, far = 2 * node, 2 * node + 1
                nearest = box_distance_squared(boxes, near, x, y, z)
                farther = box_distance_squared(boxes, far, x, y, z)
                if farther < nearest:
                    near, far = far, near
                    nearest, farther = farther, nearest
                if farther < best:
                    nodes[top] = far
                    distances[top] = farther
                    top += 1
                node = near
                continue
            first = (node - tree.first_leaf) * tree.leaf_size
            for k in range(first, first + tree.leaf_size):
                t = triangles[k]
                px, py, pz = x - t[0], y - t[1], z - t[2]
                height = t[3] * px + t[4] * py + t[5] * pz
                if height * height >= best:
                    continue
                ox, oy, oz = offset_from_triangle(t, px, py, pz, height)
                d = ox * ox + oy * oy + oz * oz
                if d < best:
                    best = d
                    qx, qy, qz = x - ox, y - oy, z - oz
                    found = True
        if top == 0:
            break
        top -= 1
        node = nodes[top]
        nearest = distances[top]
    return (np.sqrt(best) if found else bound), qx, qy, qz


@kernel
def winding_numbers(tree, points):
    """Return how often a closed mesh winds around each of some points (n, 3), (n,)."""
    found = np.zeros(len(points), np.int64)
    for k in range(len(points)):
        found[k] = winding_number(tree, points[k, 0], points[k, 1], points[k, 2])
    return found


@kernel
def winding_number(tree, x, y, z):
    """Return how often a ray from a point leaves a closed mesh, less how often it enters."""
    boxes, triangles = tree.boxes, tree.triangles
    nodes = np.empty(64, np.int64)
    nodes[0], top, count = 1, 1, 0
    while top > 0:
        top -= 1
        node = nodes[top]
        near, far = 0.0, np.inf
        for axis, (start, step) in enumerate(((x, _U), (y, _V), (z, _W))):
            near = max(near, (boxes[node, axis] - start) / step)
            far = min(far, (boxes[node, axis + 3] - start) / step)
        if near > far:
            continue
        if node < tree.first_leaf:
            nodes[top], nodes[top + 1] = 2 * node, 2 * node + 1
            top += 2
            continue
        first = (node - tree.first_leaf) * tree.leaf_size
        for k in range(first, first + tree.leaf_size):
            count += _crossing(triangles[k], x, y, z)
    return count


@kernel
def _crossing(t, x, y, z):
    """Return 1 if a ray leaves a triangle's record, -1 if it enters, else 0 (Moeller and Trumbore 1997)."""
    hx, hy, hz = _V * t[11] - _W * t[10], _W * t[9] - _U * t[11], _U * t[10] - _V * t[9]
    size = t[6] * hx + t[7] * hy + t[8] * hz
    if size == 0.0:
        return 0
    sx, sy, sz = x - t[0], y - t[1], z - t[2]
    a = (sx * hx + sy * hy + sz * hz) / size
    qx, qy, qz = sy * t[8] - sz * t[7], sz * t[6] - sx * t[8], sx * t[7] - sy * t[6]
    b = (_U * qx + _V * qy + _W * qz) / size
    along = (t[9] * qx + t[10] * qy + t[11] * qz) / size
    if a >= 0.0 and b >= 0.0 and a + b <= 1.0 and along > 0.0:
        return 1 if size < 0.0 else -1
    return 0
