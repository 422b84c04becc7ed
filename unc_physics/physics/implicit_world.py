"""What the implicit step knows of a scene, and what its rollouts remember: plain arrays in NamedTuples."""

from typing import NamedTuple

import numpy as np


class Implicit(NamedTuple):
    """Physics of the implicit step, beside what `World` holds for both.

    Attributes
    ----------
    kind, position, R, size
        Of the E elements of the environment, as in `Surroundings`.
    friction, restitution : (B + E,) float64
        Each body's, then each element's; those of a contact are the geometric means of its two partners'.
    hull : (H, 4) float64
        Centres (body frame) and radii of the spheres that can touch a plane, model after model [m].
    hull_sphere : (H,) int64
        Which spheres of the scene's trees they are.
    hull_range : (B, 2) int64
        First and last (exclusive) row of each body's hull.
    extent : (B, 6) float64
        Middle and half the sides of the box around each body's spheres' centres, body frame [m].
    gyroscopic, sleep : bool
    """

    kind: np.ndarray
    position: np.ndarray
    R: np.ndarray
    size: np.ndarray
    friction: np.ndarray
    restitution: np.ndarray
    hull: np.ndarray
    hull_sphere: np.ndarray
    hull_range: np.ndarray
    extent: np.ndarray
    gyroscopic: bool
    sleep: bool


class SolverMemory(NamedTuple):
    """What N rollouts remember of their contacts from step to step.

    Attributes
    ----------
    contact : (N, K, 4) int32
        Body i, body j or ``-1 - e`` for element e, and the sphere of each (0 for an element's) of contacts that carry load.
    force : (N, K, 4) float32
        Their normal force, and the friction force in world axes [N].
    count : (N,) int64
        How many there are. Those beyond K start from zero in the next step, which costs time and no contact.
    quiet : (N, B) int64
        Steps for which each body has been at rest.
    residual : (N, B) float32
        Largest residual of the contact law so far, relative to the load, of the contacts of each body.
    """

    contact: np.ndarray
    force: np.ndarray
    count: np.ndarray
    quiet: np.ndarray
    residual: np.ndarray


def fresh_solver_memory(count, bodies):
    """The memory of rollouts that begin."""
    room = 32 + 32 * bodies
    return SolverMemory(
        np.zeros((count, room, 4), np.int32),
        np.zeros((count, room, 4), np.float32),
        np.zeros(count, np.int64),
        np.zeros((count, bodies), np.int64),
        np.zeros((count, bodies), np.float32),
    )
