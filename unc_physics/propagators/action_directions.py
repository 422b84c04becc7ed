"""The directions in which a scene's actions are uncertain, as columns of linearization's root.

They are offsets of paths (``trajectory_std``), and times of release (``released_at_std``).
"""

from __future__ import annotations

import numpy as np

from ..scene.belief import Belief
from ..scene.kinematic_states import held_at_start
from ..scene.scene import Scene
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..spatial.rotation import rotation_matrix
from .implicit_linearization import Directions


def directions(scene: Scene, columns: int) -> Directions:
    """Return changes of a scene's actions by ``columns`` of a root; empty arrays without kinematic bodies.

    The last of them are the scene's uncertain parameters.
    """
    actions, count = scene.actions, len(scene.bodies) if len(scene.actions.kinematic) else 0
    found = Directions(np.zeros((count, 6, columns)), np.zeros((count, 3)), np.zeros((count, columns)))
    for j in actions.kinematic:
        first, last = actions.path[j]
        if last > first:
            found.center[j] = actions.pose[first, POSITION]
    for column, parameter in enumerate(scene.uncertain, columns - len(scene.uncertain)):
        j = parameter.body
        if parameter.name == "released_at":
            found.late[j, column] = parameter.std
        else:
            R = rotation_matrix(actions.pose[actions.path[j, 0], QUATERNION])
            part, axis = divmod(parameter.axis, 3)
            found.offset[j, 3 * part : 3 * part + 3, column] = parameter.std * R[:, axis]
    return found


def start_root(scene: Scene, belief: Belief, mean: np.ndarray) -> np.ndarray:
    """Return a root (12 M, r) of the belief at time 0; columns for the uncertain parameters follow its own.

    Held bodies move along with the path of their holder. ``mean`` (B, 13) is the state of the rollout at time
    0.
    """
    root = belief.root()
    if not scene.acts:
        return root
    root = np.concatenate([root, np.zeros((len(root), len(scene.uncertain)))], axis=1)
    blocks, found = root.reshape(len(scene.moving), ERROR, root.shape[1]), directions(scene, root.shape[1])
    for j in np.flatnonzero(held_at_start(scene)):
        own, k, x = blocks[np.searchsorted(scene.moving, j)], scene.actions.carrier[j], mean[j]
        move, turn = found.offset[k, :3], found.offset[k, 3:]
        spin = _cross(x[ANGULAR_VELOCITY])
        own[ERR_VELOCITY] = spin @ own[ERR_POSITION] - _cross(x[VELOCITY]) @ turn
        own[ERR_POSITION] += move - _cross(x[POSITION] - found.center[k]) @ turn
        own[ERR_ROTATION] += rotation_matrix(x[QUATERNION]).T @ turn
        own[ERR_ANGULAR_VELOCITY] = -spin @ turn
    return root


def _cross(v):
    """Return the matrix (3, 3) of ``v x``."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
