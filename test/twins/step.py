"""Twin of one time step: brute force over all pairs of spheres, for a batch of rollouts at once."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from .contact import cap_volume, sphere_contacts
from .states import P, Q, V, W


class Body(NamedTuple):
    """Spheres and inertia (with its mass in it) in the body frame, COM at the origin."""

    centers: np.ndarray
    radii: np.ndarray
    mass: float
    inertia: np.ndarray
    fixed: bool = False


class Physics(NamedTuple):
    dt: float
    stiffness: float
    damping: float = 0.0
    gravity: tuple = (0.0, 0.0, 0.0)
    planes: tuple = ()  # of (unit normal, offset)


def bodies_of(scene):
    """The twin's bodies of a scene."""
    return [
        Body(b.model.centers, b.model.radii, b.mass, b.mass * b.model.inertia, b.fixed) for b in scene.bodies
    ]


def physics_of(scene):
    """The twin's physics of a scene, whose environment is of planes."""
    planes = tuple((plane.normal, plane.offset) for plane in scene.environment)
    return Physics(scene.dt, scene.stiffness, scene.damping, tuple(scene.gravity), planes)


def step(states, bodies, physics):
    """States (N, B, 13) one step later."""
    x, dt = states.copy(), physics.dt
    moving = [b for b, body in enumerate(bodies) if not body.fixed]
    for b in moving:
        x[:, b, P] += dt * x[:, b, V]
        turn = Rotation.from_rotvec(dt * x[:, b, W]) * Rotation.from_quat(x[:, b, Q])
        x[:, b, Q] = turn.as_quat()
        x[:, b, V] *= np.exp(-physics.damping * dt)
        x[:, b, W] *= np.exp(-physics.damping * dt)
        x[:, b, V] += dt * np.array(physics.gravity)
    pairs, planes = wrenches(x, bodies, physics.stiffness), plane_wrenches(x, bodies, physics)
    forces, torques = pairs[0] + planes[0], pairs[1] + planes[1]
    for b in moving:
        R = rotation_matrices(x, b)
        inverse_inertia = R @ np.linalg.inv(bodies[b].inertia) @ R.transpose(0, 2, 1)
        x[:, b, V] += dt * forces[:, b] / bodies[b].mass
        x[:, b, W] += dt * np.einsum("nij,nj->ni", inverse_inertia, torques[:, b])
    return x


def wrenches(x, bodies, stiffness):
    """Contact forces and torques about the COM, world frame, each (N, B, 3)."""
    forces, torques = np.zeros_like(x[..., P]), np.zeros_like(x[..., P])
    for i in range(len(bodies)):
        for j in range(i + 1, len(bodies)):
            force, point = sphere_contacts(
                world_centers(x, i, bodies[i]),
                bodies[i].radii,
                world_centers(x, j, bodies[j]),
                bodies[j].radii,
            )
            force = stiffness * force
            for b, f in ((i, -force), (j, force)):
                arm = point - x[:, b, None, None, P]
                forces[:, b] += f.sum(axis=(1, 2))
                torques[:, b] += np.cross(arm, f).sum(axis=(1, 2))
    return forces, torques


def plane_wrenches(x, bodies, physics):
    """As `wrenches`, of all spheres with the half-spaces: the cap's volume, in the middle of its height."""
    forces, torques = np.zeros_like(x[..., P]), np.zeros_like(x[..., P])
    for b, body in enumerate(bodies):
        centers = world_centers(x, b, body)
        for normal, offset in physics.planes:
            height = np.clip(body.radii - (centers @ normal - offset), 0.0, 2.0 * body.radii)
            force = physics.stiffness * cap_volume(body.radii, height)[..., None] * normal
            point = centers - (body.radii - height / 2.0)[..., None] * normal
            forces[:, b] += force.sum(axis=1)
            torques[:, b] += np.cross(point - x[:, b, None, P], force).sum(axis=1)
    return forces, torques


def rotation_matrices(x, b):
    """(N, 3, 3): R_world_body of body b."""
    return Rotation.from_quat(x[:, b, Q]).as_matrix()


def world_centers(x, b, body):
    """(N, n, 3): sphere centres of body b in the world."""
    return x[:, b, None, P] + np.einsum("nij,kj->nki", rotation_matrices(x, b), body.centers)


def rollout(states, bodies, physics, steps):
    """States (N, B, 13) after some steps."""
    for _ in range(steps):
        states = step(states, bodies, physics)
    return states
