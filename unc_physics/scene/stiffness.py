"""Choose a contact stiffness from an allowed penetration."""

from __future__ import annotations

import dataclasses
import math
import weakref
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import LimitExceededError
from ..checks.validation import positive
from ..collision.contact_model import carrying_stiffness, stopping_stiffness
from ..spatial.layout import ANGULAR_VELOCITY, VELOCITY
from .body import RigidBody
from .scene import Scene

#: Value of a stiffness to be chosen, in scene files and over ROS.
AUTO = "auto"
#: Default penetration relative to the radius of a body's largest sphere.
PENETRATION = 0.05
#: Penetration of a body that rests on one of its smallest spheres [m]: half of the allowed one, as other
#: bodies may stand on it.
REST_DEPTH = 5e-5

_chosen = weakref.WeakKeyDictionary()  # scenes without a stiffness, and the last choice for them


def rest_stiffness(bodies: Sequence[RigidBody], mean, gravity) -> float:
    """Return a stiffness [N/m^3] at which no body that rests sinks in deeper than `REST_DEPTH`.

    The mean states (B, 13) are used only without gravity.

    Notes
    -----
    This is for the implicit integrator, whose law is `contact_model.shallow_volume`. A body's smallest sphere
    must carry its weight there, but at most at `PENETRATION` of its radius. Two spheres have a reduced
    radius of at least half of that, which makes the depth 1.4 times as large. Without gravity,
    `auto_stiffness` is used.
    """
    with np.errstate(over="ignore"):
        g = float(np.linalg.norm(gravity))
    if g == 0.0:
        return auto_stiffness(bodies, mean, gravity)
    needed = [0.0]
    for body in bodies:
        if body.free:
            radius = float(body.model.radii.min())
            needed.append(carrying_stiffness(body.mass * g, radius, min(REST_DEPTH, PENETRATION * radius)))
    return _rounded_up(max(needed))


def with_stiffness(scene: Scene, mean: np.ndarray) -> Scene:
    """Return the scene, with a stiffness chosen for its mean states ``mean`` (B, 13) if it has none.

    Equal choices return the same object.
    """
    if scene.stiffness is not None:
        return scene
    kappa = rest_stiffness(scene.bodies, mean, scene.gravity)
    if scene not in _chosen or _chosen[scene].stiffness != kappa:
        _chosen[scene] = dataclasses.replace(scene, stiffness=kappa)
    return _chosen[scene]


def auto_stiffness(
    bodies: Sequence[RigidBody],
    mean: np.ndarray,
    gravity: ArrayLike = (0.0, 0.0, 0.0),
    penetration: float = PENETRATION,
) -> float:
    """Return a stiffness at which no body penetrates another deeper than ``penetration``.

    Parameters
    ----------
    bodies : sequence of RigidBody
    mean : (B, 13) array
        States of the bodies, of which only speeds are used.
    gravity : sequence of 3 floats
        World frame [m/s^2].
    penetration : float
        Relative to the radius of a body's largest sphere.

    Returns
    -------
    float
        kappa [N/m^3].

    Notes
    -----
    The stiffness is the larger of two values. The first absorbs the energy of an impact, ``m v^2 / 2``. Its v
    adds the two highest speeds and the gain from a fall of the body's size. The second carries twice the
    weight. The result is rounded up to two digits, so that small changes of speed do not change it.

    Raises
    ------
    InvalidRequestError, LimitExceededError
    """
    penetration = positive(penetration, "penetration")
    mean, gravity = np.asarray(mean, float), float(np.linalg.norm(gravity))
    moving = [k for k, body in enumerate(bodies) if body.free]
    with np.errstate(over="ignore"):
        spins = [bodies[k].model.bounding_radius * np.linalg.norm(mean[k, ANGULAR_VELOCITY]) for k in moving]
        speeds = sorted(
            (np.linalg.norm(mean[k, VELOCITY]) + spin for k, spin in zip(moving, spins, strict=True)),
            reverse=True,
        )
    meeting = float(sum(speeds[:2]))
    kappa = 0.0
    for k in moving:
        radius, mass = float(bodies[k].model.radii.max()), bodies[k].mass
        depth = penetration * radius
        v2 = meeting * meeting + 2.0 * gravity * 2.0 * bodies[k].model.bounding_radius
        kappa = max(
            kappa,
            stopping_stiffness(mass, v2, radius, depth),
            carrying_stiffness(2.0 * mass * gravity, radius, depth),
        )
    return _rounded_up(kappa)


def _rounded_up(kappa):
    """Round up to two digits; 0 becomes 1, as any stiffness will do."""
    if kappa == 0.0:
        return 1.0
    if not math.isfinite(kappa):
        raise LimitExceededError("are too fast or too heavy for any stiffness", field="bodies")
    unit = 10.0 ** (math.floor(math.log10(kappa)) - 1)
    return math.ceil(kappa / unit) * unit
