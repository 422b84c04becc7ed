"""What the implicit step knows of a scene, and what its rollouts remember: plain arrays in NamedTuples."""

import math
from typing import NamedTuple

import numpy as np

from ..collision.faces import Faces
from ..collision.implicit_workspace import REMEMBERED_CONTACTS

#: Of worlds that nothing stops.
NEVER = np.zeros(1, np.int64)


class ImpactError(NamedTuple):
    """Standard deviations of what is drawn at each impact; all zero where nothing is.

    Attributes
    ----------
    direction : float
        Of the turn of the impulse about each axis [rad].
    point : float
        Of the shift of where it acts, along each axis of the surface [m].
    friction : float
        Of the logarithm of the factor of friction.
    identity : (B + E,) int64
        Numbers of the bodies and elements that stay the same in a part of the scene.
    """

    direction: float
    point: float
    friction: float
    identity: np.ndarray


_QUIET_TIME = 0.1  # s, for which bodies rest before they sleep


def rest_steps(dt: float) -> int:
    """Return the number of steps at rest after which bodies sleep."""
    return math.ceil(_QUIET_TIME / dt)


class Implicit(NamedTuple):
    """Physics of the implicit step, beside what `World` holds for both.

    Attributes
    ----------
    friction, restitution : (B + E,) float64
        Each body's, then each element's; those of a contact are the geometric means of its two partners'.
    torsion : (B + E,) float64
        Likewise the length that, times a contact's normal force, is the most moment against its spin [m];
        below 0 where nothing is said, so that the partner's counts alone.
    torsional : bool
        Whether there is one.
    hull : (4, H + 8) float64
        Centres (body frame) and radii of the spheres that can touch a plane, model after model [m].
    hull_sphere : (H,) int64
        Which spheres of the scene's trees they are.
    hull_range : (B, 2) int64
        First and last (exclusive) column of each body's hull.
    faces : Faces
        Flat faces of the models.
    extent : (B, 6) float64
        Middle and half the sides of the box around each body's spheres' centres, body frame [m].
    box : (B, 6) float64
        The same of the box around the spheres themselves.
    rest_steps : int
        Number of steps at rest after which bodies sleep: they are not computed until something pushes them.
        0: they never sleep.
    impact_error : ImpactError
    stop : (1,) int64
        Kernels end early when this is no longer 0, with states that mean nothing (`time_limit`).
    """

    friction: np.ndarray
    restitution: np.ndarray
    torsion: np.ndarray
    torsional: bool
    hull: np.ndarray
    hull_sphere: np.ndarray
    hull_range: np.ndarray
    faces: Faces
    extent: np.ndarray
    box: np.ndarray
    rest_steps: int
    impact_error: ImpactError
    stop: np.ndarray = NEVER

    def of_bodies(self, bodies):
        """The same of some bodies, whose indices ascend, and of all elements."""
        some = np.concatenate([bodies, np.arange(len(self.hull_range), len(self.friction))])
        return self._replace(
            friction=self.friction[some],
            restitution=self.restitution[some],
            torsion=self.torsion[some],
            hull_range=self.hull_range[bodies],
            extent=self.extent[bodies],
            box=self.box[bodies],
            impact_error=self.impact_error._replace(identity=self.impact_error.identity[some]),
        )


class SolverMemory(NamedTuple):
    """What N rollouts remember of their contacts from step to step.

    Attributes
    ----------
    contact : (N, K, 4) int32
        Body i, body j or ``-1 - e`` for element e, and the sphere of each (0 for an element's) of contacts
        that carry load.
    force : (N, K, 4) float32
        Their normal force, and the friction force in world axes [N].
    count : (N,) int64
        How many there are, at most `REMEMBERED_CONTACTS` of each body i. Those beyond start from zero in the
        next step, which costs time and no contact.
    quiet : (N, B) int64
        Steps for which each body has been at rest.
    residual : (N, B) float32
        Largest residual of the contact law so far, relative to the load, of the contacts of each body.
    kept_overlap : (N, B, B + E) or (N, 0, 0) float32
        By how much bodies i < j, or body i and element j - B, overlap for ever, without a force [m]: what
        could not come free at the start; empty where nothing does.
    key : (N,) uint64
        What the rollouts' own errors of impacts are drawn from (`ImpactError`).
    """

    contact: np.ndarray
    force: np.ndarray
    count: np.ndarray
    quiet: np.ndarray
    residual: np.ndarray
    kept_overlap: np.ndarray
    key: np.ndarray


def fresh_solver_memory(count, bodies):
    """The memory of rollouts that begin."""
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
    """The memory of some bodies, which ascend and touch no others; ``kept_overlap`` is theirs."""
    count = len(memory.count)
    place = np.full(memory.quiet.shape[1], -1)
    place[bodies] = np.arange(len(bodies))
    own = fresh_solver_memory(count, len(bodies))._replace(kept_overlap=kept_overlap, key=memory.key)
    own.quiet[:], own.residual[:] = memory.quiet[:, bodies], memory.residual[:, bodies]
    for n in np.flatnonzero(memory.count):
        contact = memory.contact[n, : memory.count[n]]
        kept = place[contact[:, 0]] >= 0
        _append(own, n, _renumbered(contact[kept], place), memory.force[n, : memory.count[n]][kept])
    return own


def add_bodies(memory, own, bodies, followed):
    """Add the memory of some bodies, which touched no others: rollout n of the joint memory follows rollout
    ``followed[n]`` of theirs.
    """
    memory.quiet[:, bodies], memory.residual[:, bodies] = own.quiet[followed], own.residual[followed]
    memory.key[:] = own.key[followed]
    for n in np.flatnonzero(own.count[followed]):
        k = followed[n]
        _append(memory, n, _renumbered(own.contact[k, : own.count[k]], bodies), own.force[k, : own.count[k]])


def _renumbered(contact, place):
    """Contacts with other numbers of their bodies."""
    changed = contact.copy()
    changed[:, 0] = place[contact[:, 0]]
    another = contact[:, 1] >= 0
    changed[another, 1] = place[contact[another, 1]]
    return changed


def _append(memory, n, contact, force):
    """Add contacts to what rollout ``n`` remembers."""
    first, last = memory.count[n], memory.count[n] + len(contact)
    memory.contact[n, first:last], memory.force[n, first:last] = contact, force
    memory.count[n] = last
