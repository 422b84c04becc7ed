"""Persistent sigma points: a few states that run through the full simulator (the paper's section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks.errors import InvalidOptionError
from ..physics.contact_history import ContactHistory
from ..physics.moments import mean_and_errors, second_moment, spread_states
from ..scene.belief import Belief
from ..scene.parameters import center_offsets, moved_along
from ..scene.scene import INTEGRATORS
from .base import Propagator, Traits, rolled, symmetric_root
from .start import begin


class SigmaPointCarry(NamedTuple):
    """Persistent state: ``states`` (2 n + 1, B, 13) of the centres of mass; point 0 began at the mean.

    ``parameters`` (2 n + 1, K) are the points' K uncertain parameters, in standard deviations; ``step``
    counts the steps done; ``contact_history`` is what the rollouts remember of their contacts.
    """

    states: np.ndarray
    contact_history: ContactHistory
    step: int
    parameters: np.ndarray


@dataclass(frozen=True)
class SigmaPoints(Propagator):
    """Persistent sigma points.

    Attributes
    ----------
    points : {'minimal', 'full'}
        ``full`` spreads points along all 12 B directions of the moving bodies, as the paper; ``minimal`` only
        along the r directions in which the initial belief is uncertain, which needs fewer points, less far
        out. Each uncertain parameter of the scene is one direction more.

    Notes
    -----
    With n directions, the 2 n + 1 points have equal weights and lambda = 1/2, so that they rebuild the
    initial covariance exactly (Eqs. 25 to 29). The root in Eq. 26 is the symmetric one for ``full`` and the
    pivoted Cholesky factor for ``minimal``.
    """

    name = "sigma_points"
    varies_parameters = True
    integrators = INTEGRATORS
    traits = Traits("estimated", "full covariance", True, False, "simulated")

    points: str = "minimal"

    def __post_init__(self):
        if self.points not in ("minimal", "full"):
            raise InvalidOptionError("must be 'minimal' or 'full'", field="points", value=self.points)

    def init(self, scene, belief):
        root = belief.root() if self.points == "minimal" else symmetric_root(belief.joint)
        rank, extra = root.shape[1], len(scene.uncertain)
        count = rank + extra
        far = np.sqrt(count + 0.5)
        errors, z = np.zeros((2 * count + 1, len(root))), np.zeros((2 * count + 1, extra))
        for first, side in ((1, far), (1 + count, -far)):
            errors[first : first + rank] = side * root.T
            z[first + rank : first + count] = side * np.eye(extra)
        states = spread_states(belief.mean.copy(), scene.moving.copy(), errors)
        states, history = begin(scene, belief, states)
        states = moved_along(states, center_offsets(scene, z))
        return SigmaPointCarry(states, history, 0, z)

    def advance(self, carry, scene, steps):
        return rolled(carry, scene, steps)

    def belief(self, carry, scene):
        states = moved_along(carry.states, -center_offsets(scene, carry.parameters))
        mean, errors = mean_and_errors(states, scene.moving.copy())
        return Belief.trusted(mean, second_moment(errors), scene.moving)
