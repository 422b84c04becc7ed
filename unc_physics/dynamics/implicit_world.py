"""Data of the implicit step: a scene's physics and the memory of rollouts, as arrays in NamedTuples."""

import math
from typing import NamedTuple

import numpy as np

from ..collision.faces import Faces
from ..collision.implicit_workspace import REMEMBERED_CONTACTS

#: Stop flag of worlds that are never stopped.
NEVER = np.zeros(1, np.int64)


class ImpactError(NamedTuple):
    """Standard deviations of random impact errors; all zero if there are none.

    Attributes
    ----------
    direction : float
        Rotation of the impulse about each axis [rad].
    point : float
        Shift of the contact point along each axis of the surface [m].
    friction : float
        Logarithm of the factor on friction.
    """

    direction: float
    point: float
    friction: float


_QUIET_TIME = 0.1  # s, time at rest after which bodies sleep


def rest_steps(dt: float) -> int:
    """Return the number of steps at rest after which bodies sleep."""
    return math.ceil(_QUIET_TIME / dt)


class Implicit(NamedTuple):
    """Physics of the implicit step, in addition to the common fields of `World`.

    Attributes
    ----------
    friction, restitution : (B + E,) float64
        Values of each body, then of each element; a contact has the geometric mean of its two partners'.
    torsion : (B + E,) float64
        Largest moment about the contact normal per normal force [m], of each body, then of each element.
        Below 0 if not given; the partner's value is then used.
    torsional : bool
        Whether any surface has torsional friction.
    hull : (4, H + 8) float64
        Centres (body frame) and radii of the spheres that can touch a plane, model after model [m].
    hull_sphere : (H,) int64
        Indices of these spheres in the scene's trees.
    hull_range : (B, 2) int64
        First and last (exclusive) column of each body's hull.
    faces : Faces
        Flat faces of the models.
    face_range : (B, 2) int64
        First and last (exclusive) face of each body.
    extent : (B, 6) float64
        Centre and half the sides of the bounding box of each body's sphere centres, body frame [m].
    box : (B, 6) float64
        The same for the bounding box of the spheres.
    rest_steps : int
        Number of steps at rest after which bodies sleep until something pushes them; 0 means never.
    impact_error : ImpactError
    impact_slipperiness : float
        Inverse of the closing speed at which friction of an impact is halved (`friction.weaken_with_speed`)
        [s/m]; 0 if friction does not depend on it.
    stop : (1,) int64
        Kernels stop early when this is nonzero; their states are then invalid (`time_limit`).
    """

    friction: np.ndarray
    restitution: np.ndarray
    torsion: np.ndarray
    torsional: bool
    hull: np.ndarray
    hull_sphere: np.ndarray
    hull_range: np.ndarray
    faces: Faces
    face_range: np.ndarray
    extent: np.ndarray
    box: np.ndarray
    rest_steps: int
    impact_error: ImpactError
    impact_slipperiness: float
    stop: np.ndarray = NEVER


class SolverMemory(NamedTuple):
    """Solver state that N rollouts carry from step to step.

    Attributes
    ----------
    contact : (N, K, 4) int32
        Body i, body j or ``-1 - e`` for element e, and the sphere of each (0 for an element), of loaded
        contacts.
    force : (N, K, 4) float32
        Normal force and friction force in world axes [N].
    count : (N,) int64
        Number of these contacts, at most `REMEMBERED_CONTACTS` for each body i. Contacts beyond have no
        initial guess in the next step, which only costs time.
    rest_steps : (N, B) int64
        Number of steps for which each body has been at rest.
    residual : (N, B) float32
        Largest residual of each body's contacts so far (`implicit_solver.residual_of`).
    kept_overlap : (N, B, B + E) or (N, 0, 0) float32
        Permanent overlap of bodies i < j, or of body i and element j - B, without a force [m]. It remains if
        the initial projection could not remove it. Empty without such overlap.
    key : (N,) uint64
        Keys for the random impact errors of each rollout (`ImpactError`).
    """

    contact: np.ndarray
    force: np.ndarray
    count: np.ndarray
    rest_steps: np.ndarray
    residual: np.ndarray
    kept_overlap: np.ndarray
    key: np.ndarray


class Rollout(NamedTuple):
    """Memory of one rollout, and the closing speeds that count as impacts in it (`implicit_step.rollout_of`).

    Attributes
    ----------
    first_time : (B, B + E) float32
        As in `ContactHistory`.
    contact, force, count, rest_steps, residual, key
        As in `SolverMemory`, without the first axis; ``count`` is (1,).
    threshold : float
        Closing speed above which contacts have impacts; elastic ones have a lower one (`impact_speed`) [m/s].
    slowest : float
        The lowest of them. Slower contacts have no impacts, except edges that land [m/s].
    """

    first_time: np.ndarray
    contact: np.ndarray
    force: np.ndarray
    count: np.ndarray
    rest_steps: np.ndarray
    residual: np.ndarray
    key: int
    threshold: float
    slowest: float


def fresh_solver_memory(count, bodies):
    """Return the memory of new rollouts."""
    room = REMEMBERED_CONTACTS * bodies
    return SolverMemory(
        np.zeros((count, room, 4), np.int32),
        np.zeros((count, room, 4), np.float32),
        np.zeros(count, np.int64),
        np.zeros((count, bodies), np.int64),
        np.zeros((count, bodies), np.float32),
        np.zeros((count, 0, 0), np.float32),
        np.zeros(count, np.uint64),
    )


def of_bodies(memory, bodies, kept_overlap):
    """Return the memory of some bodies; their contacts with others are forgotten.

    ``kept_overlap`` is theirs.
    """
    place = np.full(memory.rest_steps.shape[1], -1)
    place[bodies] = np.arange(len(bodies))
    own = fresh_solver_memory(len(memory.count), len(bodies))
    own.rest_steps[:], own.residual[:] = memory.rest_steps[:, bodies], memory.residual[:, bodies]
    for n, count in enumerate(memory.count):
        contact, force = memory.contact[n, :count].copy(), memory.force[n, :count]
        between = contact[:, 1] >= 0
        contact[:, 0] = place[contact[:, 0]]
        contact[between, 1] = place[contact[between, 1]]
        kept = (contact[:, 0] >= 0) & ~(between & (contact[:, 1] < 0))
        own.count[n] = kept.sum()
        own.contact[n, : own.count[n]], own.force[n, : own.count[n]] = contact[kept], force[kept]
    return own._replace(kept_overlap=kept_overlap, key=memory.key)
