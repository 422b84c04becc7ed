"""How accurate the share of quasi-random rollouts is in which an event happens.

The binomial error of a share is that of independent rollouts. Quasi-random points are spread evenly, so that
only a part of the event's variance counts. Two estimates of this part are used. One is what a regression on
the points does not predict of a rollout that is left out. The other is how much the shares of successive
blocks of points vary: each aligned block of Sobol points is spread evenly by itself.
"""

from __future__ import annotations

import math

import numpy as np

#: Rollouts from which on the regression is used, and the most that it takes: a fit costs their third power.
FEWEST, MOST = 32, 1024
#: Length scales of the regression, over the root of the dimensions, of which each event takes the best; and
#: the variance of its noise over that of the event.
_SCALES, _NOISE = (0.5, 1.0, 2.0), 0.3
#: Points of a block; and how many blocks the regression's estimate counts as in the mean of both estimates.
#: With fewer, intervals about events without any pattern miss too often.
_BLOCK, _PRIOR = 8, 8
#: Largest ratio of the counts; larger ones, estimated from few residuals, were not checked for coverage.
_LARGEST = 4.0


def residual_maps(z: np.ndarray) -> list[np.ndarray]:
    """Return matrices (N, N) from N values at points ``z`` (N, K) to their residuals with each left out.

    There is one for each length scale. The values must have mean 0.
    """
    squares = (z**2).sum(axis=1)
    distances = np.maximum(squares[:, None] + squares - 2.0 * z @ z.T, 0.0) / z.shape[1]
    maps = []
    for scale in _SCALES:
        inverse = np.linalg.inv(np.exp(-0.5 * distances / scale**2) + _NOISE * np.eye(len(z)))
        maps.append(inverse / inverse.diagonal()[:, None])
    return maps


def effective_counts(maps: list[np.ndarray], happened: np.ndarray) -> np.ndarray:
    """Return the numbers (E,) of independent rollouts whose shares are as accurate as those of N points.

    Parameters
    ----------
    maps : list of (M, M) array
        `residual_maps` of the first M points.
    happened : (E, N) bool array
        Whether each of E events happens in each rollout.
    """
    count = happened.shape[1]
    first = happened[:, : len(maps[0])].astype(float)
    share = first.mean(axis=1)
    variance = share * (1.0 - share)
    values = first - share[:, None]
    rest = np.min([((values @ one.T) ** 2).mean(axis=1) for one in maps], axis=0)
    rest = np.minimum(rest, variance)
    blocks = values[:, : values.shape[1] // _BLOCK * _BLOCK].reshape(len(values), -1, _BLOCK).mean(axis=2)
    others = blocks.shape[1] - 1
    between = _BLOCK * blocks.var(axis=1, ddof=1) * (1.0 + math.sqrt(0.5 / others))  # half its error more
    rest = np.minimum(rest, (others * between + _PRIOR * rest) / (others + _PRIOR))
    ratio = np.divide(variance, rest, out=np.ones(len(share)), where=rest > 0.0)
    return count * np.clip(ratio, 1.0, _LARGEST)
