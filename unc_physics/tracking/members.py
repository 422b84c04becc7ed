"""Members of a tracker: the rollouts that represent its belief are drawn, simulated, and drawn again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..checks.errors import DivergedError
from ..physics import contact_history as histories
from ..physics.contact_history import ContactHistory
from ..propagators.rollouts import RolloutCarry, advance_rollouts
from ..propagators.start import move_out_of_overlap
from ..scene.belief import Belief
from ..scene.body_belief import BodyBelief
from ..scene.scene import Scene
from ..spatial.layout import ERR_ANGULAR_VELOCITY, ERR_VELOCITY, ERROR
from ..spatial.moments import mean_and_errors, spread_states, symmetric_root
from .hypotheses import Filter, Track, TrackMode, new_track
from .noise import add_contact_noise, whitened, whitened_draws
from .state import State, TrackedScene


def first_members(tracked: TrackedScene, belief: Belief, tracks: Sequence[Track]) -> RolloutCarry:
    """Return the members at the start: whitened draws, with zero for unknown velocities."""
    P, count = np.array(belief.joint), tracked.propagator.samples
    for place, track in enumerate(tracks):
        if track.mode is TrackMode.STARTING:
            for block in (ERR_VELOCITY, ERR_ANGULAR_VELOCITY):
                own = slice(ERROR * place + block.start, ERROR * place + block.stop)
                P[own], P[:, own] = 0.0, 0.0
    belief = Belief.trusted(belief.mean, P, belief.moving)
    rng = np.random.default_rng((tracked.propagator.seed, 0, 0))
    root = belief.root()
    z = rng.standard_normal((count, root.shape[1]))
    if root.shape[1] < count // 2:
        z = whitened(z)
    states = spread_states(belief.mean.copy(), belief.moving.copy(), np.einsum("nr,kr->nk", z, root))
    carry = tracked.propagator.start_rollouts(tracked.scene, belief, states)
    return carry._replace(
        parameters=whitened(carry.parameters) if carry.parameters.size else carry.parameters
    )


def advanced(tracked: TrackedScene, state: State, step: int) -> State:
    """Return the state with the members advanced to a step; each piece has its own contact noise.

    Raises
    ------
    DivergedError
        If a member left the range of numbers.
    UncPhysicsError
        From the tracker's ``interrupt``.
    """
    scene = tracked.scene
    while state.carry.step < step:
        tracked.interrupt()
        begin = state.carry.step
        steps = min(step, (begin // tracked.piece + 1) * tracked.piece) - begin
        before = state.carry.states
        carry = state.carry._replace(contact_history=histories.moved(state.carry.contact_history))
        carry = advance_rollouts(carry, scene, steps)
        carry, share = add_contact_noise(before, carry, scene, steps, tracked.noise, tracked.propagator.seed)
        if not np.isfinite(carry.states).all():
            raise DivergedError("left the range of numbers; a smaller dt may help", field="tracker")
        state = state._replace(carry=carry, contact_share=share)
    return state


def with_fewer(state: State, count: int) -> State:
    """Return the state with so many of its members, evenly spaced, or all if it has fewer."""
    carry, each = state.carry, len(state.carry.states)
    if count >= each:
        return state
    kept = np.arange(count) * each // count
    history = histories.samples(carry.contact_history, kept)
    fewer = carry._replace(
        states=carry.states[kept], parameters=carry.parameters[kept], contact_history=history
    )
    return state._replace(carry=fewer)


def drawn_again(tracked: TrackedScene, state: State, place: int, free: Filter) -> State:
    """Return the state with a moving body's members drawn from a filter's belief.

    If physics begins there, overlap is removed. ``place`` is the body's place among the moving ones.
    """
    scene, carry, mode = tracked.scene, state.carry, state.tracks[place].mode
    body = int(scene.moving[place])
    covariance = free.covariance.copy()
    if mode is TrackMode.STARTING:  # velocities are unknown
        covariance[ERR_VELOCITY], covariance[ERR_ANGULAR_VELOCITY] = 0.0, 0.0
        covariance[:, ERR_VELOCITY], covariance[:, ERR_ANGULAR_VELOCITY] = 0.0, 0.0
    rng = np.random.default_rng((tracked.propagator.seed, carry.step, 1 + place))
    drawn = whitened_draws(free.mean, symmetric_root(covariance), len(carry.states), rng)
    states = carry.states.copy()
    states[:, body] = drawn[:, 0]
    history, depth = histories.renewed(carry.contact_history, [body]), None
    if mode is not TrackMode.STARTING and scene.integrator != "explicit" and scene.overlap == "project":
        mean, _ = mean_and_errors(states, scene.moving)
        blocks = np.zeros((len(scene.moving), ERROR, ERROR))
        blocks[place] = covariance
        around = Belief.trusted(mean, blocks, scene.moving)
        states, kept = move_out_of_overlap(scene, around, states, [body])
        depth = np.maximum(kept[:, body].max(axis=1), kept[:, :, body].max(axis=1))
    history = with_fresh_adjustments(history, body, depth)
    return state._replace(carry=carry._replace(states=states, contact_history=history))


def with_physics_in_charge(tracked: TrackedScene, state: State, place: int, free: Filter) -> State:
    """Return the state in which physics continues from a filter's belief about a moving body."""
    tracks = list(state.tracks)
    tracks[place] = tracks[place]._replace(mode=TrackMode.PHYSICS, first=None)
    return drawn_again(tracked, state._replace(tracks=tuple(tracks)), place, free)


def aligned(tracked: TrackedScene, state: State, bodies: Iterable[int]) -> State:
    """Return the state whose members have the same angle about the axes of symmetry of some bodies."""
    states = state.carry.states
    for body in bodies:
        states = tracked.symmetry(body).aligned(states, body)
    return state._replace(carry=state.carry._replace(states=states))


def with_last_body(tracked: TrackedScene, state: State, known: BodyBelief, time: float) -> State:
    """Return the state with members of the scene's last body, which it does not have yet.

    Parameters
    ----------
    tracked : TrackedScene
    state : State
    known : BodyBelief
        About the body's centre of mass.
    time : float
        [s]
    """
    scene, seed, count = tracked.scene, tracked.propagator.seed, tracked.propagator.samples
    index = len(scene.bodies) - 1
    states = np.concatenate([state.carry.states, np.tile(known.state, (count, 1, 1))], axis=1)
    history = histories.with_another_body(state.carry.contact_history)
    if scene.draws_impacts:
        history = histories.with_keys(history, seed)
    carry = state.carry._replace(states=states, contact_history=history)
    share, tracks, tied = np.append(state.contact_share, 0.0), state.tracks, state.tied
    if not scene.bodies[-1].free:
        return State(carry, share, tracks, tied)
    free = Filter(np.array(known.state), np.array(known.covariance), time)
    tied = np.pad(tied, (0, 1))
    tied[-1, -1] = True
    state = State(carry, share, (*tracks, new_track(free, tracked.symmetry(index))), tied)
    return drawn_again(tracked, state, len(tracks), free)


def without_body(scene: Scene, state: State, gone: int) -> State:
    """Return the state without a body of the present scene; sleeping bodies are awake."""
    kept = np.array([k for k in range(len(scene.bodies)) if k != gone])
    stays = scene.moving != gone
    history = histories.woken(histories.of_bodies(state.carry.contact_history, kept))
    states = np.ascontiguousarray(state.carry.states[:, kept])
    tracks = tuple(track for track, stay in zip(state.tracks, stays, strict=True) if stay)
    carry = state.carry._replace(states=states, contact_history=history)
    return State(carry, state.contact_share[kept], tracks, state.tied[np.ix_(stays, stays)])


def woken(state: State) -> State:
    """Return the state in which all bodies are awake."""
    history = histories.woken(state.carry.contact_history)
    return state._replace(carry=state.carry._replace(contact_history=history))


def with_fresh_adjustments(
    history: ContactHistory, body: int, kept: np.ndarray | None = None
) -> ContactHistory:
    """Return the history with the adjustments of a body's start replaced by those since a measurement.

    Only the overlap (N,) that it keeps without a force remains, by default as before.
    """
    if history.start is None:
        return history
    start = type(history.start)(*map(np.copy, history.start))
    kept = start.kept[:, body].copy() if kept is None else kept
    for values in start:
        values[:, body] = 0.0
    start.kept[:, body] = kept
    return history._replace(start=start)
