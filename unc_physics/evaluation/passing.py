"""Whether bodies passed through each other or through the environment on their way."""

from __future__ import annotations

import numpy as np

from ..environment import Plane
from ..layout import POSITION, QUATERNION
from ..scene import Scene
from .energy import matrices, surface_distance

CORE = 0.9  # of the radius of a body's largest sphere: spheres larger than that are its core


def passed_through(scene: Scene, states: np.ndarray) -> bool:
    """Whether a body passed through another, or through an element of the environment.

    Parameters
    ----------
    scene : Scene
    states : (T, B, 13) array
        One after another, as close as steps; between them all moves straight.

    Notes
    -----
    A body's core is its largest spheres. It passed through another body if the centre of one of them came inside a
    sphere of the other's core or that one's centre inside it; through a plane or a box if such a centre came under its surface. What begins that deep is
    not counted.
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
    """Centres (T, n, 3) of a body's largest spheres in the world, and their radius."""
    model = body.model
    large = model.radii >= CORE * model.radii.max()
    turned = np.einsum("tij,nj->tni", matrices(states[:, QUATERNION]), model.centers[large])
    return states[:, None, POSITION] + turned, float(model.radii.max())


def _met(c_i, c_j, reach):
    """Whether centres that were farther apart than ``reach`` came closer."""
    a = c_j[:, None, :, :] - c_i[:, :, None, :]
    step = np.diff(a, axis=0)
    if (np.linalg.norm(a[0], axis=-1) < reach).any():
        return False
    square = np.sum(step**2, -1)
    along = np.clip(-np.sum(a[:-1] * step, -1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(a[:-1] + along[..., None] * step, axis=-1)
    return bool((nearest < reach).any())


def _entered(element, centers):
    """Whether centres (T, n, 3) that were outside an element came inside or crossed it."""
    if (surface_distance(element, centers[0]) < 0.0).any():
        return False
    if isinstance(element, Plane):
        return bool((surface_distance(element, centers) < 0.0).any())
    local = (centers - element.position) @ matrices(element.orientation)
    begin, step = local[:-1], np.diff(local, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel to a face: infinite or undefined, and so never within
        one, other = ((side * 0.5 * element.size - begin) / step for side in (-1.0, 1.0))
    still = (step == 0.0) & (np.abs(begin) < 0.5 * element.size)
    enter = np.where(still, -np.inf, np.fmin(one, other)).max(-1)
    leave = np.where(still, np.inf, np.fmax(one, other)).min(-1)
    return bool(((enter < leave) & (leave > 0.0) & (enter < 1.0)).any())
