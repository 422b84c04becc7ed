"""Beliefs about the models' own origins, from beliefs about the centres of mass (COM).

The origin of a model is at ``o`` in the body frame at the COM. Its position and velocity are nonlinear in the
rotation: ``p_o = p + R o`` and ``v_o = v + omega x R o``. The functions return the mean and the covariance of
these, and not the linear map of the mean and the covariance at the COM.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np

from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..spatial.moments import mean_and_errors, second_moment, spread_states
from ..spatial.rotation import cross_matrices, rotation_matrices
from .belief import Belief
from .parameters import moved_along

_OTHERS = np.r_[ERR_POSITION, ERR_VELOCITY, ERR_ANGULAR_VELOCITY]  # errors but that of the rotation
_OTHER_P, _OTHER_V, _OTHER_W = slice(0, 3), slice(3, 6), slice(6, 9)  # their places in `_OTHERS`
#: Points of the Gauss-Hermite rule for each axis of rotation, up to each largest standard deviation [rad].
_RULES = (0.1, 3), (0.5, 5), (np.inf, 10)
_CERTAIN = 1e-14  # share of the largest variance of a rotation below which an axis has none


def gaussian_at_origins(belief: Belief, origins: np.ndarray) -> Belief:
    """Return the moments at other points of the bodies if the belief at the COMs is exactly Gaussian.

    ``origins`` (B, 3) are the points in body frames [m]. Rotations and their errors stay those of ``belief``.

    Notes
    -----
    Integrals over the three rotation errors are computed by a Gauss-Hermite rule. The other errors are linear
    in the rotation error but for a remainder that is independent of it, over which the integrals are exact.
    Covariances between bodies are mapped by each body's mean derivative.
    """
    mean = _linear_mean(belief.mean, origins)
    moving = belief.moving
    if not len(moving) or not (np.isfinite(belief.mean).all() and np.isfinite(belief.covariance).all()):
        return Belief.trusted(mean, belief.covariance, moving)
    blocks, maps = np.empty((len(moving), ERROR, ERROR)), np.empty((len(moving), ERROR, ERROR))
    for k, b in enumerate(moving.tolist()):
        shift, blocks[k], maps[k] = _gaussian_body(belief.mean[b], belief.blocks[k], origins[b])
        mean[b, POSITION] = belief.mean[b, POSITION] + shift[ERR_POSITION]
        mean[b, VELOCITY] = belief.mean[b, VELOCITY] + shift[ERR_VELOCITY]
    if belief.independent:
        return Belief.trusted(mean, blocks, moving)
    C, own = _mapped(belief.joint, maps), np.arange(len(moving))
    parts = C.reshape(len(moving), ERROR, len(moving), ERROR)
    parts[own, :, own, :] = blocks
    return Belief.trusted(mean, parts.reshape(C.shape), moving)


def states_at_origins(belief: Belief, states: np.ndarray, origins: np.ndarray) -> Belief:
    """Return the moments of `gaussian_at_origins` from equally probable states.

    The belief at the COMs may differ from the moments of the states (N, B, 13): then the difference is mapped
    linearly.
    """
    mean, moving = _linear_mean(belief.mean, origins), belief.moving
    if not len(moving):
        return Belief.trusted(mean, belief.covariance, moving)
    at_com, errors = mean_and_errors(np.ascontiguousarray(states), moving.copy())
    R = rotation_matrices(states[:, moving, QUATERNION])
    arms = np.einsum("nmij,mj->nmi", R, origins[moving])
    whirled = np.cross(states[:, moving, ANGULAR_VELOCITY], arms)
    mean[moving, POSITION] = belief.mean[moving, POSITION] + arms.mean(axis=0)
    mean[moving, VELOCITY] = belief.mean[moving, VELOCITY] + whirled.mean(axis=0)
    errors = errors.reshape(len(states), len(moving), ERROR)
    there = errors.copy()
    there[..., ERR_POSITION] += arms - arms.mean(axis=0)
    there[..., ERR_VELOCITY] += whirled - whirled.mean(axis=0)
    maps = np.array(
        [_mean_map(R[:, k].mean(axis=0), at_com[b], origins[b]) for k, b in enumerate(moving.tolist())]
    )
    if belief.independent:
        own, other = (
            np.array([second_moment(part[:, k].copy()) for k in range(len(moving))])
            for part in (there, errors)
        )
        blocks = _added(own, maps @ (belief.blocks - other) @ maps.transpose(0, 2, 1))
        return Belief.trusted(mean, blocks, moving)
    own = second_moment(there.reshape(len(states), -1))
    other = second_moment(errors.reshape(len(states), -1))
    return Belief.trusted(mean, _added(own, _mapped(belief.joint - other, maps)), moving)


def points_at_origins(belief: Belief, points: np.ndarray, odd: np.ndarray, origins: np.ndarray) -> Belief:
    """Return the moments of `gaussian_at_origins` from sigma points.

    ``points`` (2 n + 1, B, 13) are their states, and ``odd`` (n, M, 12) half the differences of opposite
    ones, as errors.

    Notes
    -----
    Sigma points lie too far out to integrate over large rotations. The Gaussian is integrated instead. The
    points give the difference that the even parts of their errors make, which contacts cause.
    """
    gaussian = gaussian_at_origins(belief, origins)
    if not len(belief.moving):
        return gaussian
    errors = np.concatenate([np.zeros((1, *odd.shape[1:])), odd, -odd]).reshape(2 * len(odd) + 1, -1)
    linear = spread_states(belief.mean.copy(), belief.moving.copy(), errors)
    found, without = (states_at_origins(belief, states, origins) for states in (points, linear))
    mean = gaussian.mean + found.mean - without.mean
    mean[:, QUATERNION] = gaussian.mean[:, QUATERNION]
    return Belief.trusted(
        mean, _added(gaussian.covariance, found.covariance - without.covariance), belief.moving
    )


def _linear_mean(mean, origins):
    """Return the means (B, 13) of the points as if rotations were exact."""
    return moved_along(mean[None], origins[None])[0]


def _gaussian_body(state, P, origin):
    """Return a point's mean error (12,) from the COM, its covariance and its mean derivative (12, 12)."""
    spread, basis = np.linalg.eigh(P[ERR_ROTATION, ERR_ROTATION])
    kept = spread > _CERTAIN * max(float(spread[-1]), 1e-300)
    roots, basis = np.sqrt(spread[kept]), basis[:, kept]
    largest = roots.max(initial=0.0)
    z, weights = _rule(next(count for limit, count in _RULES if largest <= limit), len(roots))
    turns = (z * roots) @ basis.T
    inverse = (basis / spread[kept]) @ basis.T
    slope = P[np.ix_(_OTHERS, np.arange(ERROR)[ERR_ROTATION])] @ inverse
    rest = P[np.ix_(_OTHERS, _OTHERS)] - slope @ P[ERR_ROTATION][:, _OTHERS]
    R = rotation_matrices(state[QUATERNION])
    arms = _rotate_by_vectors(turns, origin) @ R.T
    given = turns @ slope.T
    F = np.empty((len(turns), ERROR))
    F[:, ERR_POSITION] = given[:, _OTHER_P] + arms
    omega = state[ANGULAR_VELOCITY] + given[:, _OTHER_W]
    F[:, ERR_VELOCITY] = given[:, _OTHER_V] + np.cross(omega, arms)
    F[:, ERR_ROTATION], F[:, ERR_ANGULAR_VELOCITY] = turns, given[:, _OTHER_W]
    middle = weights @ F
    apart = F - middle
    arm = weights @ arms
    # the remainder is mapped by [1, 0, 0; 0, 1, -[arm]x; 0, 0, 1], whose second moment is known
    J = np.zeros((ERROR, 9))
    J[ERR_POSITION, _OTHER_P] = J[ERR_VELOCITY, _OTHER_V] = J[ERR_ANGULAR_VELOCITY, _OTHER_W] = np.eye(3)
    J[ERR_VELOCITY, _OTHER_W] = -cross_matrices(arm)
    C = (weights[:, None] * apart).T @ apart + J @ rest @ J.T
    swings = cross_matrices(arms - arm)
    swung = swings @ rest[_OTHER_W, _OTHER_W] @ swings.transpose(0, 2, 1)
    C[ERR_VELOCITY, ERR_VELOCITY] += np.einsum("n,nij->ij", weights, swung)
    A = np.eye(ERROR)
    A[ERR_VELOCITY, ERR_ANGULAR_VELOCITY] = -cross_matrices(arm)
    moment = (weights[:, None] * apart).T @ turns @ inverse  # slopes of the point's errors over the rotation
    A[ERR_POSITION, ERR_ROTATION] = moment[ERR_POSITION] - slope[_OTHER_P]
    A[ERR_VELOCITY, ERR_ROTATION] = (
        moment[ERR_VELOCITY] - slope[_OTHER_V] + cross_matrices(arm) @ slope[_OTHER_W]
    )
    return middle, 0.5 * (C + C.T), A


@functools.lru_cache(maxsize=16)
def _rule(count, axes):
    """Return points (K, axes) and weights (K,) of the standard normal distribution."""
    x, w = np.polynomial.hermite_e.hermegauss(count)
    w = w / w.sum()
    grid = np.array([*itertools.product(x, repeat=axes)]).reshape(count**axes, axes)
    weights = np.array([*itertools.product(w, repeat=axes)]).reshape(count**axes, axes).prod(axis=1)
    return grid, weights


def _rotate_by_vectors(turns, point):
    """Return a point (3,) rotated by each of some rotation vectors (K, 3)."""
    angle = np.linalg.norm(turns, axis=1)[:, None]
    sine = np.sinc(angle / np.pi)
    cosine = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    once = np.cross(turns, point)
    return point + sine * once + cosine * np.cross(turns, once)


def _mean_map(R, state, origin):
    """Return the derivative (12, 12) of a point's error, for the mean ``R`` (3, 3) of rotation matrices."""
    A = np.eye(ERROR)
    A[ERR_POSITION, ERR_ROTATION] = -R @ cross_matrices(origin)
    A[ERR_VELOCITY, ERR_ROTATION] = -cross_matrices(state[ANGULAR_VELOCITY]) @ R @ cross_matrices(origin)
    A[ERR_VELOCITY, ERR_ANGULAR_VELOCITY] = -cross_matrices(R @ origin)
    return A


def _mapped(C, maps):
    """Return a joint covariance (12 M, 12 M) after each body's map (M, 12, 12)."""
    count = len(maps)
    C = np.einsum("mab,mbnc->manc", maps, C.reshape(count, ERROR, count, ERROR))
    return np.einsum("manb,ncb->manc", C, maps).reshape(ERROR * count, ERROR * count)


def _added(moment, difference):
    """Return covariances (..., n, n) plus symmetric matrices, or the nearest covariances to the sums."""
    if not difference.any():
        return moment
    total = moment + 0.5 * (difference + np.swapaxes(difference, -1, -2))
    values, vectors = np.linalg.eigh(total)
    nearest = (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.where((values[..., 0] >= 0.0)[..., None, None], total, nearest)
