"""Energy and momentum of states, contacts included, which a rollout without losses conserves."""

from __future__ import annotations

import numpy as np

from unc_physics.scene.scene import Scene
from unc_physics.spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from unc_physics.spatial.rotation import rotation_matrices

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def kinetic_energy(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Return the kinetic energy (...,) of states (..., B, 13) [J]."""
    moving = scene.moving
    mass, inertia = _masses(scene)
    x = states[..., moving, :]
    spin = np.einsum("...kij,...ki->...kj", rotation_matrices(x[..., QUATERNION]), x[..., ANGULAR_VELOCITY])
    linear = np.sum(x[..., VELOCITY] ** 2, -1)
    return 0.5 * np.sum(mass * (linear + np.einsum("...ki,kij,...kj->...k", spin, inertia, spin)), -1)


def height_energy(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Return the potential energy in gravity (...,) of states (..., B, 13) [J]."""
    return -np.sum(_masses(scene)[0] * (states[..., scene.moving, POSITION] @ scene.gravity), -1)


def contact_energy(scene: Scene, state: np.ndarray) -> float:
    """Return the energy in contacts at a state (B, 13) [J]: the penalty force integrated over each depth.

    Hard contacts have none.
    """
    if scene.stiffness is None:
        return 0.0
    spheres = [
        (
            state[k, POSITION] + body.model.centers @ rotation_matrices(state[k, QUATERNION]).T,
            body.model.radii,
        )
        for k, body in enumerate(scene.bodies)
    ]
    total = 0.0
    for j, (c_j, r_j) in enumerate(spheres):
        for i, (c_i, r_i) in enumerate(spheres[:j]):
            if scene.bodies[i].fixed and scene.bodies[j].fixed:
                continue
            reach = scene.bodies[i].model.bounding_radius + scene.bodies[j].model.bounding_radius
            if np.linalg.norm(state[i, POSITION] - state[j, POSITION]) > reach:
                continue
            distance = np.linalg.norm(c_i[:, None] - c_j, axis=-1)
            R, r = np.broadcast_arrays(r_i[:, None], r_j)
            near = distance < R + r
            total += np.sum(_lens_integral(distance[near], R[near], r[near]))
        if not scene.bodies[j].fixed:
            for element in scene.environment:
                total += np.sum(_cap_integral(r_j - element.surface(c_j)[0], r_j))
    return float(scene.stiffness * total)


def momentum(scene: Scene, states: np.ndarray) -> np.ndarray:
    """Return the linear momentum (..., 3) of states (..., B, 13) [kg m/s]."""
    return np.einsum("k,...ki->...i", _masses(scene)[0], states[..., scene.moving, VELOCITY])


def _masses(scene):
    bodies = [scene.bodies[k] for k in scene.moving]
    return np.array([body.mass for body in bodies]), np.array([body.model.inertia for body in bodies])


def _lens_integral(d, R, r):
    """Integrate the lens's volume over the distance of the centres, from d until the spheres separate."""
    inner, outer = np.abs(R - r), R + r
    low = np.clip(d, inner, outer)
    s = low[..., None] + 0.5 * (outer - low)[..., None] * (1.0 + _NODES)
    lens = (
        np.pi
        * (outer[..., None] - s) ** 2
        * (s**2 + 2.0 * s * outer[..., None] - 3.0 * (inner**2)[..., None])
        / (12.0 * s)
    )
    whole = 4.0 / 3.0 * np.pi * np.minimum(R, r) ** 3
    return 0.5 * (outer - low) * (lens @ _WEIGHTS) + np.maximum(inner - d, 0.0) * whole


def _cap_integral(h, r):
    """Integrate the cap's volume over its depth, from 0 to h."""
    cap = np.clip(h, 0.0, 2.0 * r)
    return (
        np.pi * (r * cap**3 / 3.0 - cap**4 / 12.0) + np.maximum(h - 2.0 * r, 0.0) * 4.0 / 3.0 * np.pi * r**3
    )
