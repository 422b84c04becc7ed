"""Many rotations at once: quaternions (..., 4) in the order x, y, z, w, in plain NumPy."""

from __future__ import annotations

import numpy as np

from .rotation import exp_vectors

_ROUNDS = 10  # of the mean, at most


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the products p q: rotation q followed by p."""
    a, b, c, d = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    found = np.empty(np.broadcast_shapes(p.shape, q.shape))
    found[..., 0] = d * x + a * w + b * z - c * y  # written out: `np.cross` takes ten times as long for few
    found[..., 1] = d * y + b * w + c * x - a * z
    found[..., 2] = d * z + c * w + a * y - b * x
    found[..., 3] = d * w - a * x - b * y - c * z
    return found


def inverse(q: np.ndarray) -> np.ndarray:
    """Return the inverse rotations."""
    return q * [-1.0, -1.0, -1.0, 1.0]


def rotation_vectors(q: np.ndarray) -> np.ndarray:
    """Return rotation vectors (..., 3), of at most half a turn [rad]."""
    q = np.where(q[..., 3:] < 0.0, -q, q)
    size = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    small = size < 1e-12
    factor = np.where(small, 2.0, 2.0 * np.arctan2(size, q[..., 3:]) / np.where(small, 1.0, size))
    return factor * q[..., :3]


def mean(q: np.ndarray) -> np.ndarray:
    """Return the Karcher means (..., 4) of quaternions (..., n, 4)."""
    middle = np.linalg.eigh(np.einsum("...ni,...nj->...ij", q, q))[1][..., -1]
    for _ in range(_ROUNDS):
        turn = rotation_vectors(product(inverse(middle)[..., None, :], q)).mean(axis=-2)
        middle = product(middle, exp_vectors(turn))
        if np.sum(turn**2, axis=-1).max() < 1e-12:
            break
    return middle / np.linalg.norm(middle, axis=-1, keepdims=True)
