"""Moments and samples of all outcomes, from a few rollouts and a response surface through them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..compiler import kernel
from ..compiler.arrays import zeros
from ..physics.contact_history import ContactHistory
from ..scene.belief import Belief
from ..scene.parameters import center_offsets, moved_along
from ..scene.scene import Scene
from ..spatial.layout import EP, ER, ERR_POSITION, ERR_VELOCITY, ERROR, EV, EW
from ..spatial.moments import mean_and_errors, pivoted_cholesky, second_moment, spread_states
from .displacements import clip, reach, spread, variances
from .free_flight import course_of, propagate_flight
from .impact_metric import impact_metric
from .overlap_depths import overlaps
from .reduction import Reduction, common_covariance, moved_in_common, reduction, symmetric
from .response_surface import ResponseSurface, active_directions, fit, smoother, solve, surface_moments
from .sobol import normal_points
from .start import OVERLAP_TOLERANCE

#: Spreads below the compliance of contacts [m], [rad]: outcomes and standard errors are not resolved below.
SPREAD_FLOORS = 5e-5, 1e-3
#: Blocks of the outcome that are clipped, each with the block that shares the factor.
_CLIPPED = (EP, EV), (ER, EW)
#: Weights of blocks, whether spreads are measured in radii, and the least spread. Bodies at rest on contacts
#: move by up to 0.5 mm/s and 10 mrad/s.
_WEIGHTS = (
    (EP, 1.0, True, SPREAD_FLOORS[0]),
    (EV, 0.5, True, 5e-4),
    (ER, 1.0, False, SPREAD_FLOORS[1]),
    (EW, 0.5, False, 1e-2),
)
#: Standard deviations below which a block of an outcome is constant: of the body's radius, or rad.
_CONSTANT = 1e-6
_DIVERGED = 1e100
_UNCORRELATED = np.empty((0, 0)), np.empty((0, 0))
_RANK = 1e-12  # relative variances that count as 0
_WIDEST = 2.0  # largest factor on columns of a covariance
#: Error over variance above which there is no surface.
NO_SURFACE = 1.0
_EXACT = 0.01  # error over variance below which samples may leave the neighbourhood of rollouts
_MOMENT_POINTS = 512  # for moments of surfaces and of flights


class Group(NamedTuple):
    """Moving bodies that met, directly or through others, in any of the rollouts."""

    key: bytes  # the same for rollouts in which the same bodies met the same things
    bodies: np.ndarray  # (m,) int
    #: (d,) int: the numbers z that determine the outcome: first those of the root, then ``parameters`` others
    columns: np.ndarray
    parameters: int
    root: np.ndarray  # (12 m, d - parameters)
    alone: bool  # whether they met nothing besides each other
    flew: bool  # whether this is a body without contacts that was not moved at the start


@dataclass(frozen=True, eq=False)
class GroupFit:
    """Surface of a group, for all times at which the same bodies have met, and matrices of its moments."""

    reduced: Reduction | None  # of a group that is alone
    transform: np.ndarray  # (d, d'): from the group's numbers z to the surface's coordinates
    x: np.ndarray  # (N, d'): the rollouts in these
    points: np.ndarray  # (S, d): the group's numbers z of the points that moments are taken over
    surface: ResponseSurface

    @cached_property
    def map(self) -> np.ndarray:
        """(S, n): from outcomes of the first n rollouts to the surface at `points`."""
        # einsum, not BLAS, whose threads wait for each other
        at = np.einsum("sr,rk->sk", self.points, self.transform)
        return smoother(self.surface, self.columns, at)[0]

    @cached_property
    def columns(self) -> np.ndarray:
        """(d', N): `x`, transposed."""
        return np.ascontiguousarray(self.x.T)

    @cached_property
    def mean_row(self) -> np.ndarray:
        """(N,): as in `response_surface.surface_moments`."""
        here = smoother(self.surface, self.columns, self.x)[0]
        row = np.full(len(self.x), 1.0 / len(self.x))
        row[: self.map.shape[1]] += self.map.mean(axis=0) - here.mean(axis=0)
        return row

    @cached_property
    def root(self) -> np.ndarray:
        """(r, n): as in `response_surface.surface_moments`."""
        # a kernel, not LAPACK, whose threads wait for each other
        root, _ = pivoted_cholesky(second_moment(self.map - self.map.mean(axis=0)), _RANK)
        return np.ascontiguousarray(root.T)


@dataclass(frozen=True, eq=False)
class Moments:
    """A group's rollouts at one time, with moments that are computed when they are used."""

    group: Group
    fit: GroupFit
    mean: np.ndarray  # (m, 13): of the rollouts' outcomes, without common motion
    errors: np.ndarray  # (N, 12 m): outcomes about it
    #: (n, 12 m): differences of the first n rollouts from a surface through the others
    left_out: np.ndarray
    error: float  # mean square of these over the variance, in outcomes by their spread

    @property
    def has_surface(self) -> bool:
        """Whether the surface explains more than the rollouts' mean."""
        return self.error < NO_SURFACE

    @property
    def shift(self) -> np.ndarray:
        """(12 m,): mean over all outcomes, from that of the rollouts."""
        return self._all[0]

    @property
    def covariance(self) -> np.ndarray:
        """(12 m, 12 m): without common motion."""
        return self._all[1]

    @property
    def factors(self) -> np.ndarray:
        """(12 m,): by which columns are scaled for the covariance."""
        return self._all[2]

    @cached_property
    def _all(self):
        size = self.errors.shape[1]
        if not self.has_surface:
            return np.zeros(size), second_moment(self.errors), np.ones(size)
        fitted = self.fit
        shift, P, _, factors = surface_moments(
            self.errors, fitted.surface.kriging, fitted.mean_row, fitted.root, _WIDEST
        )
        return shift, P, factors


class Shared(NamedTuple):
    """Groups and fits that all times of a prediction share."""

    groups: dict[bytes, list[Group]]  # by who has met whom
    fits: dict[bytes, GroupFit]  # by `Group.key`


class _Carry(NamedTuple):
    """Persistent state: the states of N rollouts, and their uncertain directions."""

    states: np.ndarray  # (N, B, 13): of the bodies' centres of mass, wherever those are uncertain
    contact_history: ContactHistory
    step: int  # how many are done
    #: (N, K): the rollouts' K uncertain parameters, in standard deviations from their values
    parameters: np.ndarray
    mean: np.ndarray  # (B, 13): at time 0
    #: (12 M, r): errors at time 0 that each of r independent standard normal numbers makes
    root: np.ndarray
    moving: np.ndarray  # (M,) int
    #: (r + K,) int: which column of the points each of these numbers, and then each parameter, is
    columns: np.ndarray
    #: (r + K,) bool: whether the rollouts differ in it; the others are common motions (`reduction`)
    simulated: np.ndarray
    seed: int  # of the points


class CloudCarry(_Carry):
    """Persistent state with caches of results, which a new carry does not have."""

    @cached_property
    def labels(self) -> np.ndarray:
        """(N, r + K): the standard normal numbers of each rollout, with those of common motions."""
        points = rollout_points(len(self.states), len(self.columns), self.seed)
        return points[:, self.columns]

    @cached_property
    def z(self) -> np.ndarray:
        """(N, r + K): the numbers that each rollout began with."""
        return np.where(self.simulated, self.labels, 0.0)

    @cached_property
    def points(self) -> np.ndarray:
        """(S, r + K): standard normal numbers that moments are taken over."""
        return emitted_points(_MOMENT_POINTS, len(self.columns), self.seed)[:, self.columns]

    @cached_property
    def shared(self) -> Shared:
        """Groups and fits."""
        return Shared({}, {})

    @cached_property
    def moments(self) -> dict[bytes, Moments]:
        """`Moments` of each group of bodies, by its key."""
        return {}

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """Other results, by their names and options."""
        return {}


#: Properties that all times of a prediction share.
SHARED = "labels", "z", "points", "shared"


def _key(seed, stream):
    """Return a seed of 63 bits for one of the two sets of points."""
    return (2 * seed + stream) % 2**63


def rollout_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Return the normal numbers (count, dimensions) of the rollouts; `normal_points` keeps the last ones."""
    return normal_points(count, dimensions, _key(seed, 0))


@lru_cache(maxsize=16)
def emitted_points(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Return the samples' normal numbers (count, dimensions), with mean 0 and covariance 1 to round-off.

    Means and covariances that a smooth surface preserves are therefore exact.
    """
    return whitened(normal_points(count, dimensions, _key(seed, 1)))


def belief_of(runs: CloudCarry, scene: Scene) -> Belief:
    """Return mean and covariance of all outcomes.

    The moments of a group that met something are those of its surface and its residuals. A body without
    contacts flies from ``points`` in closed form. Groups that depend on the same numbers are correlated by
    surface, flight and rollouts as functions of these numbers.
    """
    mean, moving = runs.mean.copy(), runs.moving
    if diverged(runs.states):
        return Belief.trusted(np.full_like(mean, np.nan), np.zeros((len(moving), ERROR, ERROR)), moving)
    groups = _groups(runs, scene)
    ends = _model_centers(runs, scene)
    used = np.concatenate([group.columns for group in groups]) if groups else np.empty(0, np.int64)
    joint = len(groups) > 1 and len(np.unique(used)) < len(used)
    several = any(len(group.bodies) > 1 for group in groups)
    size = ERROR * len(moving)
    P = np.zeros((size, size) if joint or several else (len(moving), ERROR, ERROR))
    parts = []
    for group in groups:
        bodies = group.bodies
        if group.flew:
            ended = _propagate_flights(runs, scene, group, _points_of(runs, group))
            own, errors = mean_and_errors(ended, np.arange(len(bodies)))
            covariance, along = second_moment(errors), (errors, np.zeros((len(runs.states), errors.shape[1])))
        elif _is_uncertain(scene, group):
            found = _moments(runs, scene, group, ends)
            own = spread_states(found.mean, np.arange(len(bodies)), found.shift[None])[0]
            covariance, along = found.covariance, _along(runs, scene, found) if joint else _UNCORRELATED
            reduced = found.fit.reduced
            if reduced is not None and reduced.common.shape[1]:
                course = course_of(scene, runs.step)
                covariance = covariance + common_covariance(reduced.motion, course, len(bodies))
        else:
            mean[bodies] = ends[0, bodies]
            continue
        mean[bodies] = own
        if len(bodies) == len(moving):
            P = covariance.reshape(P.shape)
            continue
        rows = (ERROR * np.searchsorted(moving, bodies)[:, None] + np.arange(ERROR)).ravel()
        if P.ndim == 3:
            P[np.searchsorted(moving, bodies)] = covariance
            continue
        P[np.ix_(rows, rows)] = covariance
        for other_rows, (other, other_rest) in parts:  # none but where they are joint
            between, rest = along
            count = min(len(rest), len(other_rest))
            cross = between.T @ other / len(between) + rest[:count].T @ other_rest[:count] / count
            P[np.ix_(rows, other_rows)], P[np.ix_(other_rows, rows)] = cross, cross.T
        if joint:
            parts.append((rows, along))
    return Belief.trusted(mean, P, moving)


def _points_of(runs, group):
    """Return the numbers (S, d) over which a group's moments are taken, with mean 0 and covariance 1."""
    own = runs.points[:, group.columns]
    return own if len(own) >= 4 * runs.points.shape[1] else whitened(own)


def whitened(z: np.ndarray) -> np.ndarray:
    """Return numbers (S, d) with mean 0 and covariance 1 to round-off; few numbers stay unchanged."""
    count, size = z.shape
    if count < 4 * size or not size:
        return z
    z = z - z.mean(axis=0)
    # einsum, as threads of BLAS wait for each other, which takes ten times as long on a busy machine
    L = np.linalg.cholesky(np.einsum("nr,nk->rk", z, z) / count)
    return np.einsum("nr,kr->nk", z, np.linalg.inv(L))


def _along(runs, scene, found):
    """Return a group's surface about its mean (S, 12 m), and residuals of the rollouts (n, 12 m)."""
    if not found.has_surface:
        return np.zeros((len(runs.points), found.errors.shape[1])), found.errors
    count = len(found.left_out)
    at = np.einsum("sn,nk->sk", found.fit.map, found.errors[:count])
    at = (at - at.mean(axis=0)) * found.factors
    reduced = found.fit.reduced
    if reduced is not None and reduced.common.shape[1]:
        motion = (_points_of(runs, found.group) @ reduced.common) @ reduced.motion.T
        course, parts = course_of(scene, runs.step), at.reshape(len(at), -1, ERROR)
        parts[:, :, ERR_POSITION] += (motion[:, :3] + course.reach * motion[:, 3:])[:, None]
        parts[:, :, ERR_VELOCITY] += (course.decay * motion[:, 3:])[:, None]
    return at, found.left_out * found.factors


def emitted(runs: CloudCarry, scene: Scene, z: np.ndarray) -> np.ndarray:
    """Return states (S, B, 13) of the models' centres of mass for standard normal numbers ``z`` (S, r + K).

    A sample of a group that met something is the outcome of the nearest rollout, moved by the surface.
    A sample that penetrates deeper than all rollouts is replaced by the nearest rollout, except with the
    explicit integrator, whose contacts are soft.
    """
    states = np.tile(runs.mean, (len(z), 1, 1))
    if diverged(runs.states):
        return np.full_like(states, np.nan)
    ends = _model_centers(runs, scene)
    near = np.full((len(z), len(runs.mean)), -1)
    for group in _groups(runs, scene):
        if group.flew:
            states[:, group.bodies] = _propagate_flights(runs, scene, group, z[:, group.columns])
        elif _is_uncertain(scene, group):
            found = _moments(runs, scene, group, ends)
            states[:, group.bodies], own = _sampled(runs, scene, found, z)
            near[:, group.bodies] = own[:, None]
        else:
            states[:, group.bodies] = ends[:1, group.bodies]
    if scene.integrator != "explicit" and (near >= 0).any():
        _replace_penetrating(states, ends, near, scene)
    return states


def _replace_penetrating(states, ends, near, scene):
    """Replace samples that penetrate deeper than all rollouts by rollouts, in place.

    Bodies of one group are replaced together. Bodies of two groups have not met, so a sample in which they
    overlap takes the nearest rollout for both.
    """
    bodies = np.flatnonzero((near >= 0).any(axis=0))
    deepest = overlaps(scene, ends)[0].max(axis=0) + OVERLAP_TOLERANCE
    for _ in range(len(bodies)):
        wrong = (overlaps(scene, states)[0] > deepest) & (near >= 0)
        some = np.flatnonzero(wrong.any(axis=1))
        if not len(some):
            break
        for s in some.tolist():
            own = near[s]
            for n in np.unique(own[wrong[s]]).tolist():
                which = np.flatnonzero(own == n)
                states[s, which] = ends[n, which]
                near[s, which] = -1


def labelled(runs: CloudCarry, scene: Scene) -> np.ndarray:
    """Return the rollouts' states (N, B, 13) of the models' centres of mass, as equally probable outcomes.

    Common motion that was not simulated is added in closed form, by the points' own numbers.
    """
    states = _model_centers(runs, scene)
    size = runs.root.shape[1]
    if runs.simulated.all() or diverged(states):
        return states
    states = states.copy()
    z = np.where(runs.simulated, 0.0, runs.labels)[:, :size]
    errors = np.einsum("nr,kr->nk", z, runs.root).reshape(len(z), -1, ERROR)[:, 0]
    motion = np.concatenate([errors[:, ERR_POSITION], errors[:, ERR_VELOCITY]], axis=1)
    moved_in_common(states, motion, course_of(scene, runs.step))
    return states


def diverged(states: np.ndarray) -> bool:
    """Return whether states (N, B, 13) are not finite, or too large to be squared."""
    return not (np.abs(states) < _DIVERGED).all()


def moments(runs: CloudCarry, scene: Scene) -> Iterator[Moments]:
    """Yield the `Moments` of each group whose rollouts differ, except bodies in free flight."""
    ends = _model_centers(runs, scene)
    for group in _groups(runs, scene):
        if not group.flew and _rollouts_differ(runs, scene, group):
            yield _moments(runs, scene, group, ends)


def settled(runs: CloudCarry, scene: Scene) -> bool:
    """Return whether everything is known in closed form, so that more rollouts would change nothing."""
    return all(group.flew or not _rollouts_differ(runs, scene, group) for group in _groups(runs, scene))


def _is_uncertain(scene, group):
    """Return whether a group has several outcomes; these may differ in the common motion alone."""
    return len(group.columns) > 0 or scene.draws_impacts


def _rollouts_differ(runs, scene, group):
    """Return whether the rollouts of a group, which lack the common motion, have several outcomes."""
    return bool(runs.z[:, group.columns].any()) or scene.draws_impacts


def _model_centers(runs, scene):
    """Return the states (N, B, 13) of the points of beliefs."""
    return moved_along(runs.states, -center_offsets(scene, runs.parameters))


def _groups(runs, scene):
    """Return the groups of all moving bodies."""
    first, start = runs.contact_history.first_time, runs.contact_history.start
    met = np.isfinite(first).any(axis=0)
    moved = np.zeros(len(runs.mean), bool) if start is None else (start.moved > 0.0).any(axis=0)
    tilted = any(p.name == "gravity_direction" for p in scene.uncertain)
    no_closed_form = runs.step > 0 and (tilted or scene.gyroscopic or scene.acts)
    key = met.tobytes() + moved.tobytes() + bytes([no_closed_form])
    if key not in runs.shared.groups:
        runs.shared.groups[key] = list(_divided(runs, scene, met, moved, no_closed_form))
    return runs.shared.groups[key]


def _divided(runs, scene, met, moved, no_closed_form):
    """Return the groups from the contacts (B, B + E) and the bodies moved at the start (B,)."""
    count, size = len(runs.mean), runs.root.shape[1]
    movable = np.zeros(count, bool)
    movable[runs.moving] = True
    between = (met[:, :count] | met[:, :count].T) & movable & movable[:, None]
    others = met[:, count:].any(axis=1) | ((met[:, :count] | met[:, :count].T) & ~movable).any(axis=1)
    roots = runs.root.reshape(len(runs.moving), ERROR, size)
    common = {*range(count + len(scene.environment)), -1} - set(runs.moving.tolist())
    left = set(runs.moving.tolist())
    while left:
        found = [min(left)]
        for k in found:
            found += [b for b in np.flatnonzero(between[k]).tolist() if b in left and b not in found]
        left.difference_update(found)
        bodies = np.array(sorted(found))
        root = roots[np.isin(runs.moving, bodies)]
        used = np.flatnonzero(root.any(axis=(0, 1)))
        # surfaces, the scene and prescribed bodies belong to all groups
        known = {*bodies.tolist(), *common}
        extra = [size + c for c, parameter in enumerate(scene.uncertain) if parameter.body in known]
        columns = np.concatenate([used, np.array(extra, np.int64)])
        # drag depends on the velocity in the world; removal of overlap does not notice a common motion, where
        # there are bodies only
        bound = others if symmetric(scene) else others | moved
        alone = not bound[bodies].any() and not any(scene.bodies[k].drag for k in found)
        flew = alone and len(bodies) == 1 and not moved[bodies].any() and not no_closed_form
        root = np.ascontiguousarray(root[:, :, used].reshape(ERROR * len(bodies), len(used)))
        key = bodies.tobytes() + met[bodies].tobytes() + met[:, bodies].tobytes() + bytes([alone, flew])
        yield Group(key, bodies, columns, len(extra), root, alone, flew)


def _propagate_flights(runs, scene, group, z):
    """Return the states (S, 1, 13) of a body without contacts, for its numbers ``z`` (S, d)."""
    own = z[:, : group.root.shape[1]]
    states = spread_states(runs.mean[group.bodies], np.arange(1), np.einsum("sr,kr->sk", own, group.root))
    course = course_of(scene, runs.step)
    parameters = np.zeros((len(z), runs.parameters.shape[1]))
    parameters[:, group.columns[group.root.shape[1] :] - runs.root.shape[1]] = z[:, group.root.shape[1] :]
    offsets = center_offsets(scene, parameters)
    if not offsets.shape[1]:
        propagate_flight(states, scene.gravity, course)
        return states
    offsets = offsets[:, group.bodies]
    states = moved_along(states, offsets)
    propagate_flight(states, scene.gravity, course)
    return moved_along(states, -offsets)


def _meetings(runs, group):
    """Return the contacts of a group, with median times and shares of rollouts (`impact_metric`)."""
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


def _moments(runs, scene, group, ends):
    """Return a group's cached `Moments`, which belief, standard errors and status share."""
    if group.key not in runs.moments:
        runs.moments[group.key] = _moments_of(runs, scene, group, ends[:, group.bodies])
    return runs.moments[group.key]


def _moments_of(runs, scene, group, ends):
    """Return the `Moments` of a group's outcomes (N, m, 13), by another time's surface if there is one."""
    fitted = runs.shared.fits.get(group.key)
    reduced = fitted.reduced if fitted is not None else None
    own = runs.z[:, group.columns]
    if fitted is None and group.alone:
        reduced = reduction(group.root, group.parameters)
    if reduced is not None and reduced.common.shape[1]:
        ends = ends.copy()
        moved_in_common(ends, -(own @ reduced.common) @ reduced.motion.T, course_of(scene, runs.step))
    mean, errors = mean_and_errors(np.ascontiguousarray(ends), np.arange(len(group.bodies)))
    weights = _weights(errors, scene.radii[group.bodies])
    if fitted is None or len(fitted.x) != len(errors):
        fitted = runs.shared.fits[group.key] = _fit(runs, scene, group, reduced, errors * weights)
    surface = fitted.surface
    count = len(surface.kriging)
    left_out = solve(surface.kriging, surface.coefficients, errors[:count])[2]
    return Moments(group, fitted, mean, errors, left_out, _error(errors, left_out, weights))


@kernel
def _error(outcomes, left_out, weights):
    """Return the weighted mean square of left-out errors (n, K) over the variance of outcomes (N, K)."""
    count, spread, rest = len(left_out), 0.0, 0.0
    for c in range(len(weights)):
        mean = 0.0
        for n in range(count):
            mean += outcomes[n, c] / count
        square = weights[c] ** 2
        for n in range(count):
            spread += square * (outcomes[n, c] - mean) ** 2
            rest += square * left_out[n, c] ** 2
    spread *= (count / max(count - 1, 1)) ** 2
    return rest / spread if spread > 0.0 else 0.0


def _fit(runs, scene, group, reduced, scaled):
    """Return a group's `GroupFit` through its scaled outcomes (N, 12 m)."""
    d = len(group.columns)
    relative = np.eye(d) if reduced is None else reduced.relative
    own = runs.z[:, group.columns]
    root = group.root @ relative[: d - group.parameters, : relative.shape[1] - group.parameters]
    to_metric = impact_metric(scene, runs.mean, root, group.bodies, _meetings(runs, group), group.parameters)
    transform = relative @ to_metric
    x = np.ascontiguousarray(own @ transform)
    surface = fit(x, scaled)
    to_slopes = active_directions(surface)
    again = np.ascontiguousarray(x @ to_slopes)
    other = fit(again, scaled, surface)
    if other.error < surface.error:
        transform, x, surface = transform @ to_slopes, again, other
    return GroupFit(reduced, transform, x, _points_of(runs, group), surface)


@kernel
def _weights(errors, radius):
    """Return factors (12 m,) that scale each block of outcomes (N, 12 m) by its spread; 0 for constants.

    Spreads as small as those of bodies at rest on their contacts have no surface, and count less.
    """
    weights = zeros(errors.shape[1])
    for body in range(len(radius)):
        for begin, weight, in_radii, floor in _WEIGHTS:
            first, total = ERROR * body + begin, 0.0
            for n in range(len(errors)):
                for c in range(first, first + 3):
                    total += errors[n, c] ** 2
            spread = math.sqrt(total / len(errors))
            if spread > _CONSTANT * (radius[body] if in_radii else 1.0):
                for c in range(first, first + 3):
                    weights[c] = weight / max(spread, floor)
    return weights


def _sampled(runs, scene, found, z):
    """Return states (S, m, 13) of bodies that met something, and the nearest rollouts (S,).

    The indices are -1 for rollouts themselves. Their mean, and their variance in each block, equal those of
    `Moments`: a surface through few rollouts varies less than outcomes do.
    """
    group, errors, reduced = found.group, found.errors, found.fit.reduced
    own = np.ascontiguousarray(z[:, group.columns])
    if not found.has_surface:  # the rollouts as they are, each as often
        near = np.arange(len(z)) % len(errors)
        made, changed = errors[near], np.full(len(z), -1)
    else:
        fitted, count = found.fit, len(found.left_out)
        columns = fitted.columns
        at, near = smoother(fitted.surface, columns, np.einsum("sr,rk->sk", own, fitted.transform))
        here = smoother(fitted.surface, columns, fitted.x)[0]
        changes = np.einsum("sn,nk->sk", at - here[near], errors[:count])
        if found.error > _EXACT:
            changes = _changes(changes, errors, near)
        made, changed = errors[near] + changes, near
        wanted = found.covariance.diagonal().reshape(-1, 3).sum(axis=1)
        varied = variances(made).reshape(-1, 3).sum(axis=1)
        share = np.divide(wanted, varied, out=np.ones_like(wanted), where=varied > 0.0)
        spread(made, np.repeat(np.clip(np.sqrt(share), 1.0 / _WIDEST, _WIDEST), 3))
        made += found.shift - made.mean(axis=0)
    states = spread_states(found.mean, np.arange(len(group.bodies)), made)
    if reduced is not None and reduced.common.shape[1]:
        moved_in_common(states, (own @ reduced.common) @ reduced.motion.T, course_of(scene, runs.step))
    return states, changed


def _changes(changes, errors, near):
    """Return changes (S, 12 m) from the nearest rollout, at most as large as those to other rollouts."""
    for first in range(0, errors.shape[1], ERROR):
        for block, also in _CLIPPED:
            limit = reach(errors, first + block, 3)
            clip(changes, first + block, 3, first + also, limit[near])
    return changes
