"""Correction of a tracker's state by measurements of one time."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from ..spatial.layout import ANGULAR_VELOCITY, ERR_ANGULAR_VELOCITY, ERR_VELOCITY, VELOCITY
from .answers import mean_at
from .ensemble import BodyObservation, corrected
from .hypotheses import Filter, TrackMode
from .measurements import Measurement
from .members import aligned, drawn_again, with_fresh_adjustments, with_physics_in_charge
from .state import State, TrackedScene
from .symmetry import folded

#: Standard deviations added to the velocities of the first measurements at a start [m/s], [rad/s].
_START_VELOCITY, _START_SPIN = 0.3, 3.0


class CorrectedState(NamedTuple):
    """State after measurements.

    Attributes
    ----------
    state : State
    rejected : tuple of str
        Bodies whose measurements had no effect on the belief.
    """

    state: State
    rejected: tuple[str, ...]


class Start(NamedTuple):
    """Velocities of a body that have become known, with which its members begin at its first measurement.

    Attributes
    ----------
    place : int
        The body's place among the moving ones.
    free : Filter
        At the time of the first measurement.
    """

    place: int
    free: Filter


def correct_state(
    tracked: TrackedScene,
    state: State,
    time: float,
    measurements: Mapping[str, Measurement],
    known_times: Collection[float],
) -> CorrectedState | Start:
    """Correct a state by measurements.

    Parameters
    ----------
    tracked : TrackedScene
    state : State
        At the last step before the measurements.
    time : float
        Of the measurements [s].
    measurements : mapping of str to measurement
        By the names of moving bodies, in the order of the scene.
    known_times : collection of float
        Times of earlier measurements at which a `Start` is possible [s].

    Returns
    -------
    CorrectedState or Start
        A start if a body's velocities have become known: the measurements since then are to be applied again.
    """
    scene, moving, names = tracked.scene, tracked.scene.moving, tracked.names
    state = aligned(tracked, state, [names.index(name) for name in measurements])
    mean = mean_at(tracked, state, time)
    seen = []
    for name, measurement in measurements.items():
        body = names.index(name)
        reference = body if measurement.reference is None else names.index(measurement.reference)
        seen.append((body, reference, measurement.observation(scene.bodies[body])))
    observations = [_body_observation(tracked, state, time, mean, *one) for one in seen]
    carry = state.carry
    result = corrected(
        carry.states,
        moving,
        observations,
        _groups(scene, state),
        parameters=carry.parameters,
        gates=tracked.gates,
    )
    state = state._replace(carry=carry._replace(states=result.states, parameters=result.parameters))
    rejected = []
    places = {int(body): place for place, body in enumerate(moving)}
    for (body, reference, observation), physics in zip(seen, result.innovations, strict=True):
        place, symmetry = places[body], tracked.symmetry(body)
        tracks = list(state.tracks)
        touching = bool(state.contact_share[body] > 0.0)
        track = tracks[place].seen(
            time, observation, mean[reference], physics, tracked.gates, symmetry, touching
        )
        tracks[place] = track
        state = state._replace(tracks=tuple(tracks))
        if track.last_seen < time:
            rejected.append(names[body])
            continue
        if physics.accepted:
            history = with_fresh_adjustments(state.carry.contact_history, body)
            state = state._replace(carry=state.carry._replace(contact_history=history))
        elif track.mode is TrackMode.PHYSICS:  # only the filter, which is not in charge, used it
            rejected.append(names[body])
        if track.mode is TrackMode.STARTING:
            if track.free.knows_velocities(symmetry):
                if track.first is not None and track.first.time in known_times:
                    return Start(place, _first_filter(track, time, float(np.linalg.norm(scene.gravity))))
                state = with_physics_in_charge(tracked, state, place, track.free)
            else:
                state = drawn_again(tracked, state, place, track.free)
        elif track.mode is TrackMode.CARRIED and track.evidence == 0.0:
            # the members then show the motion of the body if it is released now
            state = drawn_again(tracked, state, place, track.free)
    return CorrectedState(state, tuple(rejected))


def _body_observation(tracked, state, time, mean, body, reference, observation):
    """Return the equivalent observation nearest to the mean, with the noise of the body's shape."""
    observation = folded(tracked.symmetry(body), observation, mean[body], mean[reference])
    shape = tracked.noise.shape_variance(state.contact_share[body])[: len(observation.noise)]
    noisy = observation._replace(noise=observation.noise + np.diag(shape))
    return BodyObservation(body, noisy, reference, tracked.delay(state, time))


def _groups(scene, state):
    """Return a number (M,) that moving bodies share if they have met, or were correlated at the start."""
    moving = scene.moving
    met = np.isfinite(state.carry.contact_history.first_time[:, moving][:, :, moving]).any(axis=0)
    met = met | state.tied
    groups = np.arange(len(moving))
    for a, b in zip(*np.nonzero(met), strict=True):
        if groups[a] != groups[b]:
            groups[groups == groups[b]] = groups[a]
    return groups


def _first_filter(track, time, gravity):
    """Return the filter after the first measurement with the velocities that are known now.

    The later measurements are applied again, so the variances of the velocities are enlarged.
    """
    first, free = track.first, track.free
    covariance = first.covariance.copy()
    covariance[ERR_VELOCITY], covariance[ERR_ANGULAR_VELOCITY] = 0.0, 0.0
    covariance[:, ERR_VELOCITY], covariance[:, ERR_ANGULAR_VELOCITY] = 0.0, 0.0
    fallen = 0.5 * (time - first.time) * gravity
    for block, least in (
        (ERR_VELOCITY, _START_VELOCITY**2 + fallen**2),
        (ERR_ANGULAR_VELOCITY, _START_SPIN**2),
    ):
        covariance[block, block] = free.covariance[block, block] + least * np.eye(3)
    mean = first.mean.copy()
    mean[VELOCITY], mean[ANGULAR_VELOCITY] = free.mean[VELOCITY], free.mean[ANGULAR_VELOCITY]
    return Filter(mean, covariance, first.time)
