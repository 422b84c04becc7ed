"""Initial states of rollouts: drawn from a belief, moved out of overlap, and settled where bodies rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..checks.errors import LimitExceededError
from ..compiler.threads import in_threads
from ..compiler.time_limit import limited
from ..dynamics import contact_history as histories
from ..dynamics.actions import no_actions
from ..dynamics.contact_history import ContactHistory
from ..dynamics.implicit_world import rest_steps
from ..dynamics.rollout import rollout
from ..initialization.lowering import lower
from ..initialization.overlap_rows import Metric
from ..initialization.overlap_search import TOUCHING, sides_of
from ..initialization.projection import ProjectionInput, ProjectionOutput, project
from ..scene.action_arrays import held_at_start, kinematic_belief
from ..scene.belief import Belief
from ..scene.parameters import turned
from ..scene.scene import Scene
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
from ..spatial.rotation import rotation_matrix

_STEP = 1.0 / 60.0  # of bodies that come to rest [s]
_QUIET_TIME, _LONGEST = 0.15, 3.0  # for which bodies settle at first, and at most [s]
_TRIED, _ACCEPTANCE = 400, 0.05  # samples drawn at once, and the least share of them that must do
_ASLEEP = 0.1  # how long what has settled has not moved [s]
#: Of the height [m] and tilt [rad] of what is at rest: they come from contact, and no belief is surer of
# them.
_LEAST_STD, _LEAST_TILT = 5e-3, 0.03
_HONEST_STD = 3e-3  # of the height of what is at rest, of which being off is no news [m]


def constrain_belief(scene: Scene, belief: Belief) -> Belief:
    """Return the belief under the scene's constraints.

    Bodies at rest have no velocities, with certainty. Prescribed bodies are where their paths begin, and held
    bodies move with their holders.
    """
    if scene.acts:
        belief = kinematic_belief(scene, belief)
    resting = _resting(scene)
    if not resting.any():
        return belief
    mean = belief.mean.copy()
    mean[resting, VELOCITY] = mean[resting, ANGULAR_VELOCITY] = 0.0
    still = np.zeros((len(belief.moving), ERROR), bool)
    still[resting[belief.moving], ERR_VELOCITY] = still[resting[belief.moving], ERR_ANGULAR_VELOCITY] = True
    P = belief.covariance.copy()
    if belief.independent:
        P[still[:, :, None] | still[:, None, :]] = 0.0
    else:
        P[still.ravel()], P[:, still.ravel()] = 0.0, 0.0
    return Belief.trusted(mean, P, belief.moving)


def draw(scene: Scene, belief: Belief, count: int, seed: int) -> np.ndarray:
    """(count, B, 13): states drawn from a belief; without overlap where the scene rejects it.

    The first k of them are the same for every larger count.
    """
    rng = np.random.default_rng(seed)
    if scene.overlap != "reject":
        return belief.sample(count, rng)
    accepted, found, drawn = [], 0, 0
    while found < count:
        if drawn >= max(count, _TRIED) and found < _ACCEPTANCE * drawn:
            raise LimitExceededError(
                f"finds no overlap in only {found} of {drawn} samples, fewer than {_ACCEPTANCE:.0%}; take"
                " 'project'",
                field="overlap",
                value=scene.overlap,
            )
        states = belief.sample(max(count, _TRIED), rng)
        overlap = _look(scene, belief, states).overlap
        some = states[(overlap <= TOUCHING).all(axis=1)]
        accepted.append(some)
        found, drawn = found + len(some), drawn + len(states)
    return np.concatenate(accepted)[:count]


def resolve_initial_overlap(
    scene: Scene, belief: Belief, states: np.ndarray
) -> tuple[np.ndarray, ContactHistory]:
    """Move states (N, B, 13) that were drawn from a belief out of overlap, and let bodies at rest settle.

    The scene's ``overlap`` says whether what overlaps is projected away (`initialization.projection`); bodies
    ``at_rest`` then settle on what is below them. The belief is as `constrain_belief` returns it. The history
    that is returned with the states has the kept overlaps, and in ``start`` what was done.
    """
    world = scene.world
    history = histories.fresh(len(states), world)
    if world.implicit is None:
        return states, history
    resting = _resting(scene)
    if scene.overlap == "keep" and not resting.any():
        return states, history._replace(start=_look(scene, belief, states))
    states, drawn = states.copy(), states
    kept = np.zeros(history.first_time.shape, np.float32)
    metric = _metric(scene, belief)
    sides = _sides(scene, belief, metric)
    if scene.overlap != "keep":
        _project(scene, belief, metric, states, sides, history, kept)
    if resting.any():
        history = _settle(scene, belief, drawn, states, sides, history, kept, resting)
        if scene.overlap != "keep" and not resting[scene.moving].all():
            _project(scene, belief, metric, states, sides, history, kept, resting)
    if kept.any():
        history = history._replace(solver=history.solver._replace(kept_overlap=kept))
    return states, history


def move_out_of_overlap(
    scene: Scene, belief: Belief, states: np.ndarray, bodies: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Move some ``bodies`` of states (N, B, 13) out of overlap, at any time; the others stay where they are.

    The scene has the implicit integrator. The belief's covariance is the metric in which poses without
    overlap are the nearest. Returned are the states, and the overlaps (N, B, B + E) that could not come free
    [m].
    """
    states, history = states.copy(), histories.fresh(len(states), scene.world)
    kept = np.zeros(history.first_time.shape, np.float32)
    held = np.ones(len(scene.bodies), bool)
    held[list(bodies)] = False
    metric = _metric(scene, belief)
    _project(scene, belief, metric, states, _sides(scene, belief, metric), history, kept, held)
    return states, kept


def _resting(scene):
    """(B,) bool: which bodies stand still on something at time 0."""
    return np.array([body.at_rest for body in scene.bodies])


def _look(scene, belief, states):
    """The `InitialAdjustment` of states that stay as they are."""
    history: Any = histories.fresh(len(states), scene.world)
    kept = np.zeros(history.first_time.shape, np.float32)
    nowhere, metric = np.zeros((*kept.shape[1:], 3)), _metric(scene, belief)
    _project(scene, belief, metric, states, nowhere, history, kept, look_only=True)
    return history.start


def _sides(scene, belief, metric):
    """On which sides of each other the mean, without overlap, has the bodies (`overlap_search.sides_of`)."""
    mean = belief.mean[None].copy()
    history = histories.fresh(1, scene.world)
    kept = np.zeros(history.first_time.shape, np.float32)
    _project(scene, belief, metric, mean, np.zeros((*kept.shape[1:], 3)), history, kept)
    return sides_of(mean[0], limited(scene.world))


def _metric(scene, belief):
    """Return the covariance of possible poses: the belief's, with bodies at rest set free."""
    count = len(belief.moving)
    P = np.array(belief.joint).reshape(count, ERROR, count, ERROR)
    _free_resting(scene, belief, P)
    place = np.full(len(scene.bodies), -1)
    place[belief.moving] = np.arange(count)
    return Metric(P, np.abs(P).max(axis=(1, 3)) > 0.0, place)


def _project(scene, belief, metric, states, sides, history, kept, held=None, look_only=False):
    """Move states (N, B, 13) in place to where nothing overlaps; bodies that are ``held`` (B,) stay."""
    world, mean, own = limited(scene.world), belief.mean.copy(), held_at_start(scene)
    held = own if held is None else held | own
    if held.any():
        world = _without(world, held)
        metric = metric._replace(place=np.where(held, -1, metric.place))

    given = ProjectionInput(mean, metric, sides, look_only)

    def run(some):
        own: Any = histories.samples(history, some)
        project(states[some], given, ProjectionOutput(own.start, own.first_time, kept[some]), world)

    in_threads(len(states), run)


def _free_resting(scene, belief, P):
    """Let bodies at rest move up and tilt, however sure the belief is of their height and tilt."""
    for k, body in enumerate(belief.moving):
        if scene.bodies[body].at_rest:
            down, flat = _down(scene)
            up = np.outer(down, down)
            R = rotation_matrix(belief.mean[body, QUATERNION])
            P[k, ERR_POSITION, k, ERR_POSITION] += _LEAST_STD**2 * up
            P[k, ERR_ROTATION, k, ERR_ROTATION] += _LEAST_TILT**2 * R.T @ flat @ R


def _down(scene):
    """Direction of gravity (3,), and the projection (3, 3) on what is across it."""
    down = scene.gravity / np.linalg.norm(scene.gravity)
    return down, np.eye(3) - np.outer(down, down)


def _without(world, held):
    """The world in which some bodies (B,) do not move."""
    b = world.bodies
    inverse_mass, inverse_inertia = b.inverse_mass.copy(), b.inverse_inertia.copy()
    inverse_mass[held], inverse_inertia[held] = 0.0, 0.0
    bodies = b._replace(moving=b.moving & ~held, inverse_mass=inverse_mass, inverse_inertia=inverse_inertia)
    return world._replace(bodies=bodies)


def _settle(scene, belief, drawn, states, sides, history, kept, resting):
    """Let bodies come to rest in states (N, B, 13), in place; the others stay where they are.

    They sink first (`lowering.lower`), so that what lies across keeps its spread; then steps that each begin
    at rest find out what holds. Returns the history.
    """
    world = _without(limited(scene.world), ~resting)
    still, before = states.copy(), states[:, resting]
    still[..., VELOCITY] = still[..., ANGULAR_VELOCITY] = 0.0
    start = history.start

    def run(some):
        lower(still[some], sides, world, histories.samples(history, some).start, kept[some])

    in_threads(len(still), run)
    implicit = world.implicit._replace(rest_steps=rest_steps(_STEP))
    nobody_acts = world.environment._replace(actions=no_actions(states.shape[1]))
    creeping = world._replace(dt=_STEP, decay=0.0, implicit=implicit, environment=nobody_acts)
    memory = histories.fresh(len(still), world)
    if kept.any():
        memory = memory._replace(solver=memory.solver._replace(kept_overlap=kept.copy()))
    nothing_below = start.unsettled.any(axis=1)
    restless = np.flatnonzero(~nothing_below)
    time = _QUIET_TIME
    while len(restless) and time <= _LONGEST:
        some, own = still[restless], histories.samples(memory, restless)
        rollout(some, own, creeping, 0, math.ceil(time / _STEP))
        still[restless] = some
        for values, others in zip(memory.solver, own.solver, strict=True):
            values[restless] = others
        asleep = own.solver.rest_steps[:, resting] * _STEP >= _ASLEEP
        start.unsettled[np.ix_(restless, np.flatnonzero(resting))] = ~asleep
        restless, time = restless[~asleep.all(axis=1)], 2.0 * time
    states[:, resting] = np.where(nothing_below[:, None, None], before, still[:, resting])
    states[:, resting, VELOCITY] = states[:, resting, ANGULAR_VELOCITY] = 0.0
    _note_settling(scene, belief, drawn, states, start, resting)
    if not resting[scene.moving].all():
        return history
    memory.solver.residual[:] = 0.0
    _note_support(history.first_time, memory.solver)
    return history._replace(solver=memory.solver._replace(kept_overlap=history.solver.kept_overlap))


def _note_settling(scene, belief, drawn, states, start, resting):
    """Tell ``start`` how far settling moved and tilted the bodies."""
    down, flat = _down(scene)
    bodies = np.flatnonzero(resting)
    # the direction of gravity in the bodies' frames
    before, after = (
        turned(x[:, bodies, QUATERNION] * [-1.0, -1.0, -1.0, 1.0], down) for x in (drawn, states)
    )
    cross = np.linalg.norm(np.cross(before, after), axis=-1)
    start.tilted[:, bodies] = np.arctan2(cross, (before * after).sum(axis=-1))
    blocks = belief.blocks[np.searchsorted(belief.moving, bodies)]
    std = np.sqrt(np.maximum(np.einsum("i,bij,j->b", down, blocks[:, ERR_POSITION, ERR_POSITION], down), 0.0))
    sunk = np.abs((states[:, bodies, POSITION] - drawn[:, bodies, POSITION]) @ down)
    frames = [rotation_matrix(belief.mean[k, QUATERNION]) for k in bodies]
    spreads = [R @ P[ERR_ROTATION, ERR_ROTATION] @ R.T for R, P in zip(frames, blocks, strict=True)]
    tilts = np.sqrt([np.trace(flat @ spread @ flat) / 2.0 for spread in spreads])
    far = sunk / np.maximum(std, _HONEST_STD), start.tilted[:, bodies] / np.maximum(tilts, _LEAST_TILT)
    start.moved[:, bodies] = np.maximum.reduce([start.moved[:, bodies], *far])


def _note_support(first_time, memory):
    """Set the first contact to time 0 for contacts that carry load when rollouts begin."""
    bodies = first_time.shape[1]
    for n, count in enumerate(memory.count):
        i, j = memory.contact[n, :count, 0], memory.contact[n, :count, 1]
        low, high = np.where(j < 0, i, np.minimum(i, j)), np.where(j < 0, bodies - 1 - j, np.maximum(i, j))
        first_time[n, low, high] = 0.0
