"""A contact stiffness in terms that a user has: how deep bodies may press into each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .layout import ANGULAR_VELOCITY, VELOCITY
from .scene import RigidBody
from .validation import positive

#: Wanted penetration, of the radius of a body's largest sphere, unless another is asked for.
PENETRATION = 0.05


def auto_stiffness(bodies: Sequence[RigidBody], mean, gravity=(0.0, 0.0, 0.0), penetration: float = PENETRATION) -> float:
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
    A sphere of reduced radius R at depth d overlaps by about ``pi R d^2``. The stiffness is the larger of what takes up
    the energy of an impact, ``kappa pi R d^3 / 3 = m v^2 / 2``, v being the sum of the two highest speeds with what the
    body gains by falling its own size, and what carries its weight twice, ``kappa pi R d^2 = 2 m g``. It is rounded up to
    two digits, so that it does not follow every change of the speeds.

    Raises
    ------
    InvalidRequestError
    """
    penetration = positive(penetration, "penetration")
    mean, gravity = np.asarray(mean, float), float(np.linalg.norm(gravity))
    moving = [k for k, body in enumerate(bodies) if not body.fixed]
    speeds = sorted(
        (np.linalg.norm(mean[k, VELOCITY]) + bodies[k].model.bounding_radius * np.linalg.norm(mean[k, ANGULAR_VELOCITY])
         for k in moving), reverse=True)
    meeting = float(sum(speeds[:2]))
    kappa = 0.0
    for k in moving:
        radius, mass = float(bodies[k].model.radii.max()), bodies[k].mass
        depth = penetration * radius
        v2 = meeting**2 + 2.0 * gravity * 2.0 * bodies[k].model.bounding_radius
        kappa = max(kappa, 1.5 * mass * v2 / (math.pi * radius * depth**3), 2.0 * mass * gravity / (math.pi * radius * depth**2))
    if kappa == 0.0:
        return 1.0  # nothing moves and nothing weighs: any will do
    unit = 10.0 ** (math.floor(math.log10(kappa)) - 1)
    return math.ceil(kappa / unit) * unit
