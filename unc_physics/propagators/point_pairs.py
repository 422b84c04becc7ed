"""Points in pairs on opposite sides of a middle one: sigma points, and central differences of rollouts."""

from __future__ import annotations

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import empty
from ..scene.belief import Belief
from ..scene.kinematic_states import start_states
from ..scene.parameters import center_offsets, moved_along
from ..scene.scene import Scene
from ..spatial.layout import ERROR
from ..spatial.moments import boxminus, spread_states
from .rollouts import RolloutCarry
from .start import resolve_initial_overlap


def spread_points(scene: Scene, belief: Belief, root: np.ndarray, reach: np.ndarray) -> RolloutCarry:
    """Return the carry of the mean, of n points and of the opposite points, at time 0.

    Parameters
    ----------
    scene : Scene
    belief : Belief
    root : (12 M, r) array
        Errors by one standard deviation along r directions; the scene's K uncertain parameters follow.
    reach : (n,) array
        Distance of the points from the mean along each of the n = r + K directions, in standard deviations.
    """
    rank, count = root.shape[1], len(reach)
    errors, z = np.zeros((2 * count + 1, len(root))), np.zeros((2 * count + 1, count - rank))
    for first, side in ((1, reach), (1 + count, -reach)):
        errors[first : first + rank] = side[:rank, None] * root.T
        z[first + rank : first + count] = side[rank:, None] * np.eye(count - rank)
    states = spread_states(belief.mean.copy(), scene.moving.copy(), errors)
    states, history = resolve_initial_overlap(scene, belief, states)
    states = moved_along(start_states(scene, states, z), center_offsets(scene, z))
    return RolloutCarry(states, history, 0, z)


def most_points(scene: Scene, belief: Belief) -> int:
    """Return an upper bound of the number of points along the uncertain directions."""
    rank = int(np.count_nonzero(np.einsum("mii->mi", belief.blocks)))  # a direction without variance is none
    return 2 * (rank + len(scene.uncertain)) + 1


def point_states(carry: RolloutCarry, scene: Scene) -> np.ndarray:
    """Return the states (2 n + 1, B, 13) at the places of the scene's own centres of mass."""
    return moved_along(carry.states, -center_offsets(scene, carry.parameters))


def opposite_points(points: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of points about the middle one, and those of the opposite points.

    Parameters
    ----------
    points : (2 n + 1, B, 13) array
        States, as from `PointPairs.point_states`.
    moving : (M,) int array
        Indices of the moving bodies.

    Returns
    -------
    errors, opposite : (n, M, 12) array
    """
    errors = errors_about_first(points).reshape(len(points), -1, ERROR)[:, moving]
    count = len(points) // 2
    return errors[1 : count + 1], errors[count + 1 :]


@kernel
def errors_about_first(states):
    """Return the errors (N, 12 B) of all states (N, B, 13) about the first."""
    count, bodies = states.shape[0], states.shape[1]
    errors = empty((count, ERROR * bodies))
    for n in range(count):
        for i in range(bodies):
            boxminus(states[n, i], states[0, i], errors[n, ERROR * i : ERROR * (i + 1)])
    return errors
