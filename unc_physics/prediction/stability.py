"""Stability: does a body stay where it is?"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from ..checks.errors import InvalidRequestError, NotSupportedError
from ..checks.names import hint
from ..checks.validation import positive, share
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..propagators.start import constrain_belief
from ..scene.belief import Belief
from ..scene.contact_world import contact_table, materials_of_pairs
from ..scene.environment import thing_names
from ..scene.scene import Scene
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, QUATERNION, VELOCITY
from .events import REST_ANGULAR_SPEED, REST_SPEED, up_of
from .probability import interval
from .request_checks import check_supported, marks_of

_CHECKS = 8  # evenly spaced times at which the body must be where it was
_PORTIONS = 32, 32, 64  # rollouts, one portion after the other
_HALF_WIDTH = 0.03  # of an interval that needs no more rollouts
_SIGMAS = 3.0  # standard deviations by which coming to rest may move a body
_UPWARD = 0.5  # cosine of the steepest slope of a support


@dataclass(frozen=True)
class Stability:
    """Whether a body stays where it is.

    Attributes
    ----------
    probability, low, high : float
        That it stays, and its confidence interval.
    supports : tuple of str
        Names of the bodies and elements that it rests on.
    distance_margin : float or None
        How far the centre of mass may shift horizontally before the body tips [m], in the worst direction; 0
        where it tips already, None where it rests on nothing.
    angle_margin : float or None
        How far body and support may be tilted before the body tips or slides [rad], likewise.
    rollouts : int
    """

    probability: float
    low: float
    high: float
    supports: tuple[str, ...]
    distance_margin: float | None
    angle_margin: float | None
    rollouts: int


def assess_stability(
    scene: Scene,
    belief: Belief,
    body: str,
    duration: float = 2.0,
    distance: float = 0.01,
    angle: float = math.radians(5.0),
    confidence: float = 0.95,
    seed: int = 0,
) -> Stability:
    """Return how probable it is that a body stays where it is for a time.

    It stays if its centre of mass moves less than a distance and it turns less than an angle. Bodies that are
    slower than rest are taken as ``at_rest``: height and tilt come from contact.

    Parameters
    ----------
    scene : Scene
        With the implicit integrator.
    belief : Belief
    body : str
        Name of a body that moves freely.
    duration : float
        [s]
    distance, angle : float
        [m], [rad]
    confidence : float
        Of the interval, between 0 and 1. It covers the limited number of rollouts, 128 at most.
    seed : int

    Raises
    ------
    InvalidRequestError, NotSupportedError
        For an unknown or kinematic body, other arguments that are invalid, and the explicit integrator.

    Notes
    -----
    Margins are those of statics at the mean, without uncertain parameters: of the centre of mass above the
    hull of the points of contact, and of the friction angle above the slope.
    """
    if scene.integrator == "explicit":
        raise NotSupportedError("has no rest; 'implicit' has", field="integrator", value=scene.integrator)
    names = [one.name for one in scene.bodies]
    if body not in names:
        raise InvalidRequestError(f"is no body of the scene{hint(body, names)}", field="body", value=body)
    b = names.index(body)
    if not scene.bodies[b].free:
        raise InvalidRequestError("must move freely", field="body", value=body)
    duration, distance = positive(duration, "duration"), positive(distance, "distance")
    angle, confidence = positive(angle, "angle"), share(confidence, "confidence")
    if not 0.0 < confidence < 1.0:
        raise InvalidRequestError("must be between 0 and 1", field="confidence", value=confidence)
    belief.check_fits(scene)
    scene, belief = _at_rest(scene, belief)
    quantile = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    std = np.sqrt(belief.marginal(b).diagonal())
    settled_by = distance + _SIGMAS * std[:3].max(), angle + _SIGMAS * std[6:9].max()
    stays = _stays(scene, belief, b, duration, (distance, angle), settled_by, quantile, seed)
    found = float(stays.mean())
    low, high = interval(found, len(stays), quantile)
    supports, shift, tilt = _margins(scene, belief, b, settled_by)
    return Stability(found, low, high, supports, shift, tilt, len(stays))


def _at_rest(scene, belief):
    """Return the scene and the belief with bodies that are slower than rest ``at_rest``."""
    if not scene.gravity.any():
        return scene, belief
    mean, bodies = belief.mean.copy(), list(scene.bodies)
    for k, one in enumerate(bodies):
        slow = np.linalg.norm(mean[k, VELOCITY]) < REST_SPEED
        if one.free and slow and np.linalg.norm(mean[k, ANGULAR_VELOCITY]) < REST_ANGULAR_SPEED:
            mean[k, VELOCITY] = mean[k, ANGULAR_VELOCITY] = 0.0
            bodies[k] = one if one.at_rest or one.attached_to else replace(one, at_rest=True)
    return replace(scene, bodies=bodies), Belief.trusted(mean, belief.covariance, belief.moving)


def _stays(scene, belief, b, duration, limits, settled_by, quantile, seed):
    """Return whether body b stays in each of several rollouts (N,)."""
    most = sum(_PORTIONS)
    propagator: Any = make_propagator(REFERENCE, samples=most, seed=seed)
    check_supported(scene, propagator)
    marks = marks_of(scene, None, (duration * np.arange(1, _CHECKS + 1) / _CHECKS).tolist())
    start = constrain_belief(scene, belief)
    drawn = propagator.drawn(scene, start, most)
    found = np.zeros(0, bool)
    for count in _PORTIONS:
        first = len(found)
        carry = propagator.start_rollouts(scene, start, drawn[first : first + count], first)
        begun = propagator.own_samples(carry, scene)[:, b]
        stays = _near(drawn[first : first + count, b], begun, *settled_by)
        for reached in propagator.advance_through(carry, scene, marks):
            stays &= _near(begun, propagator.own_samples(reached, scene)[:, b], *limits)
        found = np.concatenate([found, stays])
        low, high = interval(float(found.mean()), len(found), quantile)
        if high - low < 2.0 * _HALF_WIDTH:
            break
    return found


def _near(states, later, distance, angle):
    """Return whether states (N, 13) are as close as a distance and an angle to later ones."""
    apart = np.linalg.norm(later[:, POSITION] - states[:, POSITION], axis=1)
    cosine = np.abs(np.einsum("ni,ni->n", states[:, QUATERNION], later[:, QUATERNION]))
    return (apart < distance) & (2.0 * np.arccos(np.minimum(cosine, 1.0)) < angle)


def _margins(scene, belief, b, settled_by):
    """Return the names of the supports, and the margins of the centre of mass [m] and of a tilt [rad]."""
    no_stds = {"mass_std": 0.0, "center_of_mass_std": (0.0, 0.0, 0.0)}
    certain = replace(scene, bodies=[replace(one, **no_stds) for one in scene.bodies])
    exact = Belief.trusted(belief.mean, np.zeros_like(belief.covariance), belief.moving)
    propagator: Any = make_propagator(REFERENCE, samples=1)
    start = constrain_belief(certain, exact)
    carry = propagator.start_rollouts(certain, start, propagator.drawn(certain, start, 1), 0)
    x = propagator.own_samples(carry, certain)[0, b]
    if not _near(exact.mean[b][None], x[None], *settled_by)[0]:
        return (), None, None
    (carry,) = propagator.advance_through(carry, certain, marks_of(certain, scene.dt, None))
    rows = contact_table(certain, carry.contact_history)
    rows = rows[(rows["first"] == b) | (rows["second"] == b)]
    up = up_of(scene)
    side = np.where(rows["second"] == b, 1.0, -1.0)  # normals towards the body
    normals = side[:, None] * rows["normal"]
    partners = np.where(rows["second"] == b, rows["first"], rows["second"])
    bears = normals @ up > _UPWARD
    points, normals, partners = rows["point"][bears], normals[bears], partners[bears]
    if not len(points):
        return (), None, None
    names = thing_names(scene)
    supports = tuple(names[k] for k in dict.fromkeys(partners.tolist()))
    shift, tip = _tipping(points - x[POSITION], up)
    materials = materials_of_pairs(scene, [(b, int(k)) for k in partners])
    slope = math.acos(min(1.0, float(normals.mean(axis=0) @ up / np.linalg.norm(normals.mean(axis=0)))))
    slide = min(math.atan(own["friction"]) for own in materials) - slope
    return supports, shift, max(0.0, min(tip, slide))


def _tipping(arms, up):
    """Return how far the origin is inside of the hull of points below it, and the tilt to its edge.

    Parameters
    ----------
    arms : (n, 3) array
        Points of contact from the centre of mass [m].
    up : (3,) array
    """
    across = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    flat = arms @ np.stack([across, np.cross(up, across)], axis=1)
    angles = np.sort(np.arctan2(flat[:, 1], flat[:, 0]))
    gaps = np.diff(np.concatenate([angles, angles[:1] + 2.0 * math.pi]))
    if gaps.max() >= math.pi:  # all points are on one side
        return 0.0, 0.0
    found = [
        _edge(flat[i], flat[j], -arms[[i, j]] @ up)
        for i in range(len(flat))
        for j in range(i)
        if _is_edge(flat, i, j)
    ]
    return min(d for d, _ in found), min(tilt for _, tilt in found)


def _is_edge(flat, i, j):
    """Return whether the line through two points has all others on one side."""
    along = flat[j] - flat[i]
    if not along.any():
        return False
    sides = along[0] * (flat[:, 1] - flat[i, 1]) - along[1] * (flat[:, 0] - flat[i, 0])
    tolerance = 1e-9 * float(np.abs(flat).max()) * float(np.abs(along).max())
    return bool((sides >= -tolerance).all() or (sides <= tolerance).all())


def _edge(p, q, heights):
    """Return the distance of the origin from a line through two points (2,), and the tilt over it [rad]."""
    along = (q - p) / np.linalg.norm(q - p)
    d = abs(float(p[0] * along[1] - p[1] * along[0]))
    return d, math.atan2(d, float(heights.mean()))
