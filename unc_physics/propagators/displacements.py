"""Limits of the distance between samples and rollouts, and scaling of their spread."""

import math

import numpy as np

from ..compiler import kernel

_NEIGHBOUR = 3  # outcome, the third nearest, that a displacement may reach


@kernel
def reach(y, first, width):
    """Return the distance (N,) of each outcome to its third nearest other.

    ``y`` (N, K) are outcomes, of which ``width`` columns from ``first`` on count.
    """
    n = len(y)
    out = np.empty(n)
    for i in range(n):
        least = np.full(_NEIGHBOUR, np.inf)
        for j in range(n):
            if j == i:
                continue
            total = 0.0
            for c in range(first, first + width):
                total += (y[i, c] - y[j, c]) ** 2
            for k in range(_NEIGHBOUR):
                if total < least[k]:
                    total, least[k] = least[k], total
        out[i] = math.sqrt(least[min(_NEIGHBOUR, n - 1) - 1]) if n > 1 else np.inf
    return out


@kernel
def clip(d, first, width, also, limit):
    """Shorten columns of displacements ``d`` (S, K) in place to at most ``limit`` (S,).

    The length is that of ``width`` columns from ``first`` on. As many columns from ``also`` on are scaled by
    the same factor.
    """
    for s in range(len(d)):
        total = 0.0
        for c in range(first, first + width):
            total += d[s, c] ** 2
        if total > limit[s] ** 2:
            f = limit[s] / math.sqrt(total)
            for c in range(width):
                d[s, first + c] *= f
                d[s, also + c] *= f


@kernel
def _means(values):
    """Return the means (K,) of the columns of values (S, K)."""
    out = np.zeros(values.shape[1])
    for s in range(len(values)):
        row = values[s]
        for c in range(len(out)):
            out[c] += row[c]
    return out / max(len(values), 1)


@kernel
def variances(values):
    """Return the variances (K,) of the columns of values (S, K)."""
    middle, out = _means(values), np.zeros(values.shape[1])
    for s in range(len(values)):
        row = values[s]
        for c in range(len(out)):
            out[c] += (row[c] - middle[c]) ** 2
    return out / max(len(values), 1)


@kernel
def spread(values, factors):
    """Scale each column of values (S, K) about its mean, in place, by ``factors`` (K,)."""
    middle = _means(values)
    for s in range(len(values)):
        row = values[s]
        for c in range(len(middle)):
            row[c] = middle[c] + factors[c] * (row[c] - middle[c])
