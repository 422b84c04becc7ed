"""Motion during one explicit step of things that meet, which states at the ends of steps need not show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..propagators.balanced_monte_carlo import BalancedMonteCarlo
from ..propagators.overlap_depths import find_meetings
from ..propagators.start import constrain_belief
from ..scene.belief import Belief
from ..scene.marks import whole
from ..scene.scene import Scene
from ..spatial.layout import ANGULAR_VELOCITY, POSITION, VELOCITY

#: Relative travel in a step, over the sum of both thicknesses, or rotation in it [rad], up to which contacts
#: are seen.
MOST_MOTION = 0.5
_STEPS_AT_ONCE, _PAIRS_AT_ONCE = 200, 200_000  # steps, and these times rollouts and pairs
_ROUND = (
    1e-3  # of the radius, by which the spheres of a body extend beyond one about its centre if it is round
)


class Span(NamedTuple):
    """A time until which motion is judged."""

    steps: int  # number of steps until then
    speed: np.ndarray  # (B,): highest expected speed of each body [m/s]
    spin: np.ndarray  # (B,): highest expected angular speed [rad/s]


class _Pairs(NamedTuple):
    """Pairs of things that may meet, of which at least one moves.

    ``first`` and ``second`` (P,) are as in `find_meetings`. ``thickness`` and ``reach`` (P,) are the sums of
    both thicknesses, and of the bounding radii of bodies [m].
    """

    first: np.ndarray
    second: np.ndarray
    thickness: np.ndarray
    reach: np.ndarray


def motion_in_meetings(
    scene: Scene,
    initial: Belief,
    radii: np.ndarray,
    largest: np.ndarray,
    rollouts: int,
    spans: Sequence[Span],
) -> list[np.ndarray | None]:
    """Return travel and rotation of each body in a step in which it meets something, at several times.

    Rollouts are simulated step by step. Of each pair, the first meeting counts at which one of the limits is
    exceeded.

    Parameters
    ----------
    scene : Scene
        With the explicit integrator.
    initial : Belief
    radii, largest : (B,) array
        Bounding radius and radius of the largest sphere of each body [m].
    rollouts : int
    spans : sequence of Span
        Times in ascending order. Their speeds have no effect in scenes with actions.

    Returns
    -------
    list of (B, 2) array or None
        At each time relative travel over the thickness, and rotation [rad]; 0 within the limits. None if
        nothing is fast enough to exceed one.
    """
    pairs, turning = _pairs_of(scene, radii, largest), radii - largest > _ROUND * radii
    fast = np.array([_is_fast(pairs, scene, span.speed, span.spin * turning) for span in spans])
    some = fast.any(axis=0)
    if not some.any():
        return [None] * len(spans)
    pairs, fast = _select(pairs, some), fast[:, some]
    step, motion = _first_meetings(scene, initial, pairs, turning, rollouts, spans[-1].steps)
    found: list[np.ndarray | None] = []
    for own, span in zip(fast, spans, strict=True):
        own_motion = np.zeros((len(radii), 2))
        for bodies in (pairs.first, pairs.second):
            met = own & (step <= span.steps) & (bodies >= 0)
            np.maximum.at(own_motion, bodies[met], motion[met])
        found.append(own_motion if own.any() else None)
    return found


def _pairs_of(scene, radii, largest):
    """Return the pairs of a scene.

    The thickness of a body is the diameter of its largest sphere, that of an element its least extent.
    """
    thickness = 2.0 * largest
    i, j = np.triu_indices(len(radii), 1)
    still = np.array([body.fixed for body in scene.bodies])
    some = ~(still[i] & still[j])
    i, j = i[some], j[some]
    own, e = np.divmod(np.arange(len(radii) * len(scene.environment)), max(len(scene.environment), 1))
    own, e = own[~still[own]], e[~still[own]]
    least = np.array([np.min(np.subtract(*element.bounds[::-1])) for element in scene.environment])
    return _Pairs(
        np.concatenate([i, own]),
        np.concatenate([j, -1 - e]),
        np.concatenate([thickness[i] + thickness[j], thickness[own] + (least[e] if len(e) else 0.0)]),
        np.concatenate([radii[i] + radii[j], radii[own]]),
    )


def _select(pairs, some):
    return _Pairs(*(values[some] for values in pairs))


def _of_both(pairs, values):
    """Return values (..., B) of both things of each pair (..., P); those of elements are 0."""
    padded = np.concatenate([values, np.zeros((*values.shape[:-1], 1))], axis=-1)
    return padded[..., pairs.first], padded[..., np.maximum(pairs.second, -1)]


def _is_fast(pairs, scene, speeds, spins):
    """Return which pairs (P,) may exceed a limit at these highest speeds (B,); all in scenes with actions."""
    travel, turn = (
        scene.dt * of(*_of_both(pairs, all)) for of, all in ((np.add, speeds), (np.maximum, spins))
    )
    return (travel > MOST_MOTION * pairs.thickness) | (turn > MOST_MOTION) | scene.acts


def _first_meetings(scene, initial, pairs, turning, rollouts, steps):
    """Return in which step (P,) each pair first meets with an exceeded limit, and its motion (P, 2) in it."""
    propagator = BalancedMonteCarlo(samples=rollouts)
    carry = propagator.init(scene, constrain_belief(scene, initial))
    met_in, motion = np.full(len(pairs.first), np.inf), np.zeros((len(pairs.first), 2))
    size = np.minimum(pairs.thickness, 2.0 * pairs.reach)
    piece = min(max(_PAIRS_AT_ONCE // (rollouts * len(size)), 1), _STEPS_AT_ONCE)
    for done in range(0, steps, piece):
        left = np.flatnonzero(np.isinf(met_in))
        if not len(left):
            break
        marks = [whole(step, scene.dt) for step in range(done + 1, min(done + piece, steps) + 1)]
        carries = propagator.advance_through(carry, scene, marks)
        before = np.stack([propagator.own_samples(one, scene) for one in (carry, *carries[:-1])])
        own, near = _motion(scene, before, _select(pairs, left), turning)
        step, rollout, pair = np.nonzero(near)
        found = np.full(len(left), -1)
        find_meetings(
            before[step, rollout],
            pair,
            pairs.first[left],
            pairs.second[left],
            size[left],
            scene.world,
            scene.world.environment,
            found,
        )
        met = np.flatnonzero(found >= 0)
        at = found[met]
        met_in[left[met]] = done + step[at] + 1
        motion[left[met]] = own[step[at], rollout[at], met]
        carry = carries[-1]
    return met_in, motion


def _motion(scene, states, pairs, turning):
    """Return the motion (T, N, P, 2) of pairs in the step after states (T, N, B, 13), and where it matters.

    It does where it exceeds a limit, and the bounding balls may overlap during the step: (T, N, P).
    """
    dt, i, j = scene.dt, pairs.first, pairs.second
    pair = j >= 0
    velocity, position = states[..., i, VELOCITY], states[..., i, POSITION]
    velocity[..., pair, :] -= states[..., j[pair], VELOCITY]
    position[..., pair, :] -= states[..., j[pair], POSITION]
    way = dt * np.linalg.norm(velocity, axis=-1)
    spins = turning * np.linalg.norm(states[..., ANGULAR_VELOCITY], axis=-1)
    travel, turn = way / pairs.thickness, dt * np.maximum(*_of_both(pairs, spins))
    nearest = -(position * velocity).sum(axis=-1) / np.maximum((velocity**2).sum(axis=-1), 1e-300)
    distance = np.linalg.norm(position + np.clip(nearest, 0.0, dt)[..., None] * velocity, axis=-1)
    for p in np.flatnonzero(~pair):
        distance[..., p] = scene.environment[-1 - j[p]].surface(states[..., i[p], POSITION])[0] - way[..., p]
    fast = (travel > MOST_MOTION) | (turn > MOST_MOTION)
    return np.stack([travel, turn], axis=-1), fast & (distance < pairs.reach)
