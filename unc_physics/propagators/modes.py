"""Modes of a prediction: rollouts as a few weighted Gaussians; the rollouts determine their number."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..scene.belief import Belief
from ..spatial.layout import ERR_POSITION, ERR_ROTATION, ERROR, POSITION, VELOCITY
from ..spatial.moments import boxminus, mean_and_errors, second_moment

_MOST = 5  # modes
_ROUNDS = 20  # of k-means
_CONSTANT = 1e-6  # spread of a constant
_SMALL = 0.01  # spread of an ignored coordinate [body radii, rad]
#: Least gap between two modes: the distance over the sum of their standard deviations along it. Halves of a
#: uniform distribution have 1.7, of a normal distribution 1.3.
_APART = 2.2
#: Allowances for few rollouts, over the root of their number and, below fifty, over their number. In six
#: coordinates the gap of a dozen normal rollouts exceeds 4.1 in one case of twenty.
_BY_CHANCE, _BY_CHANCE_OF_FEW = 5.0, 35.0
_FEWEST, _LEAST = 3, 0.05  # rollouts in a mode, and its share of the part that it is split from
#: Gap in any coordinate below which two modes of many rollouts are joined; the parts of an oblique cut have
#: 1.27.
_TOGETHER = 1.2
#: Width of the empty interval beside a mode of a smaller share, over the spread of the others; three of a
#: thousand normal numbers are 0.3 from the next.
_EMPTY = 2.0
#: Standard deviations from a mode's median beyond which a rollout is an outlier; standard deviation of a
#: normal distribution over its median absolute deviation; and least standard deviation [body radii, rad].
_OUTLIER, _NORMAL, _LEAST_SCALE = 8.0, 1.4826, 0.05
#: Time for which rollouts are extrapolated before outliers are assigned [s]; about a fall from a table.
_SOON = 0.3


class Mode(NamedTuple):
    """One of the outcomes of a body.

    Attributes
    ----------
    weight : float
        Its probability.
    mean : (13,) array
        State ``[p, v, q, omega]``, as in `Belief`.
    covariance : (12, 12) array
        Of the error state about the mean, as in `Belief`.
    """

    weight: float
    mean: np.ndarray
    covariance: np.ndarray

    def __repr__(self):
        return (
            f"<Mode of probability {self.weight:.3f}, position {np.round(self.mean[POSITION], 4).tolist()} m>"
        )


def only_mode(belief: Belief, body: int) -> Mode:
    """Return the belief of one body, by its index, as its only mode."""
    return Mode(1.0, belief.mean[body].copy(), belief.marginal(body).copy())


def split(states: np.ndarray, radius: float) -> tuple[Mode, ...]:
    """Split rollouts of one body, states (S, 13), into modes, the most probable first; its radius is in m.

    Notes
    -----
    Coordinates are positions and rotations in units of their spread. Coordinates that spread by less than 1 %
    of the body's radius, or 0.01 rad, are ignored. k-means from several starts divides the rollouts in two,
    and the cut is at the widest gap along the line between both means. Parts with a gap are divided again, so
    that most predictions have one mode. Rollouts far from the others of their part belong to the part of the
    rollout that they come closest to within 0.3 s. Parts in the same place, or of fewer than three rollouts,
    are joined. A mode has weight, mean and covariance of its rollouts.
    """
    pose = _poses(states, radius)
    spread = pose.std(axis=0)
    soon = pose.copy()
    soon[:, :3] += _SOON / radius * states[:, VELOCITY]
    pose = pose[:, spread > _SMALL]
    labels = np.zeros(len(states), np.int64)
    if pose.shape[1] and len(states) > 1:
        labels = _with_reassigned_outliers(pose, soon, _labels(pose / pose.std(axis=0)))
    parts = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    modes = [_mode_of(states, part) for part in parts]
    while (pair := _same_outcome(parts, modes, radius)) is not None:
        one, other = pair
        parts[one] = np.union1d(parts[one], parts.pop(other))
        modes.pop(other)
        modes[one] = _mode_of(states, parts[one])
    return tuple(sorted(modes, key=lambda mode: -mode.weight))


def may_split(states: np.ndarray, radius: float) -> bool:
    """Return whether `split` may find several modes in more rollouts of the same body.

    True if rollouts (S, 13) of a body with this radius [m] have one mode, and a gap that is wide except for
    its allowance for very few rollouts.
    """
    pose = _poses(states, radius)
    pose = pose[:, pose.std(axis=0) > _SMALL]
    if not pose.shape[1]:
        return False
    gap, _ = _second_part(pose / pose.std(axis=0), _APART + _BY_CHANCE / math.sqrt(len(pose)))
    return gap > 0.0 and len(split(states, radius)) == 1


def _poses(states, radius):
    """Return poses (S, 6) relative to their mean, positions in radii and rotations in rad."""
    _, errors = mean_and_errors(np.ascontiguousarray(states[:, None]), np.arange(1))
    return np.concatenate([errors[:, ERR_POSITION] / radius, errors[:, ERR_ROTATION]], axis=1)


def contains(mode: Mode, mean: np.ndarray, radius: float) -> bool:
    """Return whether a mean state (13,) is a standard deviation of a mode from its mean, at most, in each
    coordinate of the pose.

    Standard deviations are at least the spread that `split` ignores, for a body of that radius [m].
    """
    errors = np.empty(ERROR)
    boxminus(np.ascontiguousarray(mean), np.ascontiguousarray(mode.mean), errors)
    stds = np.sqrt(np.maximum(mode.covariance.diagonal(), 0.0))
    within = np.abs(errors) <= np.maximum(stds, _SMALL)
    within[ERR_POSITION] = np.abs(errors[ERR_POSITION]) <= np.maximum(stds[ERR_POSITION], _SMALL * radius)
    return bool(within[ERR_POSITION].all() and within[ERR_ROTATION].all())


def _mode_of(states, part):
    """Return the `Mode` of some rollouts, by their indices."""
    mean, errors = mean_and_errors(np.ascontiguousarray(states[part][:, None]), np.arange(1))
    return Mode(len(part) / len(states), mean[0], second_moment(errors))


def _same_outcome(parts, modes, radius):
    """Return the indices (one, other), ascending, of the closest two modes to be joined, or None.

    Modes are joined if one has too few rollouts, or if successive cuts divided the same group.
    """
    best = None
    for other in range(1, len(modes)):
        for one in range(other):
            gap = _gap(modes[one], modes[other], radius)
            fewer = min(len(parts[one]), len(parts[other]))
            same = fewer < _FEWEST or gap < _TOGETHER + 1.0 / math.sqrt(fewer)
            if same and (best is None or gap < best[0]):
                best = gap, one, other
    return None if best is None else best[1:]


def _gap(one, other, radius):
    """Return the distance of two modes' poses over the sum of their standard deviations.

    It is the largest of all coordinates. This sum is at least the spread that `split` ignores, for a body of
    that radius [m].
    """
    errors, both = np.empty(ERROR), [np.ascontiguousarray(mode.mean) for mode in (one, other)]
    boxminus(both[1], both[0], errors)
    variances = np.array([mode.covariance.diagonal() for mode in (one, other)])
    width = np.sqrt(np.maximum(variances, 0.0)).sum(axis=0)
    return max(
        float((np.abs(errors[place]) / np.maximum(width[place], least)).max())
        for place, least in ((ERR_POSITION, _SMALL * radius), (ERR_ROTATION, _SMALL))
    )


def _labels(x):
    """Return the mode (S,) of each point (S, d); parts with the widest gap are divided first."""
    labels = np.zeros(len(x), np.int64)
    parts = {0: _second_part(x)}
    while len(parts) < _MOST:
        label = max(parts, key=lambda one: parts[one][0])
        gap, second = parts[label]
        if not gap > 0.0:
            break
        own, new = np.flatnonzero(labels == label), len(parts)
        labels[own[second]] = new
        for one in (label, new):
            parts[one] = _second_part(x[labels == one])
    return labels


def _with_reassigned_outliers(pose, soon, labels):
    """Return labels (S,) in which outliers of their mode belong to the mode of the nearest rollout.

    An outlier is many median absolute deviations of poses (S, d) from the median of its mode. Distances are
    those of poses ``soon`` after (S, 6), as falling bodies approach fallen ones. Both are in radii and rad.
    The nearest outlier is assigned first, and later ones may follow it.
    """
    modes = np.unique(labels)
    if len(modes) < 2:
        return labels
    is_outlier = np.empty(len(pose), bool)
    for label in modes:
        own = pose[labels == label]
        apart = np.abs(own - np.median(own, axis=0))
        scale = np.maximum(_NORMAL * np.median(apart, axis=0), _LEAST_SCALE)
        is_outlier[labels == label] = (apart / scale).max(axis=1) > _OUTLIER
    found, left = labels.copy(), np.flatnonzero(is_outlier)
    distances = np.linalg.norm(soon[left, None] - soon, axis=2)
    distances[:, is_outlier] = np.inf
    while len(left):
        row, nearest = np.unravel_index(distances.argmin(), distances.shape)
        k = left[row]
        found[k] = found[nearest]
        left, distances = np.delete(left, row), np.delete(distances, row, axis=0)
        distances[:, k] = np.linalg.norm(soon[left] - soon[k], axis=1)
    return found


def _second_part(x, least=None):
    """Return the gap between two parts of points (S, d), and the second part (S,); 0 without a gap.

    ``least`` replaces the least gap that counts.
    """
    spread = x.std(axis=0)
    some = spread > _CONSTANT
    whole = 0.0, np.zeros(len(x), bool)
    if not some.any() or len(x) < 2 * _FEWEST:
        return whole
    x = (x[:, some] - x[:, some].mean(axis=0)) / spread[some]
    axes = np.linalg.svd(np.cov(x.T).reshape(x.shape[1], -1))[0]
    along = x @ _directions_between_means(x, np.concatenate([np.eye(x.shape[1]), axes.T]).T)
    order = np.argsort(along, axis=0, kind="stable")
    gaps, counts = _widest_gaps(np.take_along_axis(along, order, axis=0), math.ceil(_LEAST * len(x)))
    best = int(gaps.argmax())
    if least is None:
        least = _APART + max(_BY_CHANCE / math.sqrt(len(x)), _BY_CHANCE_OF_FEW / len(x))
    if gaps[best] <= least:
        return whole
    found = np.zeros(len(x), bool)
    found[order[counts[best] :, best]] = True
    return float(gaps[best]), found


def _directions_between_means(x, starts):
    """Return unit vectors (d, K) from one of two means of points ``x`` (S, d) to the other, by k-means.

    The points have mean 0. ``starts`` (d, K) are normals of the planes that divide the points at first.
    """
    second, ways = x @ starts > 0.0, starts
    for _ in range(_ROUNDS):
        sums, counts = x.T @ second, second.sum(axis=0)
        divided = (counts > 0) & (counts < len(x))
        one, other = -sums / np.maximum(len(x) - counts, 1), sums / np.maximum(counts, 1)  # the sum of x is 0
        ways = np.where(divided, other - one, ways)
        before, second = second, (x @ ways - 0.5 * ((one + other) * ways).sum(axis=0)) > 0.0
        second = np.where(divided, second, before)
        if (second == before).all():
            break
    return ways / np.maximum(np.linalg.norm(ways, axis=0), _CONSTANT)


def _widest_gaps(values, usual):
    """Return the widest gap (K,) of any cut through ascending values (S, K), and the count below it (K,).

    A gap is the distance of means over the sum of standard deviations. Each side has at least `_FEWEST`
    values. A side of fewer than ``usual`` values must be separated by an empty interval.
    """
    count = np.arange(1, len(values))[:, None]
    sums, squares = np.cumsum(values, axis=0), np.cumsum(values**2, axis=0)
    sides = (
        (count, sums[:-1], squares[:-1]),
        (len(values) - count, sums[-1] - sums[:-1], squares[-1] - squares[:-1]),
    )
    means = [total / n for n, total, _ in sides]
    stds = [
        np.sqrt(np.maximum(square / n - mean**2, 0.0))
        for (n, _, square), mean in zip(sides, means, strict=True)
    ]
    gaps = (means[1] - means[0]) / np.maximum(stds[0] + stds[1], _CONSTANT)
    smaller = np.minimum(count, len(values) - count)
    of_others = np.where(2 * count > len(values), *stds)
    alone = np.diff(values, axis=0) > _EMPTY * of_others
    gaps = np.where((smaller >= _FEWEST) & ((smaller >= usual) | alone), gaps, 0.0)
    best = gaps.argmax(axis=0)
    return gaps[best, np.arange(values.shape[1])], best + 1
