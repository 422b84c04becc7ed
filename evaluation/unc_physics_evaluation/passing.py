"""Check for bodies that passed through each other or through the environment."""

from __future__ import annotations

import numpy as np

from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import POSITION, QUATERNION
from unc_physics.spatial.rotation import rotation_matrices

_THIRDS = 60  # that a way is shortened by to find its nearest point: to 1e-11 of it
CORE = 0.9  # of the radius of a body's largest sphere: spheres larger than that are its core


def passed_through(scene: Scene, states: np.ndarray) -> bool:
    """Return whether a body passed through another one or through an element of the environment.

    Parameters
    ----------
    scene : Scene
    states : (T, B, 13) array
        Consecutive states, one time step apart; motion between them counts as straight.

    Notes
    -----
    A body's core is its largest spheres. Two bodies passed through each other if a centre of one core entered
    a sphere of the other core. A body passed through an element if a centre of its core went below the
    surface. Penetrations at the first state are not counted.
    """
    cores = [_core(body, states[:, k]) for k, body in enumerate(scene.bodies)]
    for j, (c_j, r_j) in enumerate(cores):
        if scene.bodies[j].fixed:
            continue
        if any(_entered(element, c_j) for element in scene.environment):
            return True
        for i, (c_i, r_i) in enumerate(cores):
            if i < j or scene.bodies[i].fixed:
                if _met(c_i, c_j, max(r_i, r_j)):
                    return True
    return False


def _core(body, states):
    """Return the centres (T, n, 3) of a body's largest spheres in the world, and their radius."""
    model = body.model
    large = model.radii >= CORE * model.radii.max()
    turned = np.einsum("tij,nj->tni", rotation_matrices(states[:, QUATERNION]), model.centers[large])
    return states[:, None, POSITION] + turned, float(model.radii.max())


def _met(c_i, c_j, reach):
    """Return whether centres with a distance above ``reach`` came closer than that."""
    a = c_j[:, None, :, :] - c_i[:, :, None, :]
    step = np.diff(a, axis=0)
    if (np.linalg.norm(a[0], axis=-1) < reach).any():
        return False
    square = np.sum(step**2, -1)
    along = np.clip(-np.sum(a[:-1] * step, -1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(a[:-1] + along[..., None] * step, axis=-1)
    return bool((nearest < reach).any())


def _entered(element, centers):
    """Return whether centres (T, n, 3) outside an element entered or crossed it."""
    distance = element.surface(centers)[0]
    if (distance[0] < 0.0).any():
        return False
    if (distance < 0.0).any():
        return True
    # between two times a centre comes nearer by half the way it still has, at most
    way = np.linalg.norm(np.diff(centers, axis=0), axis=-1)
    may = distance[:-1] + distance[1:] < way
    begin, end = centers[:-1][may], centers[1:][may]
    # all elements are convex, so the distance along a straight line is, too, and has one minimum
    for _ in range(_THIRDS):
        near, far = (2.0 * begin + end) / 3.0, (begin + 2.0 * end) / 3.0
        rises = (element.surface(near)[0] < element.surface(far)[0])[:, None]
        begin, end = np.where(rises, begin, near), np.where(rises, far, end)
    return bool((element.surface(0.5 * (begin + end))[0] < 0.0).any())
