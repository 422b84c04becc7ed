"""Persistent sigma points: a few states that run through the full simulator (the paper's section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.belief import Belief
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS
from ..spatial.layout import ERROR
from ..spatial.moments import mean_and_errors, second_moment, symmetric_root
from .base import PointPairs, Supports, Traits
from .options import option
from .point_pairs import most_points, point_states, spread_points
from .rollouts import SimulatedRollouts


@dataclass(frozen=True)
class SigmaPoints(SimulatedRollouts, PointPairs):
    """Persistent sigma points.

    Notes
    -----
    With n directions, the 2 n + 1 points have equal weights and lambda = 1/2, so that they rebuild the
    initial covariance exactly (Eqs. 25 to 29). The root in Eq. 26 is the symmetric one for ``full`` and the
    pivoted Cholesky factor for ``minimal``.
    """

    name = "sigma_points"
    traits = Traits("estimated", "full covariance", True, False, "simulated")
    integrators = INTEGRATORS
    supports = Supports(UNCERTAIN_PARAMETERS, INTEGRATORS)

    #: ``full`` spreads points along all 12 B directions of the moving bodies, as in the
    #: paper. ``minimal`` spreads them along the r uncertain directions of the initial belief only. It needs
    #: fewer points, which lie less far out. Each uncertain parameter of the scene is one direction more.
    points: str = option(
        "minimal",
        "directions that points are spread along: the uncertain ones, or all",
        choices=("minimal", "full"),
    )

    def init(self, scene, belief):
        root = belief.root() if self.points == "minimal" else symmetric_root(belief.joint)
        count = root.shape[1] + len(scene.uncertain)
        return spread_points(scene, belief, root, np.full(count, np.sqrt(count + 0.5)))

    def belief(self, carry, scene):
        mean, errors = mean_and_errors(point_states(carry, scene), scene.moving.copy())
        return Belief.trusted(mean, second_moment(errors), scene.moving)

    def most_rollouts(self, scene, belief):
        if self.points == "minimal":
            return most_points(scene, belief)
        return 2 * (ERROR * len(belief.moving) + len(scene.uncertain)) + 1

    def point_states(self, carry, scene):
        return point_states(carry, scene)

    def directions(self, initial):
        if self.points == "full":
            return np.full(len(initial.moving), ERROR)
        values = np.linalg.eigvalsh(initial.blocks)
        return (values > 1e-14 * values[:, -1:]).sum(axis=1)
