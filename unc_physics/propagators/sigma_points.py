"""Persistent sigma points: a few states that run through the full simulator (the paper's section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..dynamics.contact_history import ContactHistory
from ..scene.belief import Belief
from ..scene.kinematic_states import start_states
from ..scene.parameters import center_offsets, moved_along
from ..scene.physics_keys import INTEGRATORS
from ..scene.scene import UNCERTAIN_PARAMETERS
from ..spatial.layout import ERROR
from ..spatial.moments import mean_and_errors, second_moment, spread_states, symmetric_root
from .base import PointPairs, Supports, Traits
from .options import option
from .rollouts import SimulatedRollouts
from .start import resolve_initial_overlap


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
        rank, extra = root.shape[1], len(scene.uncertain)
        count = rank + extra
        far = np.sqrt(count + 0.5)
        errors, z = np.zeros((2 * count + 1, len(root))), np.zeros((2 * count + 1, extra))
        for first, side in ((1, far), (1 + count, -far)):
            errors[first : first + rank] = side * root.T
            z[first + rank : first + count] = side * np.eye(extra)
        states = spread_states(belief.mean.copy(), scene.moving.copy(), errors)
        states, history = resolve_initial_overlap(scene, belief, states)
        states = moved_along(start_states(scene, states, z), center_offsets(scene, z))
        return SigmaPointCarry(states, history, 0, z)

    def belief(self, carry, scene):
        states = moved_along(carry.states, -center_offsets(scene, carry.parameters))
        mean, errors = mean_and_errors(states, scene.moving.copy())
        return Belief.trusted(mean, second_moment(errors), scene.moving)

    def point_count(self, scene, belief):
        rank = ERROR * len(belief.moving)
        if self.points == "minimal":  # a direction without variance is none
            rank = np.count_nonzero(np.einsum("mii->mi", belief.blocks))
        return 2 * (rank + len(scene.uncertain)) + 1

    def point_states(self, carry, scene):
        return moved_along(carry.states, -center_offsets(scene, carry.parameters))

    def directions(self, initial):
        if self.points == "full":
            return np.full(len(initial.moving), ERROR)
        values = np.linalg.eigvalsh(initial.blocks)
        return (values > 1e-14 * values[:, -1:]).sum(axis=1)
