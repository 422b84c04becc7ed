"""Conversion between distributions and sets of states: boxplus, covariance factors, means and covariances."""

import math

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import empty, zeros
from .layout import EP, ER, ERR_POSITION, ERR_ROTATION, ERROR, EV, EW, STATE, P, Q, V, W
from .rotation import conjugate, exp, log, multiply, normalized

_KARCHER_TOLERANCE = 1e-12  # rad
_KARCHER_ITERATIONS = 50
_POWER_ITERATIONS = 10
_WIDE = math.cos(math.pi / 4.0)  # for quaternions of rotations that differ by a right angle


@kernel
def boxplus(x, d, out):
    """Perturb a state ``x`` (13,) by a body-frame error ``d`` (12,); write the result into ``out``."""
    for k in range(3):
        out[P + k] = x[P + k] + d[EP + k]
        out[V + k] = x[V + k] + d[EV + k]
        out[W + k] = x[W + k] + d[EW + k]
    q = normalized(multiply((x[Q], x[Q + 1], x[Q + 2], x[Q + 3]), exp(d[ER], d[ER + 1], d[ER + 2])))
    out[Q], out[Q + 1], out[Q + 2], out[Q + 3] = q


@kernel
def boxminus(y, x, out):
    """Write the error ``d`` (12,) with ``y = x boxplus d`` into ``out``."""
    for k in range(3):
        out[EP + k] = y[P + k] - x[P + k]
        out[EV + k] = y[V + k] - x[V + k]
        out[EW + k] = y[W + k] - x[W + k]
    relative = multiply(conjugate((x[Q], x[Q + 1], x[Q + 2], x[Q + 3])), (y[Q], y[Q + 1], y[Q + 2], y[Q + 3]))
    out[ER], out[ER + 1], out[ER + 2] = log(relative)


@kernel
def spread_states(mean, moving, errors):
    """Return the states ``mean boxplus errors[n]``.

    Parameters
    ----------
    mean : (B, 13) array
    moving : (M,) int64
        Indices of the moving bodies; other bodies keep their state.
    errors : (N, 12 M) array

    Returns
    -------
    (N, B, 13) array
    """
    states = empty((len(errors), len(mean), STATE))
    for n in range(len(errors)):
        for i in range(len(mean)):
            for c in range(STATE):
                states[n, i, c] = mean[i, c]
        for k in range(len(moving)):
            boxplus(mean[moving[k]], errors[n, ERROR * k : ERROR * (k + 1)], states[n, moving[k]])
    return states


@kernel
def _karcher_mean(states, body):
    """Return the Karcher mean of one body's rotations, the fixed point of averaging in the tangent space.

    Wide distributions have several fixed points; the search then starts at the chordal mean. Otherwise it
    starts at the first sample, so that equal samples have exactly zero spread.
    """
    s = states[0, body]
    mean = (s[Q], s[Q + 1], s[Q + 2], s[Q + 3])
    for n in range(len(states)):
        s = states[n, body]
        if abs(s[Q] * mean[0] + s[Q + 1] * mean[1] + s[Q + 2] * mean[2] + s[Q + 3] * mean[3]) < _WIDE:
            mean = _chordal_mean(states, body)
            break
    for _ in range(_KARCHER_ITERATIONS):
        back = conjugate(mean)
        x = y = z = 0.0
        for n in range(len(states)):
            s = states[n, body]
            dx, dy, dz = log(multiply(back, (s[Q], s[Q + 1], s[Q + 2], s[Q + 3])))
            x += dx
            y += dy
            z += dz
        x, y, z = x / len(states), y / len(states), z / len(states)
        mean = normalized(multiply(mean, exp(x, y, z)))
        if x * x + y * y + z * z < _KARCHER_TOLERANCE**2:
            break
    return mean


@kernel
def _chordal_mean(states, body):
    """Return approximately the chordal mean: the leading eigenvector of the quaternions' outer products."""
    A = zeros((4, 4))
    for n in range(len(states)):
        q = states[n, body]
        for r in range(4):
            for c in range(4):
                A[r, c] += q[Q + r] * q[Q + c]
    largest = 0
    for c in range(4):
        if A[c, c] > A[largest, largest]:
            largest = c
    q = (A[0, largest], A[1, largest], A[2, largest], A[3, largest])
    for _ in range(_POWER_ITERATIONS):
        q = normalized(
            (
                A[0, 0] * q[0] + A[0, 1] * q[1] + A[0, 2] * q[2] + A[0, 3] * q[3],
                A[1, 0] * q[0] + A[1, 1] * q[1] + A[1, 2] * q[2] + A[1, 3] * q[3],
                A[2, 0] * q[0] + A[2, 1] * q[1] + A[2, 2] * q[2] + A[2, 3] * q[3],
                A[3, 0] * q[0] + A[3, 1] * q[1] + A[3, 2] * q[2] + A[3, 3] * q[3],
            )
        )
    return q


@kernel
def mean_and_errors(states, moving):
    """Return the mean state of a batch and each sample's error from it, with equal weights.

    Returns
    -------
    mean : (B, 13) array
        Arithmetic means, and Karcher means of rotations; other bodies have the state of the first sample.
    errors : (N, 12 M) array
    """
    mean = states[0].copy()
    errors = empty((len(states), ERROR * len(moving)))
    for k in range(len(moving)):
        body = moving[k]
        m = mean[body]
        for c in range(STATE):
            total = 0.0
            for n in range(len(states)):
                total += states[n, body, c]
            m[c] = total / len(states)
        m[Q], m[Q + 1], m[Q + 2], m[Q + 3] = _karcher_mean(states, body)
        for n in range(len(states)):
            boxminus(states[n, body], m, errors[n, ERROR * k : ERROR * (k + 1)])
    return mean, errors


@kernel
def second_moment(errors):
    """Return ``errors.T @ errors / N``, summed in an order that does not depend on threads."""
    size = errors.shape[1]
    out = zeros((size, size))
    for n in range(len(errors)):
        for a in range(size):
            e = errors[n, a]
            if e != 0.0:
                for b in range(a + 1):
                    out[a, b] += e * errors[n, b]
    for a in range(size):
        for b in range(a + 1):
            out[a, b] /= len(errors)
            out[b, a] = out[a, b]
    return out


def pose_spreads(blocks: np.ndarray) -> np.ndarray:
    """(M, 2): standard deviations of position [m] and rotation [rad], over all axes together, of covariances
    (M, 12, 12).
    """
    variances = np.einsum("mii->mi", blocks)
    return np.sqrt(
        np.maximum([variances[:, block].sum(axis=1) for block in (ERR_POSITION, ERR_ROTATION)], 0.0)
    ).T


def symmetric_root(P: np.ndarray) -> np.ndarray:
    """Return symmetric square roots of covariances (..., n, n) (Eq. 12); negative round-off becomes zero."""
    if np.count_nonzero(P) == np.count_nonzero(
        np.diagonal(P, axis1=-2, axis2=-1)
    ):  # diagonal: no eigenvectors needed
        return np.sqrt(np.maximum(P, 0.0))
    values, vectors = np.linalg.eigh(P)
    return (vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def pivoted_cholesky(A: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the factor (n, r) of one matrix (n, n), and the rest (n, n), as `pivoted_cholesky_of_blocks`."""
    L, _, rest = pivoted_cholesky_of_blocks(A[None], tolerance)
    return L[0], rest[0]


@kernel
def pivoted_cholesky_of_blocks(blocks, tolerance):
    """Factor a positive semidefinite, block-diagonal matrix by outer-product Cholesky with diagonal pivoting.

    Each iteration takes the largest remaining diagonal entry of all blocks; ties go to the lowest index. It
    stops when that is at most ``tolerance`` times the largest diagonal entry of ``blocks`` (M, n, n).

    Returns
    -------
    L : (M, n, r) array
        For each block A, ``L @ L.T`` equals it except for ``rest``; r is the largest rank of a block.
    number : (M, r) int64 array
        In which iteration each column was found; -1 for columns of zeros.
    rest : (M, n, n) array
        ``A - L @ L.T``.
    """
    M, n, _ = blocks.shape
    rest = blocks.copy()
    L, number, rank = zeros((M, n, n)), np.full((M, n), -1), np.zeros(M, np.int64)
    largest = 0.0
    for m in range(M):
        for i in range(n):
            largest = max(largest, blocks[m, i, i])
    for iteration in range(M * n):
        m, pivot = 0, 0
        for b in range(M):
            for i in range(n):
                if rest[b, i, i] > rest[m, pivot, pivot]:
                    m, pivot = b, i
        if not rest[m, pivot, pivot] > tolerance * largest:
            break
        own, r = rest[m], rank[m]
        root, column = math.sqrt(own[pivot, pivot]), empty(n)
        number[m, r], rank[m] = iteration, r + 1
        for i in range(n):
            column[i] = own[i, pivot] / root
        for i in range(n):
            L[m, i, r] = l_i = column[i]
            if l_i != 0.0:
                row = own[i]
                for j in range(n):
                    row[j] -= l_i * column[j]
        for i in range(n):  # the pivot's row and column become exactly zero
            own[i, pivot] = own[pivot, i] = 0.0
    most = rank.max()
    return L[:, :, :most].copy(), number[:, :most].copy(), rest
