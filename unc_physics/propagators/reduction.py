"""Directions in which an uncertain scene moves as one, which need no simulation.

Bodies that meet nothing but each other do not notice where they are together, nor how fast they move
together: whatever the contacts do, a common translation and a common velocity go on as in free flight. The
error of a belief is ``e = U z`` with standard normal z. With ``Q`` an orthonormal basis of the common
motions, what the contacts depend on is ``(I - Q Q^T) U z``, of which fewer combinations of z are enough.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..scene.scene import Scene
from ..spatial.layout import ERR_POSITION, ERR_VELOCITY, ERROR, POSITION, VELOCITY
from .free_flight import Course

_NEGLIGIBLE = 1e-13  # singular values that are round-off, relative to the largest entry of the root


def symmetric(scene: Scene) -> bool:
    """Return whether the bodies of a scene can meet only each other.

    With drag the result is false, as drag depends on the velocity in the world frame.
    """
    alone = len(scene.moving) == len(scene.bodies) and not scene.environment
    return alone and not any(body.drag for body in scene.bodies)


class Reduction(NamedTuple):
    """The combinations of z (d,) that matter, and those that move all bodies alike."""

    relative: np.ndarray  # (d, r): orthonormal columns: ``z @ relative`` is all that contacts depend on
    common: np.ndarray  # (d, c): orthonormal columns that complete them
    motion: np.ndarray  # (6, c): common translation [m] and velocity [m/s] that ``z @ common`` makes


def reduction(root: np.ndarray, parameters: int = 0) -> Reduction:
    """Return the reduction of bodies that meet only each other.

    ``root`` (12 M, k) has the errors of the M bodies that each of k independent standard normal numbers
    makes. So many uncertain ``parameters`` of the scene follow these numbers in z; all of them matter.
    """
    count, size = len(root) // ERROR, root.shape[1]
    errors = root.reshape(count, ERROR, size)
    means = errors.mean(axis=0)
    rest = errors.copy()
    for block in (ERR_POSITION, ERR_VELOCITY):
        rest[:, block] -= means[block]
    # lengths and times of about one are the units of robots; the limit is far below either
    _, values, rows = np.linalg.svd(rest.reshape(len(root), size), full_matrices=True)
    largest = np.abs(root).max(initial=0.0)
    rank = int((values > _NEGLIGIBLE * max(largest, 1e-300)).sum())
    vectors = np.zeros((size + parameters, size + parameters))
    vectors[:size, :rank], vectors[:size, rank + parameters :] = rows[:rank].T, rows[rank:].T
    vectors[size:, rank : rank + parameters] = np.eye(parameters)
    common = vectors[:, rank + parameters :]
    motion = np.concatenate([means[ERR_POSITION], means[ERR_VELOCITY]]) @ common[:size]
    return Reduction(vectors[:, : rank + parameters], common, motion)


def moved_in_common(states: np.ndarray, motion: np.ndarray, along: Course) -> None:
    """Add common motions (N, 6), a translation and a velocity at time 0, to states (N, B, 13) in place."""
    states[..., POSITION] += (motion[:, :3] + along.reach * motion[:, 3:])[:, None]
    states[..., VELOCITY] += along.decay * motion[:, None, 3:]


def common_covariance(motion: np.ndarray, along: Course, count: int) -> np.ndarray:
    """Return the covariance (12 M, 12 M) that a common motion (6, c) adds to that of ``count`` bodies."""
    root = np.zeros((count, ERROR, motion.shape[1]))
    root[:, ERR_POSITION] = motion[:3] + along.reach * motion[3:]
    root[:, ERR_VELOCITY] = along.decay * motion[3:]
    root = root.reshape(ERROR * count, -1)
    return root @ root.T
