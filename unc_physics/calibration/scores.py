"""Proper scores of predicted samples for an observed outcome; the lower the better."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..spatial.layout import POSITION, QUATERNION
from ..spatial.quaternions import inverse, mean, product, rotation_vectors

UP_ANGLE = 0.5  # angle between upward directions below which the same side of two bodies is up [rad]
OUTSIDE = 0.05  # weight of the wide part of a density (`gaussian_scores`)


def energy_score(samples: np.ndarray, observed: np.ndarray, fair: bool = False) -> float:
    """Return the energy score of samples (n, d) for an observation (d,).

    It is the mean distance from the samples to the observation, less half the mean distance between two
    samples. If ``fair``, these are two different samples. The expectation is then that of infinitely many
    samples; otherwise few samples score better the closer they are to each other.

    Sources: T. Gneiting and A. E. Raftery, Strictly Proper Scoring Rules, Prediction, and Estimation, 2007;
    C. A. T. Ferro, Fair scores for ensemble forecasts, 2014.
    """
    square = np.sum(samples**2, axis=1)
    between = np.sqrt(np.maximum(square[:, None] + square - 2.0 * samples @ samples.T, 0.0))
    np.fill_diagonal(between, 0.0)
    return float(np.mean(np.linalg.norm(samples - observed, axis=-1)) - 0.5 * _between(between, fair))


def _between(distances, fair):
    """Return the mean of distances (n, n) between samples; if ``fair``, without the diagonal."""
    return np.sum(distances) / (len(distances) * max(len(distances) - fair, 1))


def chord(cosine: np.ndarray) -> np.ndarray:
    """Return 2 sin(angle / 2) of two rotations from the dot product of their quaternions."""
    return 2.0 * np.sqrt(np.maximum(1.0 - np.minimum(cosine**2, 1.0), 0.0))


def angle(cosine: np.ndarray) -> np.ndarray:
    """Return the angle between two rotations from the dot product of their quaternions [rad]."""
    return 2.0 * np.arccos(np.minimum(np.abs(cosine), 1.0))


def rotation_energy_score(
    quaternions: np.ndarray,
    observed: np.ndarray,
    distance: Callable[[np.ndarray], np.ndarray] = chord,
    fair: bool = False,
) -> float:
    """Return the energy score [rad] of quaternions (n, 4) for an observed quaternion (4,).

    With `chord`, a distance of rotation matrices, the score is strictly proper. `angle` is easier to read,
    and equal for small angles.
    """
    between = distance(quaternions @ quaternions.T)
    np.fill_diagonal(between, 0.0)
    return float(np.mean(distance(quaternions @ observed)) - 0.5 * _between(between, fair))


def fair_brier_score(hits: np.ndarray) -> float:
    """Return the Brier score of an event that happened; its expectation is that of infinitely many samples.

    ``hits`` (n,) says in which samples the event happens.
    """
    misses = 1.0 - float(np.mean(hits))
    return misses**2 - misses * (1.0 - misses) / max(len(hits) - 1, 1)


def lies_alike(quaternions: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """Return whether bodies with quaternions (n, 4) have the same side up as one with (4,): (n,) bool."""
    return up(quaternions) @ up(observed) > np.cos(UP_ANGLE)


def up(quaternions: np.ndarray) -> np.ndarray:
    """Return the world's z axis (..., 3) in the axes of bodies with quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(np.asarray(quaternions), -1, 0)
    return np.stack([2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)], axis=-1)


class PoseErrors(NamedTuple):
    """Samples of a pose and the observed pose, as errors from the samples' mean."""

    #: position, rotation: (..., n, 3): of the samples, world axes [m] and body axes [rad]
    position: np.ndarray
    rotation: np.ndarray
    #: seen_position, seen_rotation: (..., 3): of the observed pose
    seen_position: np.ndarray
    seen_rotation: np.ndarray


def pose_errors(states: np.ndarray, observed: np.ndarray) -> PoseErrors:
    """Return the errors of states (..., n, 13) and of observed poses (..., 7) from the states' mean."""
    middle = states[..., POSITION].mean(axis=-2)
    back = inverse(mean(states[..., QUATERNION]))
    return PoseErrors(
        states[..., POSITION] - middle[..., None, :],
        rotation_vectors(product(back[..., None, :], states[..., QUATERNION])),
        observed[..., :3] - middle,
        rotation_vectors(product(back, observed[..., 3:])),
    )


def gaussian_scores(errors: np.ndarray, observed: np.ndarray, wide: float) -> tuple[np.ndarray, np.ndarray]:
    """Score an observation (..., d) under the Gaussian of samples.

    Parameters
    ----------
    errors : (..., n, d) array
        Errors of the samples from their mean.
    observed : (..., d) array
        Error of the observation from the same mean.
    wide : float
        Standard deviation, in each direction, of a second Gaussian with weight `OUTSIDE` in the density. It
        limits the cost of observations far from all samples.

    Returns
    -------
    log_score : (...) array
        Negative logarithm of the density of the observation, per dimension.
    rank : (...) array
        Share of samples nearer to their mean than the observation, by Mahalanobis distance. If predictions
        are right, it is uniform between 0 and 1: at most 0.9 within the region of 90 %.

    Notes
    -----
    The score of a Gaussian fitted to few samples is biased. Both of its terms are corrected by moments of the
    Wishart distribution, so that their expectations are those of infinitely many samples.
    """
    from scipy.special import digamma

    count, dimensions = errors.shape[-2:]
    samples, seen, root_determinant = _whitened(errors, observed)
    square, freedom = np.sum(seen**2, axis=-1), count - 1
    rank = np.mean(np.sum(samples**2, axis=-1) < square[..., None], axis=-1)
    if freedom > dimensions + 1:
        square = (freedom - dimensions - 1) / freedom * square - dimensions / count
        halves = 0.5 * (freedom - np.arange(dimensions))
        root_determinant = root_determinant - 0.5 * float(np.sum(digamma(halves) - np.log(0.5 * freedom)))
    inside = np.log1p(-OUTSIDE) - 0.5 * square - root_determinant
    outside = np.log(OUTSIDE) - 0.5 * np.sum(observed**2, axis=-1) / wide**2 - dimensions * np.log(wide)
    return -np.logaddexp(inside, outside) / dimensions, rank


def _whitened(errors, observed):
    """Return samples (..., n, d) and observation (..., d) whitened by the samples' covariance.

    Then half the logarithm of its determinant (...).
    """
    middle = errors.mean(axis=-2)
    centered = errors - middle[..., None, :]
    square = np.einsum("...ni,...nj->...ij", centered, centered)
    values, vectors = np.linalg.eigh(square / max(errors.shape[-2] - 1, 1))
    values = np.maximum(values, np.maximum(1e-9 * values.max(axis=-1, keepdims=True), 1e-30))
    axes = vectors / np.sqrt(values)[..., None, :]
    seen = np.einsum("...i,...ij->...j", observed - middle, axes)
    return centered @ axes, seen, 0.5 * np.log(values).sum(axis=-1)
