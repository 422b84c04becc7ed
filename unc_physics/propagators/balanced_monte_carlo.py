"""Monte Carlo of few samples for estimates of a spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.belief import Belief
from ..spatial.layout import ERROR
from .monte_carlo import MonteCarlo
from .sobol import normal_points


@dataclass(frozen=True)
class BalancedMonteCarlo(MonteCarlo):
    """Monte Carlo whose draws have mean and covariance of the belief, so that few suffice for a spread.

    Notes
    -----
    Sobol points (N, r), as normal numbers, are made orthogonal to 1 and to each other, N - 1 columns at a
    time. Linear functions of so many directions then have exactly their spread, where twelve plain draws have
    errors of a fifth.
    """

    random_moments = False

    def drawn(self, scene, belief, count):
        """Return states drawn as in `MonteCarlo.drawn`, but with other ones for each count.

        One sample, and samples of a scene that rejects overlap, are plain draws.
        """
        if scene.overlap == "reject" or count < 2:
            return super().drawn(scene, belief, count)
        return belief.states_along(_balanced(normal_points(count, belief.rank, self.seed)))


#: Factor on the spread of states and parameters in `WideMonteCarlo`.
WIDE = 2.0


@dataclass(frozen=True)
class WideMonteCarlo(BalancedMonteCarlo):
    """Monte Carlo of a belief that is twice as wide, so that few samples reach rare outcomes.

    Notes
    -----
    An outcome beyond 2.6 standard deviations, which happens once in 200 samples, is beyond 1.3 here, and
    happens once in ten.
    """

    def drawn(self, scene, belief, count):
        return super().drawn(
            scene, Belief.trusted(belief.mean, WIDE**2 * belief.covariance, belief.moving), count
        )

    def drawn_parameters(self, scene, count):
        if count < 2:
            return WIDE * super().drawn_parameters(scene, count)
        first = ERROR * len(scene.moving)  # the columns before are those of the states
        return WIDE * _balanced(normal_points(count, first + len(scene.uncertain), self.seed)[:, first:])


def _balanced(z):
    """Return numbers (N, r) with mean 0 and variance 1 in each column, uncorrelated if N suffices."""
    count = len(z)
    z = z - z.mean(axis=0)
    for first in range(0, z.shape[1], count - 1):
        some = slice(first, first + count - 1)
        q, r = np.linalg.qr(z[:, some])
        z[:, some] = np.sqrt(count) * q * np.where(np.diag(r) < 0.0, -1.0, 1.0)
    return z
