"""Quadratic models of rough functions, by ridge regression on all their known values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_RIDGE = 1e-4, 1e-3, 1e-2  # of slopes, of curvatures, of mixed curvatures
_SWEEPS = 60  # of the descent within a box


class Quadratic(NamedTuple):
    """Of m functions of n variables, about a point.

    Attributes
    ----------
    slope : (m, n) array
    hessian : (m, n, n) array
    """

    slope: np.ndarray
    hessian: np.ndarray

    @property
    def mean(self) -> Quadratic:
        """That of the functions' mean, m = 1."""
        return Quadratic(self.slope.mean(axis=0, keepdims=True), self.hessian.mean(axis=0, keepdims=True))


def fit_quadratic(points: np.ndarray, values: np.ndarray, center: np.ndarray, near: float) -> Quadratic:
    """Fit quadratics about a point to the values of m functions.

    Parameters
    ----------
    points : (k, n) array
    values : (k, m) array
    center : (n,) array
        One of the points.
    near : float
        Distance within which a point counts, ever less towards it.

    Notes
    -----
    What the points do not tell stays at 0: so with fewer points than coefficients there is still one answer.
    """
    d = points - center
    away = np.linalg.norm(d, axis=1)
    middle = values[int(np.argmin(away))]
    used = (away > 0.0) & (away < near)
    d, rest = d[used], values[used] - middle
    weight = (1.0 - (away[used] / near) ** 2)[:, None]
    n, (i, j) = len(center), np.triu_indices(len(center), 1)
    design = weight * np.column_stack([d, 0.5 * d**2, d[:, i] * d[:, j]])
    ridge = np.repeat(_RIDGE, (n, n, len(i)))
    found = np.linalg.solve(design.T @ design + np.diag(ridge), design.T @ (weight * rest)).T
    hessian = np.zeros((values.shape[1], n, n))
    hessian[:, range(n), range(n)] = found[:, n : 2 * n]
    hessian[:, i, j] = hessian[:, j, i] = found[:, 2 * n :]
    return Quadratic(found[:, :n], hessian)


def least_in_box(slope: np.ndarray, hessian: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where ``slope d + d hessian d / 2`` is least between two corners (n,): axis by axis, from 0."""
    d = np.zeros(len(slope))
    for _ in range(_SWEEPS):
        before = d.copy()
        for k, curvature in enumerate(np.diagonal(hessian)):
            across = slope[k] + hessian[k] @ d - curvature * d[k]
            if curvature > 0.0:
                d[k] = np.clip(-across / curvature, low[k], high[k])
            else:  # least at one of the ends
                ends = np.array([low[k], high[k]])
                d[k] = ends[np.argmin(across * ends + 0.5 * curvature * ends**2)]
        if np.abs(d - before).max() < 1e-9:
            break
    return d
