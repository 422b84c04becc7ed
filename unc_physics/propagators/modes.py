"""Outcomes that split: samples as a few weighted Gaussians, their number from the samples."""

from __future__ import annotations

import numpy as np

from ..physics.layout import ERR_POSITION, ERR_ROTATION
from ..physics.moments import mean_and_errors, second_moment

_MOST = 5  # modes
_ROUNDS = 20  # of k-means
_CONSTANT = 1e-6  # spread of what does not vary
#: Distance of two modes over the sum of their standard deviations along it, and what few rollouts add to
#: that, over the root of their number: halves of what is flat have 1.7, of a normal distribution 1.3.
_APART, _BY_CHANCE = 2.2, 5.0
_FEWEST, _LEAST = 3, 0.05  # rollouts in a mode, and its share of what it is split from


def split(states: np.ndarray, rollouts: int, radius: float) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Weight, mean state (13,) and covariance (12, 12) of each mode, the most probable first.

    Parameters
    ----------
    states : (S, 13) array
        Samples of one body.
    rollouts : int
        That they rest on.
    radius : float
        Of the body [m].

    Notes
    -----
    Positions and rotations, in units of their spread, are divided in two by k-means from several beginnings,
    and cut where the gap along the way between both parts is widest; the parts again, as long as there is a
    gap. So there is one mode where one suffices. A mode's mean and covariance are those of its samples.
    """
    _, errors = mean_and_errors(np.ascontiguousarray(states[:, None]), np.arange(1))
    pose = np.concatenate([errors[:, ERR_POSITION] / radius, errors[:, ERR_ROTATION]], axis=1)
    spread = pose.std(axis=0)
    pose = pose[:, spread > 1e-6 * max(1.0, spread.max())]
    labels = np.zeros(len(states), np.int64)
    if pose.shape[1] and len(states) > 1:
        labels = _labels(pose / pose.std(axis=0), min(rollouts, len(states)))
    modes = []
    for label in np.unique(labels):
        own = np.ascontiguousarray(states[labels == label][:, None])
        mean, own_errors = mean_and_errors(own, np.arange(1))
        modes.append((len(own) / len(states), mean[0], second_moment(own_errors)))
    return sorted(modes, key=lambda mode: -mode[0])


def _labels(x, rollouts):
    """(S,): which mode each point (S, d) belongs to."""
    labels, whole = np.zeros(len(x), np.int64), [0]
    fewest = _FEWEST * len(x) / rollouts
    while whole and labels.max() + 1 < _MOST:
        own = np.flatnonzero(labels == whole.pop(0))
        second = _second_part(x[own], fewest)
        if second is not None:
            new = labels.max() + 1
            whole += [int(labels[own[0]]), int(new)]
            labels[own[second]] = new
    return labels


def _second_part(x, fewest):
    """(S,) bool: which of the points (S, d) are apart from the others; None where none are.

    ``fewest`` is how many points `_FEWEST` rollouts are.
    """
    spread = x.std(axis=0)
    some = spread > _CONSTANT
    if not some.any() or len(x) < 2.0 * fewest:
        return None
    x = (x[:, some] - x[:, some].mean(axis=0)) / spread[some]
    found, most = None, _APART + _BY_CHANCE / np.sqrt(_FEWEST * len(x) / fewest)
    axes = np.linalg.svd(np.cov(x.T).reshape(x.shape[1], -1))[0]
    for start in np.concatenate([np.eye(x.shape[1]), axes.T]):
        along = x @ _way(x, start)
        order = np.argsort(along, kind="stable")
        gap, count = _widest_gap(along[order], int(np.ceil(max(fewest, _LEAST * len(x), 1.0))))
        if gap > most:
            found, most = np.zeros(len(x), bool), gap
            found[order[count:]] = True
    return found


def _way(x, start):
    """(d,): direction from one mean of two to the other; k-means begins with a plane across ``start``."""
    second, way = x @ start > 0.0, start
    for _ in range(_ROUNDS):
        if second.all() or not second.any():
            break
        one, other = x[~second].mean(axis=0), x[second].mean(axis=0)
        before, way = second, other - one
        second = (x - 0.5 * (one + other)) @ way > 0.0
        if (second == before).all():
            break
    return way / max(float(np.linalg.norm(way)), _CONSTANT)


def _widest_gap(values, fewest):
    """The largest distance of means over the sum of standard deviations, of any cut through ascending values
    (S,), and how many are below it; each side has at least ``fewest``.
    """
    count = np.arange(1, len(values))
    sums, squares = np.cumsum(values)[:-1], np.cumsum(values**2)[:-1]
    sides = (count, sums, squares), (len(values) - count, values.sum() - sums, (values**2).sum() - squares)
    means = [total / n for n, total, _ in sides]
    stds = [
        np.sqrt(np.maximum(square / n - mean**2, 0.0))
        for (n, _, square), mean in zip(sides, means, strict=True)
    ]
    gaps = (means[1] - means[0]) / np.maximum(stds[0] + stds[1], _CONSTANT)
    gaps[(count < fewest) | (len(values) - count < fewest)] = 0.0
    best = int(gaps.argmax()) if len(gaps) else 0
    return (float(gaps[best]), best + 1) if len(gaps) else (0.0, 0)
