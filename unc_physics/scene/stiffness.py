"""A contact stiffness in terms that a user has: how deep bodies may press into each other."""

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

#: What stands for a stiffness that is to be chosen, in scene files and over ROS.
AUTO = "auto"
#: Wanted penetration, of the radius of a body's largest sphere, unless another is asked for.
PENETRATION = 0.05
#: How deep a body sinks in that rests on one of its smallest spheres [m]: half of what is allowed, as others
#: may stand on it.
REST_DEPTH = 5e-5

_chosen = weakref.WeakKeyDictionary()  # scenes without a stiffness, and what was last chosen for them


def rest_stiffness(bodies: Sequence[RigidBody], mean, gravity, depth: float = REST_DEPTH) -> float:
    """A stiffness at which no body that lies on something sinks in deeper than wanted.

    Parameters
    ----------
    bodies : sequence of RigidBody
    mean : (B, 13) array
        Their states, which count without gravity only.
    gravity : sequence of 3 floats
        World frame [m/s^2].
    depth : float
        [m]

    Returns
    -------
    float
        kappa [N/m^3].

    Notes
    -----
    For the implicit integrator, whose law is `contact_model.shallow_volume`. A body's smallest sphere is to
    carry its weight; tiny spheres no deeper than `PENETRATION` of their radius. Of two spheres that meet the
    reduced radius counts, which is down to half of that: the depth is then 1.4 times as large. Where nothing
    weighs, nothing rests, and `auto_stiffness` tells what takes up impacts.

    Raises
    ------
    InvalidRequestError, LimitExceededError
    """
    depth = positive(depth, "depth")
    with np.errstate(over="ignore"):
        g = float(np.linalg.norm(gravity))
    if g == 0.0:
        return auto_stiffness(bodies, mean, gravity)
    needed = [0.0]
    for body in bodies:
        if body.free:
            radius = float(body.model.radii.min())
            needed.append(carrying_stiffness(body.mass * g, radius, min(depth, PENETRATION * radius)))
    return _rounded_up(max(needed))


def with_stiffness(scene: Scene, mean: np.ndarray) -> Scene:
    """The scene itself; one without a stiffness, with that which is chosen for its states ``mean`` (B, 13).

    The same choice gives the same object again.
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
    """A stiffness at which no body presses deeper into another than wanted.

    Parameters
    ----------
    bodies : sequence of RigidBody
    mean : (B, 13) array
        Their states, of which the speeds count.
    gravity : sequence of 3 floats
        World frame [m/s^2].
    penetration : float
        Depth relative to the radius of a body's largest sphere, for every body.

    Returns
    -------
    float
        kappa [N/m^3].

    Notes
    -----
    The stiffness is the larger of what takes up the energy of an impact, ``m v^2 / 2``, v being the sum of
    the two highest speeds with what the body gains by falling its own size, and what carries its weight
    twice. It is rounded up to two digits, so that it does not follow every change of the
    speeds.

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
    """To two digits; where nothing moves and nothing weighs any stiffness will do."""
    if kappa == 0.0:
        return 1.0
    if not math.isfinite(kappa):
        raise LimitExceededError("are too fast or too heavy for any stiffness", field="bodies")
    unit = 10.0 ** (math.floor(math.log10(kappa)) - 1)
    return math.ceil(kappa / unit) * unit
