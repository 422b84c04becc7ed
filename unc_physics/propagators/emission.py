"""Samples from a few rollouts: each is a rollout's outcome, moved by what a response surface says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..dynamics.contact_history import ContactHistory
from ..scene.parameters import center_offsets, moved_along
from ..scene.scene import Scene
from ..spatial.layout import ERR_ANGULAR_VELOCITY, ERR_POSITION, ERR_ROTATION, ERR_VELOCITY, ERROR
from ..spatial.moments import mean_and_errors, spread_states
from .displacements import clip, reach, spread, variances
from .free_flight import Flight, course_of, fly
from .impact_metric import impact_metric
from .reduction import Reduction, moved_in_common, reduction
from .response_surface import ResponseSurface, active_directions, fit, predicted

#: Blocks of the outcome that are clipped, each with the block that shares the factor, and what they count.
_CLIPPED = ((ERR_POSITION.start, ERR_VELOCITY.start), (ERR_ROTATION.start, ERR_ANGULAR_VELOCITY.start))
_WEIGHTS = ((ERR_POSITION, 1.0), (ERR_VELOCITY, 0.5), (ERR_ROTATION, 1.0), (ERR_ANGULAR_VELOCITY, 0.5))
#: Standard deviations below which a block of an outcome is constant: of the body's radius, or rad.
_CONSTANT = 1e-6
_DIVERGED = 1e100
_WIDEST = 2.0  # times, that samples are scaled by at most
#: Error over variance above which there is no surface.
NO_SURFACE = 1.0


class Fit(NamedTuple):
    """What was fitted to a group's rollouts.

    Attributes
    ----------
    reduced : Reduction or None
        Of a group that is alone.
    transform : (d, d') array
        From the group's numbers z to the surface's coordinates.
    x : (N, d') array
        The rollouts in these.
    mean : (m, 13) array
        Of their outcomes.
    errors : (N, 12 m) array
        Outcomes about it.
    weights : (12 m,) array
        By which the surface's are multiplied; 0 for what does not vary.
    surface : ResponseSurface
    """

    reduced: Reduction | None
    transform: np.ndarray
    x: np.ndarray
    mean: np.ndarray
    errors: np.ndarray
    weights: np.ndarray
    surface: ResponseSurface


class Runs(NamedTuple):
    """N rollouts, and what they stand for; the first seven attributes are those of `cloud.CloudCarry`.

    Attributes
    ----------
    z : (N, r + K) array
        The standard normal numbers that each rollout began with.
    fits : dict
        What was fitted to each group, by its bodies; `fitted` adds to it.
    """

    states: np.ndarray
    contact_history: ContactHistory
    step: int
    mean: np.ndarray
    root: np.ndarray
    moving: np.ndarray
    parameters: np.ndarray
    z: np.ndarray
    fits: dict[bytes, Fit]


class Group(NamedTuple):
    """Moving bodies that met, directly or through others, in any of the rollouts.

    Attributes
    ----------
    bodies : (m,) int array
    columns : (d,) int array
        Which of the numbers z their outcome depends on: first those of the root, then ``parameters`` others.
    parameters : int
    root : (12 m, d - parameters) array
    alone : bool
        Whether they met nothing besides each other.
    flew : bool
        Whether this is a body that met nothing at all, and began as the belief has it.
    """

    bodies: np.ndarray
    columns: np.ndarray
    parameters: int
    root: np.ndarray
    alone: bool
    flew: bool


def emitted(runs: Runs, scene: Scene, z: np.ndarray) -> np.ndarray:
    """(S, B, 13): states of the models' centres of mass for standard normal numbers ``z`` (S, r + K).

    Parameters
    ----------
    runs : Runs
    scene : Scene
    z : (S, r + K) array
    """
    states = np.tile(runs.mean, (len(z), 1, 1))
    if diverged(runs.states):
        return np.full_like(states, np.nan)
    ends = _model_centers(runs, scene)
    for group in _groups(runs, scene):
        if group.flew:
            states[:, group.bodies] = _flown(runs, scene, group, z)
        elif _spread(runs, scene, group):
            states[:, group.bodies] = _sampled(runs, scene, group, ends[:, group.bodies], z)
        else:
            states[:, group.bodies] = ends[:1, group.bodies]
    return states


def diverged(states: np.ndarray) -> bool:
    """Whether states are no numbers, or so large that their squares are none."""
    return not bool((np.abs(states) < _DIVERGED).all())


def fits(runs: Runs, scene: Scene) -> Iterator[tuple[Group, Fit]]:
    """Each group whose rollouts differ, but for what flew in closed form, and what is fitted to it."""
    ends = _model_centers(runs, scene)
    for group in _groups(runs, scene):
        if not group.flew and _spread(runs, scene, group):
            yield group, _fitted(runs, scene, group, ends[:, group.bodies])


def settled(runs: Runs, scene: Scene) -> bool:
    """Whether everything is known in closed form, so that more rollouts would tell nothing."""
    return all(group.flew or not _spread(runs, scene, group) for group in _groups(runs, scene))


def _spread(runs, scene, group):
    """Whether the rollouts of a group differ."""
    return bool(runs.z[:, group.columns].any()) or scene.draws_impacts


def _model_centers(runs, scene):
    """States (N, B, 13) of the points that beliefs are about."""
    return moved_along(runs.states, -center_offsets(scene, runs.parameters))


def _groups(runs, scene):
    """The groups of all moving bodies."""
    first, start = runs.contact_history.first_time, runs.contact_history.start
    count, size = len(runs.mean), runs.root.shape[1]
    met = np.isfinite(first).any(axis=0)
    movable = np.zeros(count, bool)
    movable[runs.moving] = True
    between = (met[:, :count] | met[:, :count].T) & movable & movable[:, None]
    others = met[:, count:].any(axis=1) | ((met[:, :count] | met[:, :count].T) & ~movable).any(axis=1)
    moved = np.zeros(count, bool) if start is None else (start.moved > 0.0).any(axis=0)
    tilted = scene.gyroscopic or any(p.name == "gravity_direction" for p in scene.uncertain)
    tilted = tilted and runs.step > 0
    roots = runs.root.reshape(len(runs.moving), ERROR, size)
    left = set(runs.moving.tolist())
    while left:
        found = [min(left)]
        for k in found:
            found += [b for b in np.flatnonzero(between[k]).tolist() if b in left and b not in found]
        left.difference_update(found)
        bodies = np.array(sorted(found))
        root = roots[np.isin(runs.moving, bodies)]
        used = np.flatnonzero(root.any(axis=(0, 1)))
        known = {*bodies.tolist(), *range(count, count + len(scene.environment)), -1}
        extra = [size + c for c, parameter in enumerate(scene.uncertain) if parameter.body in known]
        columns = np.concatenate([used, np.array(extra, np.int64)])
        alone = not (others | moved)[bodies].any()
        flew = alone and len(bodies) == 1 and not tilted
        root = np.ascontiguousarray(root[:, :, used].reshape(ERROR * len(bodies), len(used)))
        yield Group(bodies, columns, len(extra), root, alone, flew)


def _flown(runs, scene, group, z):
    """States (S, 1, 13) of a body that meets nothing."""
    own = z[:, group.columns[: group.root.shape[1]]]
    states = spread_states(runs.mean[group.bodies], np.arange(1), np.einsum("sr,kr->sk", own, group.root))
    flight = Flight(scene.world.gravity, course_of(scene.world, runs.step), runs.step)
    offsets = center_offsets(scene, z[:, runs.root.shape[1] :])
    if not offsets.shape[1]:
        fly(states, flight)
        return states
    offsets = offsets[:, group.bodies]
    states = moved_along(states, offsets)
    fly(states, flight)
    return moved_along(states, -offsets)


def _meetings(runs, group):
    """Who of a group meets whom, when on average, and in what share of the rollouts (`impact_metric`)."""
    first, count = runs.contact_history.first_time, len(runs.mean)
    met = np.isfinite(first).any(axis=0)
    found, place_of = [], {int(body): place for place, body in enumerate(group.bodies)}
    for place, i in enumerate(group.bodies.tolist()):
        either = met[i].copy()
        either[:count] |= met[:, i]
        for column in np.flatnonzero(either).tolist():
            times = first[:, i, column]
            if column < count:
                times = np.minimum(times, first[:, column, i])
            some = np.isfinite(times)
            partner = place_of.get(column, -1)
            if partner < 0 or partner > place:
                found.append((place, partner, float(np.median(times[some])), float(some.mean())))
    return found


def _fitted(runs, scene, group, ends):
    """As `_fit`, once for the same rollouts: their samples, standard errors and status all ask for it."""
    key = group.bodies.tobytes()
    if key not in runs.fits:
        runs.fits[key] = _fit(runs, scene, group, ends)
    return runs.fits[key]


def _fit(runs, scene, group, ends):
    """A group's `Fit`, of its outcomes (N, m, 13)."""
    d = len(group.columns)
    reduced = reduction(group.root, group.parameters) if group.alone else None
    relative = np.eye(d) if reduced is None else reduced.relative
    ends = ends.copy()
    own = runs.z[:, group.columns]
    if reduced is not None and reduced.common.shape[1]:
        moved_in_common(ends, -(own @ reduced.common) @ reduced.motion.T, course_of(scene.world, runs.step))
    root = group.root @ relative[: d - group.parameters, : relative.shape[1] - group.parameters]
    to_metric = impact_metric(scene, runs.mean, root, group.bodies, _meetings(runs, group), group.parameters)
    transform = relative @ to_metric
    mean, errors = mean_and_errors(ends, np.arange(len(group.bodies)))
    scaled, weights = _weighted(errors, scene.world.bodies.radius[group.bodies])
    x = np.ascontiguousarray(own @ transform)
    surface = fit(x, scaled)
    to_slopes = active_directions(surface)
    again = np.ascontiguousarray(x @ to_slopes)
    other = fit(again, scaled, surface)
    if other.error < surface.error:
        transform, x, surface = transform @ to_slopes, again, other
    return Fit(reduced, transform, x, mean, errors, weights, surface)


def _weighted(errors, radius):
    """Outcomes (N, 12 m) by their spread, block by block, and these weights (12 m,)."""
    parts = errors.reshape(len(errors), -1, ERROR)
    weights = np.zeros(parts.shape[1:])
    for block, weight in _WEIGHTS:
        spread = np.sqrt((parts[:, :, block] ** 2).sum(axis=2).mean(axis=0))
        least = _CONSTANT * (radius if block in (ERR_POSITION, ERR_VELOCITY) else np.ones(len(radius)))
        weights[:, block] = np.where(spread > least, weight / np.maximum(spread, least), 0.0)[:, None]
    weights = weights.ravel()
    return errors * weights, weights


def _sampled(runs, scene, group, ends, z):
    """States (S, m, 13) of bodies that met something."""
    reduced, transform, x, mean, errors, weights, surface = _fitted(runs, scene, group, ends)
    own = np.ascontiguousarray(z[:, group.columns])
    if surface.error >= NO_SURFACE:  # the rollouts as they are, each as often
        made = errors[np.arange(len(z)) % len(x)]
    else:
        form = surface.weights * _unscaled(weights), surface.trend * _unscaled(weights), surface.length
        columns = np.ascontiguousarray(x.T)
        # einsum, not BLAS, whose threads wait for each other
        means, near = predicted(*form, columns, np.einsum("sr,rk->sk", own, transform))
        made = errors[near] + _changes(means - predicted(*form, columns, x)[0][near], errors, near)
        _spread_as_outcomes(made, means, errors, surface.left_out * _unscaled(weights))
    states = spread_states(mean, np.arange(len(group.bodies)), made)
    if reduced is not None and reduced.common.shape[1]:
        moved_in_common(states, (own @ reduced.common) @ reduced.motion.T, course_of(scene.world, runs.step))
    return states


def _unscaled(weights):
    """(12 m,): from outcomes by their spread to outcomes; 0 for what does not vary."""
    return np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0.0)


def _changes(changes, errors, near):
    """The changes (S, 12 m) of outcomes from the nearest rollout, no further than to others."""
    for first in range(0, errors.shape[1], ERROR):
        for block, also in _CLIPPED:
            limit = reach(errors, first + block, 3)
            clip(changes, first + block, 3, first + also, limit[near])
    return changes


def _spread_as_outcomes(made, means, errors, left_out):
    """Scale samples (S, 12 m) about their mean, block by block, so that they vary as outcomes do.

    A surface through few rollouts varies less than outcomes do. The rollouts' variance is no less, but of
    few; what the surface knows of where they happen to lie is taken from it, as a control variate: plus the
    variance of the surface's ``means`` at all samples, less that at the rollouts, each without itself.
    """
    count = len(left_out)
    more = (variances(errors[:count]) - variances(errors[:count] - left_out)) * count / max(count - 1, 1)
    wanted = (variances(means) + more).reshape(-1, 3).sum(axis=1)
    found = variances(made).reshape(-1, 3).sum(axis=1)
    share = np.divide(np.maximum(wanted, 0.0), found, out=np.ones_like(found), where=found > 0.0)
    spread(made, np.repeat(np.clip(np.sqrt(share), 1.0 / _WIDEST, _WIDEST), 3))
