"""Choose a contact stiffness from an allowed penetration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import LimitExceededError
from ..checks.validation import positive
from ..physics.paper.contact_model import carrying_stiffness, stopping_stiffness
from ..spatial.layout import ANGULAR_VELOCITY, VELOCITY
from .body import RigidBody

#: Value of a stiffness to be chosen, in scene files and over ROS.
AUTO = "auto"
#: Default penetration relative to the radius of a body's largest sphere.
PENETRATION = 0.05


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
