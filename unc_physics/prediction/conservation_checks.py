"""Checks of energy: elastic contacts without friction keep it."""

from __future__ import annotations

import math

import numpy as np

from ..propagators.start import OVERLAP_TOLERANCE
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY

_SLOW_IMPACTS = 1e-3  # m: a fall from so low may end without a rebound, and more than once
_EQUAL = 1e-6  # relative difference of moments of inertia that are equal


def kinetic_energies(scene, mass, states) -> np.ndarray:
    """Compute the mean kinetic energy of each body over states (N, B, 13): (B,) [J]."""
    inertia = np.array([body.unit_inertia for body in scene.bodies])
    v, w, q = states[..., VELOCITY], states[..., ANGULAR_VELOCITY], states[..., QUATERNION]
    axis, scalar = -q[..., :3], q[..., 3:]
    spin = w + 2.0 * np.cross(axis, np.cross(axis, w) + scalar * w)  # about the body's axes
    squares = (v**2).sum(axis=2) + np.einsum("nbi,bij,nbj->nb", spin, inertia, spin)
    return 0.5 * mass * squares.mean(axis=0)


def conserves_energy(scene, start, touched, group) -> np.ndarray:
    """Return whether the energy of each body is conserved by all laws: (B,) bool.

    All contacts of the body's ``group`` (B,) must be elastic and without friction: bodies that ``touched``
    each other (B, B + E), directly or through others, have the same number, and share their energy. All are
    False where something damps or acts, contacts oppose spin, or parameters are uncertain. So they are for
    the explicit integrator, which stores energy in contacts and has limits of its own for its steps.
    """
    if (
        scene.integrator == "explicit"
        or scene.damping > 0.0
        or scene.acts
        or scene.draws_impacts
        or scene.uncertain
        or any(surface.torsional_friction for surface in scene.surfaces)
    ):
        return np.zeros(len(scene.bodies), bool)
    bodies, (friction, restitution) = len(scene.bodies), scene.materials
    lossy = (friction[:bodies, None] * friction > 0.0) | (restitution[:bodies, None] * restitution < 1.0)
    takes = (touched & lossy).any(axis=1) | (touched & lossy)[:, :bodies].any(axis=0)
    if not scene.gyroscopic:  # then spin keeps energy only where all axes are alike
        takes |= start.shapes[:, 1] > (1.0 + _EQUAL) * start.shapes[:, 0]
    if scene.overlap == "keep":
        takes |= start.overlap > OVERLAP_TOLERANCE
    elif start.found is not None:
        takes |= (start.found.kept > OVERLAP_TOLERANCE).any(axis=0)
    return np.bincount(group, takes, bodies)[group] == 0


def energy_loss(scene, start, position, kinetic, first_contact, group) -> np.ndarray:
    """Return the share of energy (B,) that each body's ``group`` (B,) lost (`conserves_energy`).

    Mean positions (B, 3) [m] are those at the end, and ``kinetic`` (B,) the mean kinetic energies there, from
    above [J]; the ``least_energy`` of the start is from below. ``first_contact`` (B,) is when each body first
    touched something [s]; infinite without contact.

    The loss, less what slow impacts may take, is over the largest kinetic energy that is known: at the start
    or first contact, or at the end without a loss. A body at the top of its path has no other measure.
    """
    gravity = math.sqrt(scene.gravity @ scene.gravity)
    work = start.mass * ((position - start.mean[:, POSITION]) @ scene.gravity)
    time = np.where(np.isfinite(first_contact), first_contact, 0.0)
    fall = start.mass * (time * (start.mean[:, VELOCITY] @ scene.gravity) + 0.5 * time**2 * gravity * gravity)
    lost, begun, end, fallen = (
        np.bincount(group, value, len(group))[group]
        for value in (
            start.least_energy + work - kinetic - start.mass * gravity * _SLOW_IMPACTS,
            start.least_energy,
            np.maximum(work, 0.0),
            np.maximum(fall, 0.0),
        )
    )
    known = begun + np.maximum(end, fallen)
    return lost / np.where(known > 0.0, known, math.inf)
