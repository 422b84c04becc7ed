"""Answers from the state of a tracker: members, beliefs, statuses, and predictions."""

from __future__ import annotations

import numpy as np

from ..compiler.compile_time import clock
from ..physics import contact_history as histories
from ..prediction.prediction import Prediction
from ..prediction.snapshot import Snapshot
from ..propagators.monte_carlo import MonteCarlo
from ..scene.belief import Belief
from ..scene.contact_world import bearing_pairs
from ..scene.kinematic_states import with_kinematic
from ..scene.marks import Mark
from ..spatial.layout import ERR_POSITION, ERR_ROTATION, ERROR, POSITION
from ..spatial.moments import mean_and_errors, second_moment, symmetric_root
from .hypotheses import COASTING_AFTER, TrackMode
from .members import advanced
from .noise import whitened_draws
from .observation import constant_velocity
from .report import TrackStatus
from .state import State, TrackedScene

#: Share of sleeping members from which on a body is at rest.
_RESTING_SHARE = 0.9
#: Rejected measurements in a row, and standard deviation of the position [m], of a lost body.
_LOST_AFTER, _LOST_STD = 3, 0.5


class Members(MonteCarlo):
    """Propagator of a tracker's predictions, in which noise and filters move bodies, too."""

    adds_energy = True


def members_at(tracked: TrackedScene, state: State, time: float) -> np.ndarray:
    """Return the members (N, B, 13); bodies with a filter in charge are drawn from the filter."""
    states = state.carry.states
    rng = np.random.default_rng((tracked.propagator.seed, state.carry.step, 0))
    for body, track in zip(tracked.scene.moving, state.tracks, strict=True):
        if track.mode is not TrackMode.PHYSICS:
            if states is state.carry.states:
                states = states.copy()
            free = track.answer(time)
            root = symmetric_root(free.covariance)
            states[:, body] = whitened_draws(free.mean, root, len(states), rng)[:, 0]
    return states


def mean_at(tracked: TrackedScene, state: State, time: float) -> np.ndarray:
    """Return the mean (B, 13) of `belief_at`."""
    mean, _ = mean_and_errors(state.carry.states, tracked.scene.moving)
    return _completed_mean(tracked, state, mean, time)


def _completed_mean(tracked, state, mean, time):
    """Return the members' mean at an exact time, with the means of filters in charge."""
    delay = tracked.delay(state, time)
    for body, track in zip(tracked.scene.moving, state.tracks, strict=True):
        if track.mode is not TrackMode.PHYSICS:
            mean[body] = track.answer(time).mean
        elif delay:
            mean[body] = constant_velocity(mean[body].copy(), np.zeros((ERROR, ERROR)), delay, 0.0, 0.0)[0]
    return with_kinematic(tracked.scene, mean, time - tracked.origin)


def belief_at(tracked: TrackedScene, state: State, time: float) -> Belief:
    """Return the belief of a state at its exact time [s]."""
    moving = tracked.scene.moving
    mean, errors = mean_and_errors(state.carry.states, moving)
    P = second_moment(errors) * (len(errors) / (len(errors) - 1.0))
    poses = np.r_[ERR_POSITION, ERR_ROTATION]
    for place, (body, track) in enumerate(zip(moving, state.tracks, strict=True)):
        own = slice(ERROR * place, ERROR * (place + 1))
        if track.mode is TrackMode.PHYSICS:
            P[ERROR * place + poses, ERROR * place + poses] += tracked.noise.shape_variance(
                float(state.contact_share[body])
            )
        else:
            P[own], P[:, own] = 0.0, 0.0
            P[own, own] = track.answer(time).covariance
    return Belief.trusted(_completed_mean(tracked, state, mean, time), P, moving)


def statuses_at(tracked: TrackedScene, state: State, time: float) -> dict[str, TrackStatus]:
    """Return the status of each moving body, by its name."""
    scene, found = tracked.scene, {}
    resting = histories.asleep(state.carry.contact_history).mean(axis=0)
    for body, track in zip(scene.moving, state.tracks, strict=True):
        if track.mode is TrackMode.CARRIED:
            spread = float(np.sqrt(track.answer(time).covariance.diagonal()[ERR_POSITION].max()))
        else:
            spread = float(state.carry.states[:, body, POSITION].std(axis=0).max())
        if track.mode is TrackMode.STARTING:
            status = TrackStatus.STARTING
        elif track.rejected >= _LOST_AFTER or spread > _LOST_STD:
            status = TrackStatus.LOST
        elif track.mode is TrackMode.CARRIED:
            status = TrackStatus.CARRIED
        elif resting[body] >= _RESTING_SHARE:
            status = TrackStatus.RESTING
        elif time - track.last_seen > COASTING_AFTER:
            status = TrackStatus.COASTING
        else:
            status = TrackStatus.TRACKED
        found[scene.bodies[body].name] = status
    return found


def prediction_from(
    tracked: TrackedScene, state: State, time: float, marks: list[Mark], started: float
) -> Prediction:
    """Return the prediction from a state.

    Times of marks and of contacts are from the state's ``time`` [s] on. The computation ``started`` at a time
    of `compile_time.clock`.
    """
    scene = tracked.scene
    history = _touching_support(state.carry.contact_history, scene, time - tracked.origin)
    state = state._replace(carry=state.carry._replace(contact_history=history))
    now = belief_at(tracked, state, time)
    snapshots = []
    for mark in marks:
        at = time + mark.time
        state = advanced(tracked, state, tracked.step(at))
        first = state.carry.contact_history.first_time - np.float32(time - tracked.origin)
        own = state.carry.contact_history._replace(first_time=first)
        samples = members_at(tracked, state, at)
        carry = state.carry._replace(contact_history=own, step=mark.steps)
        snapshots.append(
            Snapshot(mark.time, belief_at(tracked, state, at), carry, samples, first_contacts=first)
        )
    members = Members(len(state.carry.states), tracked.propagator.seed)
    return Prediction(scene, members, tuple(snapshots), now, now, clock() - started)


def _touching_support(history, scene, time):
    """Return a history in which bodies touch what bears them, at a time, and nothing else has touched."""
    first = np.full_like(history.first_time, np.inf)
    if history.solver is not None:
        first[bearing_pairs(scene, history)] = time
    return history._replace(first_time=first)
