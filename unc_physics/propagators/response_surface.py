"""A smooth map through the outcomes of a few rollouts: a Gaussian process, chosen by leaving one out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..physics.compiled import kernel

_LENGTHS = np.array([0.7, 1.5, 3.0, 6.0])  # in units of the metric
_NUGGETS = np.array([1e-6, 0.01, 0.1, 0.4, 1.5])
_CHOSEN_BY = 64  # rollouts, the first ones, that length and nugget are chosen by
_MOST = 256  # that the surface goes through
_STEP = 1e-3  # of differences that slopes are found by
_LEAST_SLOPE = 0.2
_FLAT = 1e-20  # sum of squared differences that round-off makes
_NEIGHBOUR = 3  # outcome, the third nearest, that a displacement may reach


class Surface(NamedTuple):
    """``m(x) = trend(x) + sum_n k(|x - x_n|) weight_n``.

    Attributes
    ----------
    points : (N, d) array
    weights : (N, K) array
    trend : (1 or 1 + d, K) array
        Constant, or linear.
    length : float
        Of the kernel, a squared exponential.
    error : float
        Mean square of what each rollout differs from a surface through the others, over the variance.
    left_out : (N, K) array
        Those differences.
    """

    points: np.ndarray
    weights: np.ndarray
    trend: np.ndarray
    length: float
    error: float
    left_out: np.ndarray


def fit(x: np.ndarray, y: np.ndarray) -> Surface:
    """The surface through outcomes ``y`` (N, K) at ``x`` (N, d).

    Notes
    -----
    Length and nugget, one each for all outputs, are those with the least mean square error of leaving one
    rollout out, which has a closed form (Rasmussen and Williams 2006, 5.4.2). The trend, whose coefficients
    are estimated along, is linear from 3 (d + 1) rollouts on.
    """
    x, y = np.ascontiguousarray(x[:_MOST]), np.ascontiguousarray(y[:_MOST])
    count, size = x.shape
    widest = np.linalg.norm(x.std(axis=0)) if count else 1.0
    lengths = _LENGTHS * max(1.0, widest / math.sqrt(3.0))
    linear = count >= 3 * (size + 1)
    chosen = _choose(x[:_CHOSEN_BY], y[:_CHOSEN_BY], linear, lengths, _NUGGETS)
    length, nugget = lengths[chosen // len(_NUGGETS)], _NUGGETS[chosen % len(_NUGGETS)]
    weights, trend, left_out = _solve(x, y, linear, length, nugget)
    spread = ((y - y.mean(axis=0)) ** 2).sum() * (count / max(count - 1, 1)) ** 2
    error = float((left_out**2).sum() / spread) if spread > 0.0 else 0.0
    return Surface(x, weights, trend, float(length), error, left_out)


def active_directions(surface: Surface, x: np.ndarray) -> np.ndarray:
    """(d, d): the map to coordinates in which the surface changes more alike in all directions.

    Its slopes at points ``x`` (N, d) have a second moment (d, d), whose eigenvectors become the axes (active
    subspaces, Constantine 2015). Each is scaled by the root of the slope along it, over the largest, as few
    rollouts do not tell slopes well; none by less than a fifth.
    """
    if x.shape[1] == 0:
        return np.eye(0)
    form = surface.points, surface.weights, surface.trend, surface.length
    slopes = np.array([predicted(*form, x + h) - predicted(*form, x - h) for h in _STEP * np.eye(x.shape[1])])
    values, vectors = np.linalg.eigh(np.einsum("ink,jnk->ij", slopes, slopes))
    if not values[-1] > _FLAT:
        return np.eye(x.shape[1])
    slopes = np.sqrt(np.maximum(values[::-1] / values[-1], 0.0))
    return vectors[:, ::-1] * np.maximum(np.sqrt(slopes), _LEAST_SLOPE)


@kernel
def _inverse(A):
    """Inverse of a positive definite matrix, in place (Gauss and Jordan)."""
    n = len(A)
    for k in range(n):
        p = 1.0 / A[k, k]
        A[k, k] = 1.0
        for j in range(n):
            A[k, j] *= p
        for i in range(n):
            if i != k:
                f = A[i, k]
                A[i, k] = 0.0
                for j in range(n):
                    A[i, j] -= f * A[k, j]


@kernel
def _squares(x):
    """(N, N): squared distances of points (N, d)."""
    n, d = x.shape
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(i):
            total = 0.0
            for c in range(d):
                total += (x[i, c] - x[j, c]) ** 2
            out[i, j] = out[j, i] = total
    return out


@kernel
def _projected(K, H):
    """Invert ``K`` (N, N) in place; returns it without what the trend's regressors ``H`` (N, p) explain.

    That is ``P = K^-1 - K^-1 H (H^T K^-1 H)^-1 H^T K^-1``; also the map (p, N) to the trend's coefficients.
    """
    n, p = H.shape
    _inverse(K)
    KH = np.zeros((n, p))
    for i in range(n):
        for j in range(n):
            for c in range(p):
                KH[i, c] += K[i, j] * H[j, c]
    A = np.zeros((p, p))
    for i in range(n):
        for a in range(p):
            for b in range(p):
                A[a, b] += H[i, a] * KH[i, b]
    for a in range(p):
        A[a, a] *= 1.0 + 1e-12
    _inverse(A)
    to_trend = np.zeros((p, n))
    for a in range(p):
        for b in range(p):
            for i in range(n):
                to_trend[a, i] += A[a, b] * KH[i, b]
    P = K.copy()
    for i in range(n):
        for a in range(p):
            f = KH[i, a]
            for j in range(n):
                P[i, j] -= f * to_trend[a, j]
    return P, to_trend


@kernel
def _product(A, B):
    """``A @ B``, in an order of summation that no thread count changes."""
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            f = A[i, k]
            for j in range(B.shape[1]):
                out[i, j] += f * B[k, j]
    return out


@kernel
def _regressors(x, linear):
    """(N, 1) ones, or (N, 1 + d) with the points."""
    n, d = x.shape
    H = np.ones((n, 1 + d if linear else 1))
    if linear:
        for i in range(n):
            for c in range(d):
                H[i, 1 + c] = x[i, c]
    return H


@kernel
def _choose(x, y, linear, lengths, nuggets):
    """Which pair of length and nugget, in their product's order, leaves the least squared errors."""
    squares, H = _squares(x), _regressors(x, linear)
    n = len(x)
    best, least = 0, np.inf
    K = np.empty((n, n))
    for a in range(len(lengths)):
        for b in range(len(nuggets)):
            for i in range(n):
                for j in range(n):
                    K[i, j] = math.exp(-0.5 * squares[i, j] / lengths[a] ** 2)
                K[i, i] += nuggets[b]
            P, _ = _projected(K, H)
            E = _product(P, y)
            which, total = a * len(nuggets) + b, 0.0
            for i in range(n):
                row = 0.0
                for c in range(y.shape[1]):
                    row += E[i, c] ** 2
                total += row / P[i, i] ** 2
            if total < least:
                best, least = which, total
    return best


@kernel
def _solve(x, y, linear, length, nugget):
    """Weights (N, K), trend and left-out errors (N, K) of one length and nugget."""
    K = _squares(x)
    for i in range(len(x)):
        for j in range(len(x)):
            K[i, j] = math.exp(-0.5 * K[i, j] / length**2)
        K[i, i] += nugget
    P, to_trend = _projected(K, _regressors(x, linear))
    weights, trend = _product(P, y), _product(to_trend, y)
    left_out = weights.copy()
    for i in range(len(x)):
        for c in range(y.shape[1]):
            left_out[i, c] /= P[i, i]
    return weights, trend, left_out


@kernel
def predicted(surface_points, weights, trend, length, x):
    """(S, K): the surface at points ``x`` (S, d)."""
    n, d = surface_points.shape
    out = np.zeros((len(x), weights.shape[1]))
    for s in range(len(x)):
        row = out[s]
        for c in range(len(row)):
            row[c] = trend[0, c]
        for a in range(1, len(trend)):
            f = x[s, a - 1]
            for c in range(len(row)):
                row[c] += f * trend[a, c]
        for i in range(n):
            total = 0.0
            for a in range(d):
                total += (x[s, a] - surface_points[i, a]) ** 2
            f = math.exp(-0.5 * total / length**2)
            for c in range(len(row)):
                row[c] += f * weights[i, c]
    return out


@kernel
def nearest(points, x, besides):
    """(S,): the nearest of the points (N, d) to each of ``x`` (S, d); ``besides`` leaves out its own."""
    found = np.zeros(len(x), np.int64)
    for s in range(len(x)):
        least = np.inf
        for i in range(len(points)):
            if besides and i == s:
                continue
            total = 0.0
            for a in range(points.shape[1]):
                total += (x[s, a] - points[i, a]) ** 2
            if total < least:
                least, found[s] = total, i
    return found


@kernel
def reach(y, first, width):
    """(N,): distance of each outcome to its third nearest other, by ``width`` columns of ``y`` (N, K) from
    ``first`` on.
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
    """Shorten columns of displacements ``d`` (S, K) in place, so that ``width`` from ``first`` on are no
    longer than ``limit`` (S,); as many from ``also`` on share the factor.
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
