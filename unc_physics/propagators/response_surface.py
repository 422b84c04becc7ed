"""A smooth map through the outcomes of a few rollouts: a Gaussian process, chosen by leaving one out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiler import kernel

_LENGTHS = np.array([0.7, 1.5, 3.0, 6.0])  # in units of the metric
_NUGGETS = np.array([1e-6, 0.01, 0.1, 0.4, 1.5])
_FIRST = 1, 2  # length and nugget that are tried first
_CHOSEN_BY = 64  # rollouts, the first ones, that length and nugget are chosen by
_MOST = 256  # that the surface goes through
_LEAST_SLOPE = 0.2
_FLAT = 1e-20  # sum of squared differences that round-off makes


class ResponseSurface(NamedTuple):
    """``m(x) = trend(x) + sum_n k(|x - x_n|) weight_n``."""

    points: np.ndarray  # (N, d)
    weights: np.ndarray  # (N, K)
    trend: np.ndarray  # (1 or 1 + d, K): constant, or linear
    length: float  # of the kernel, a squared exponential
    #: mean square of what each rollout differs from a surface through the others, over the variance
    error: float
    left_out: np.ndarray  # (N, K): those differences
    pair: tuple[int, int]  # which length and which nugget, of those that are tried
    kriging: np.ndarray  # (N, N): from outcomes to weights
    coefficients: np.ndarray  # (1 or 1 + d, N): from outcomes to the trend


def fit(x: np.ndarray, y: np.ndarray, like: ResponseSurface | None = None) -> ResponseSurface:
    """Return the surface through outcomes ``y`` (N, K) at ``x`` (N, d).

    All outputs share one length and one nugget. They minimize the mean square error of leaving one rollout
    out, which has a closed form (Rasmussen and Williams 2006, 5.4.2). The search begins at the length and
    nugget of ``like``, a surface through the same outcomes in other coordinates, and ends at a local minimum.
    The trend is linear from 3 (d + 1) rollouts on, and its coefficients are estimated as well.
    """
    x, y = np.ascontiguousarray(x[:_MOST]), np.ascontiguousarray(y[:_MOST])
    count, size = x.shape
    widest = np.linalg.norm(x.std(axis=0)) if count else 1.0
    lengths = _LENGTHS * max(1.0, widest / math.sqrt(3.0))
    linear = count >= 3 * (size + 1)
    first = _FIRST if like is None else like.pair
    pair = _choose(x[:_CHOSEN_BY], y[:_CHOSEN_BY], linear, lengths, _NUGGETS, *first)
    length = lengths[pair[0]]
    kriging, coefficients = _inverse(x, linear, length, _NUGGETS[pair[1]])
    weights, trend, left_out = solve(kriging, coefficients, y)
    spread = ((y - y.mean(axis=0)) ** 2).sum() * (count / max(count - 1, 1)) ** 2
    error = float((left_out**2).sum() / spread) if spread > 0.0 else 0.0
    return ResponseSurface(x, weights, trend, float(length), error, left_out, pair, kriging, coefficients)


def smoother(surface: ResponseSurface, columns: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear map (S, n) from outcomes to the surface at points ``at`` (S, d).

    The nearest rollouts (S,) are returned with it. ``map @ y`` is the surface through any outcomes ``y`` (n,
    K) with the same length and nugget. ``columns`` (d, N) are the points of all rollouts, of which the
    surface goes through the first n.
    """
    return predicted(surface.kriging, surface.coefficients, surface.length, columns, at)


def active_directions(surface: ResponseSurface) -> np.ndarray:
    """Return the map (d, d) to coordinates in which the surface changes more alike in all directions.

    The second moment (d, d) of its slopes at its first points has eigenvectors that become the axes (active
    subspaces, Constantine 2015). Each is scaled by the root of the ratio of the slope along it to the largest
    slope, since few rollouts do not determine slopes well. No scale is below a fifth.
    """
    size = surface.points.shape[1]
    if size == 0:
        return np.eye(0)
    values, vectors = np.linalg.eigh(_slopes(surface.points, surface.weights, surface.trend, surface.length))
    if not values[-1] > _FLAT:
        return np.eye(size)
    slopes = np.sqrt(np.maximum(values[::-1] / values[-1], 0.0))
    return vectors[:, ::-1] * np.maximum(np.sqrt(slopes), _LEAST_SLOPE)


@kernel
def _invert(A, row):
    """Invert a matrix (N, N) with leading minors other than 0 in place, by Gauss and Jordan.

    ``row`` (N,) is work space. It shows LLVM that what is subtracted does not overlap the matrix.
    """
    n = len(A)
    for k in range(n):
        pivot = A[k]
        p = 1.0 / pivot[k]
        pivot[k] = 1.0
        for j in range(n):
            row[j] = pivot[j] * p
        for i in range(n):
            own = A[i]
            f = own[k]
            own[k] = 0.0
            for j in range(n):
                own[j] -= f * row[j]
        for j in range(n):
            pivot[j] = row[j]


@kernel
def _squares(x):
    """Return squared distances (N, N) of points (N, d)."""
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
def _decayed(values, factor):
    """Replace values (N,), not negative, by ``exp(-factor values)``, to 1e-13; results are at least 2e-22.

    The exponential of a 64th of the argument is a polynomial, squared six times. LLVM vectorizes this.
    """
    for i in range(len(values)):
        t = min(factor * values[i], 50.0) * (1.0 / 64.0)
        p = 1.0 - t * (1.0 / 13.0)
        p = 1.0 - t * (1.0 / 12.0) * p
        p = 1.0 - t * (1.0 / 11.0) * p
        p = 1.0 - t * (1.0 / 10.0) * p
        p = 1.0 - t * (1.0 / 9.0) * p
        p = 1.0 - t * (1.0 / 8.0) * p
        p = 1.0 - t * (1.0 / 7.0) * p
        p = 1.0 - t * (1.0 / 6.0) * p
        p = 1.0 - t * (1.0 / 5.0) * p
        p = 1.0 - t * (1.0 / 4.0) * p
        p = 1.0 - t * (1.0 / 3.0) * p
        p = 1.0 - t * (1.0 / 2.0) * p
        p = 1.0 - t * p
        p *= p
        p *= p
        p *= p
        p *= p
        p *= p
        values[i] = p * p


@kernel
def _saddle(near, nugget, x, linear, A):
    """Fill ``A`` (N + p, N + p) with what its inverse is to be taken of: ``[[K + nugget 1, H], [H^T, 0]]``.

    Of kernels ``near`` (N, N) and the trend's regressors H (N, p), which are ones, and the points (N, d) if
    it is ``linear``. The inverse is ``[[P, C^T], [C, ...]]``: P = K^-1 without what the trend explains, and
    C (p, N) is the map to the trend's coefficients.
    """
    n, p = len(near), len(A) - len(near)
    for i in range(n):
        for j in range(n):
            A[i, j] = near[i, j]
        A[i, i] += nugget
    for a in range(p):
        total = 0.0
        for i in range(n):
            h = x[i, a - 1] if a > 0 else 1.0
            A[i, n + a] = A[n + a, i] = h
            total += h * h
        for b in range(p):
            A[n + a, n + b] = 0.0
        A[n + a, n + a] = -1e-12 * total  # where regressors depend on each other


@kernel
def _add_rows(out, factors, rows, count):
    """Add the first ``count`` rows (N, K), times ``factors`` (N,), to ``out`` (K,): four at once, and in an
    order of summation that no thread count changes.
    """
    whole = count - count % 4
    for i in range(0, whole, 4):
        f0, f1, f2, f3 = factors[i], factors[i + 1], factors[i + 2], factors[i + 3]
        r0, r1, r2, r3 = rows[i], rows[i + 1], rows[i + 2], rows[i + 3]
        for c in range(len(out)):
            out[c] += f0 * r0[c] + f1 * r1[c] + f2 * r2[c] + f3 * r3[c]
    for i in range(whole, count):
        f, row = factors[i], rows[i]
        for c in range(len(out)):
            out[c] += f * row[c]


@kernel
def _product(A, first, count, y):
    """Return ``count`` rows of ``A``, from the ``first`` on, times ``y`` (N, K): (count, K)."""
    out = np.zeros((count, y.shape[1]))
    for i in range(count):
        _add_rows(out[i], A[first + i], y, len(y))
    return out


@kernel
def _left_out_error(A, y, most, work):
    """Sum of squared errors of leaving out each rollout; or, as soon as that is more than ``most``, this."""
    total = 0.0
    for i in range(len(y)):
        for c in range(len(work)):
            work[c] = 0.0
        _add_rows(work, A[i], y, len(y))
        own = 0.0
        for c in range(len(work)):
            own += work[c] ** 2
        total += own / A[i, i] ** 2
        if total > most:
            break
    return total


@kernel
def _choose(x, y, linear, lengths, nuggets, a, b):
    """Return the indices of the length and the nugget with the least squared error.

    The search begins at indices a and b. It moves to the best neighbour while that is better.
    """
    squares = _squares(x)
    n, size = len(x), len(x) + (1 + x.shape[1] if linear else 1)
    near = np.empty((len(lengths), n, n))
    begun = np.zeros(len(lengths), np.bool_)
    known = np.zeros((len(lengths), len(nuggets)), np.bool_)
    A, row, work = np.empty((size, size)), np.empty(size), np.empty(y.shape[1])
    least, moved = np.inf, True
    while moved:
        moved = False
        middle_a, middle_b = a, b
        for step in range(5):
            i = middle_a + (1 if step == 1 else -1 if step == 2 else 0)
            j = middle_b + (1 if step == 3 else -1 if step == 4 else 0)
            if i < 0 or j < 0 or i >= len(lengths) or j >= len(nuggets) or known[i, j]:
                continue
            if not begun[i]:
                begun[i] = True
                near[i] = squares
                _decayed(near[i].reshape(n * n), 0.5 / lengths[i] ** 2)
            known[i, j] = True
            _saddle(near[i], nuggets[j], x, linear, A)
            _invert(A, row)
            total = _left_out_error(A, y, least, work)
            if total < least:
                least, a, b, moved = total, i, j, True
    return a, b


@kernel
def _inverse(x, linear, length, nugget):
    """Return maps from outcomes to weights (N, N) and to the trend (p, N), of one length and nugget."""
    n, p = len(x), 1 + x.shape[1] if linear else 1
    near = _squares(x)
    _decayed(near.reshape(n * n), 0.5 / length**2)
    A = np.empty((n + p, n + p))
    _saddle(near, nugget, x, linear, A)
    _invert(A, np.empty(n + p))
    return A[:n, :n].copy(), A[n:, :n].copy()


@kernel
def solve(kriging, coefficients, y):
    """Return weights (N, K), trend (p, K) and left-out errors (N, K) of outcomes ``y`` (N, K)."""
    n, p = len(kriging), len(coefficients)
    weights, trend = _product(kriging, 0, n, y), _product(coefficients, 0, p, y)
    left_out = weights.copy()
    for i in range(n):
        for c in range(y.shape[1]):
            left_out[i, c] /= kriging[i, i]
    return weights, trend, left_out


@kernel
def surface_moments(y, kriging, mean_row, root, widest):
    """Return moments of the outcomes ``y`` (N, K) about 0, by the surface through the first n of them.

    Parameters
    ----------
    y : (N, K) array
    kriging : (n, n) array
    mean_row : (N,) array
        ``mean_row @ y`` is the mean.
    root : (r, n) array
        ``root @ y`` has the covariance of the surface as its sum of squares.
    widest : float
        Largest factor on a column.

    Returns
    -------
    mean : (K,) array
    P : (K, K) array
        Covariance of the surface, plus that of the left-out errors. Each column is scaled to the variance
        with the surface as a control variate: the variance of the outcomes, plus that of the surface, less
        that of the surface at the rollouts, each from the surface without this rollout.
    left_out : (n, K) array
    factors : (K,) array
        Factors on the columns.
    """
    n, size = len(kriging), y.shape[1]
    left_out = _product(kriging, 0, n, y[:n])
    for i in range(n):
        for c in range(size):
            left_out[i, c] /= kriging[i, i]
    mean = np.zeros(size)
    _add_rows(mean, mean_row, y, len(y))
    through = _product(root, 0, len(root), y[:n])
    P = np.zeros((size, size))
    for rows, weight in ((through, 1.0), (left_out, 1.0 / n)):
        for i in range(len(rows)):
            for a in range(size):
                own = weight * rows[i, a]
                for b in range(size):
                    P[a, b] += own * rows[i, b]
    factors = np.ones(size)
    for c in range(size):
        y_mean = y_square = s_mean = s_square = rest = 0.0
        for i in range(n):
            at = y[i, c] - left_out[i, c]
            y_mean += y[i, c] / n
            s_mean += at / n
            y_square += y[i, c] ** 2 / n
            s_square += at**2 / n
            rest += left_out[i, c] ** 2 / n
        more = (y_square - y_mean**2) - (s_square - s_mean**2)
        wanted = P[c, c] - rest + more * n / max(n - 1, 1)
        if P[c, c] > 0.0:
            factors[c] = min(max(math.sqrt(max(wanted, 0.0) / P[c, c]), 1.0 / widest), widest)
    for a in range(size):
        for b in range(a + 1):
            P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a]) * factors[a] * factors[b]
    return mean, P, left_out, factors


@kernel
def _slopes(points, weights, trend, length):
    """Return the second moment (d, d) of a surface's slopes at its first points, summed over outputs."""
    n, d = points.shape
    out = np.zeros((d, d))
    slope, near, factors = np.empty((d, weights.shape[1])), np.empty(n), np.empty(n)
    for s in range(min(n, _CHOSEN_BY)):
        for i in range(n):
            near[i] = 0.0
            for a in range(d):
                near[i] += (points[i, a] - points[s, a]) ** 2
        _decayed(near, 0.5 / length**2)
        for a in range(d):
            own = slope[a]
            for c in range(len(own)):
                own[c] = trend[1 + a, c] if len(trend) > 1 else 0.0
            for i in range(n):
                factors[i] = near[i] * (points[i, a] - points[s, a]) / length**2
            _add_rows(own, factors, weights, n)
        for a in range(d):
            for b in range(a + 1):
                total = 0.0
                for c in range(weights.shape[1]):
                    total += slope[a, c] * slope[b, c]
                out[a, b] += total
    for a in range(d):
        for b in range(a):
            out[b, a] = out[a, b]
    return out


@kernel
def predicted(weights, trend, length, columns, x):
    """Return the surface at points ``x`` (S, d), (S, K), and the nearest of all N rollouts to each, (S,).

    ``columns`` (d, N) are the rollouts' points, of which the surface goes through the first.
    """
    d, n = columns.shape
    count = len(weights)
    out = np.empty((len(x), weights.shape[1]))
    near = np.zeros(len(x), np.int64)
    square = np.empty(n)
    for s in range(len(x)):
        for i in range(n):
            square[i] = 0.0
        for a in range(d):
            place, column = x[s, a], columns[a]
            for i in range(n):
                square[i] += (place - column[i]) ** 2
        least = np.inf
        for i in range(n):
            if square[i] < least:
                least, near[s] = square[i], i
        _decayed(square[:count], 0.5 / length**2)
        own = out[s]
        for c in range(len(own)):
            own[c] = trend[0, c]
        for a in range(1, len(trend)):
            f, slope = x[s, a - 1], trend[a]
            for c in range(len(own)):
                own[c] += f * slope[c]
        _add_rows(own, square, weights, count)
    return out, near
