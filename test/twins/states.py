"""Twins of what happens between distributions and sets of states; rotations by SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

P, V, Q, W = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
DP, DV, DTHETA, DOMEGA = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


def boxplus(x, d):
    """States (..., 13) perturbed by errors (..., 12): the rotation on the body side, R Exp(dtheta)."""
    x, d = np.broadcast_arrays(x, np.concatenate([d, np.zeros_like(d[..., :1])], axis=-1))
    out = x.copy()
    out[..., P] += d[..., DP]
    out[..., V] += d[..., DV]
    out[..., W] += d[..., DOMEGA]
    turned = Rotation.from_quat(x[..., Q].reshape(-1, 4)) * Rotation.from_rotvec(
        d[..., DTHETA].reshape(-1, 3)
    )
    out[..., Q] = turned.as_quat().reshape(x[..., Q].shape)
    return out


def boxminus(y, x):
    """Errors d (..., 12) with y = x boxplus d."""
    y, x = np.broadcast_arrays(y, x)
    d = np.empty((*y.shape[:-1], 12))
    d[..., DP] = y[..., P] - x[..., P]
    d[..., DV] = y[..., V] - x[..., V]
    d[..., DOMEGA] = y[..., W] - x[..., W]
    turned = Rotation.from_quat(x[..., Q].reshape(-1, 4)).inv() * Rotation.from_quat(y[..., Q].reshape(-1, 4))
    d[..., DTHETA] = turned.as_rotvec().reshape(d[..., DTHETA].shape)
    return d


def karcher_mean(rotations):
    """Mean of N rotations: Newton-like iteration from the first one, undamped."""
    mean = rotations[0]
    for _ in range(50):
        delta = (mean.inv() * rotations).as_rotvec().mean(axis=0)
        mean = mean * Rotation.from_rotvec(delta)
        if np.linalg.norm(delta) < 1e-12:
            break
    return mean


def moments(states, moving):
    """Mean (B, 13) and joint covariance of the moving bodies, of a batch (N, B, 13) with weights 1/N."""
    mean = states.mean(axis=0)
    for b in range(states.shape[1]):
        mean[b, Q] = karcher_mean(Rotation.from_quat(states[:, b, Q])).as_quat()
    errors = boxminus(states, mean)[:, list(moving)].reshape(len(states), -1)
    return mean, errors.T @ errors / len(states)


def symmetric_root(A):
    """S with S = S^T and S S = A."""
    values, vectors = np.linalg.eigh(A)
    return vectors @ np.diag(np.sqrt(np.maximum(values, 0.0))) @ vectors.T


def pivoted_cholesky(A, tolerance=1e-14):
    """(n, r) factor L of a semidefinite matrix, L L^T = A; pivot: the largest remaining diagonal entry."""
    rest, columns = A.copy(), []
    while len(columns) < len(A):
        pivot = np.argmax(np.diag(rest))
        if rest[pivot, pivot] <= tolerance * np.diag(A).max():
            break
        column = rest[:, pivot] / np.sqrt(rest[pivot, pivot])
        rest = rest - np.outer(column, column)
        columns.append(column)
    return np.array(columns).reshape(-1, len(A)).T


def sigma_points(mean, covariance, moving, points):
    """(2 n + 1, B, 13): the mean, mean boxplus a_k, mean boxplus -a_k; all of one weight (Eqs. 25 to 29)."""
    root = symmetric_root(covariance) if points == "full" else pivoted_cholesky(covariance)
    n = root.shape[1]
    a = np.sqrt(n + 0.5) * root.T  # lambda = 1/2
    errors = np.concatenate([np.zeros((1, len(covariance))), a, -a]).reshape(2 * n + 1, len(moving), 12)
    states = np.repeat(mean[None], 2 * n + 1, axis=0)
    states[:, list(moving)] = boxplus(states[:, list(moving)], errors)
    return states
