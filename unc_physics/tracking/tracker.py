"""Tracker: a belief that is kept while measurements arrive, through contact, rest and occlusion."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import DivergedError, InvalidRequestError, NotSupportedError
from ..checks.names import hint
from ..checks.validation import instance, integer, number, positive
from ..compiler.compile_time import clock
from ..dynamics import contact_history as histories
from ..dynamics.contact_history import InitialAdjustment
from ..prediction.prediction import Prediction
from ..prediction.request_checks import check_supported, marks_of
from ..prediction.snapshot import Snapshot
from ..propagators.monte_carlo import MonteCarlo, MonteCarloCarry
from ..propagators.rollouts import advance_rollouts
from ..propagators.start import constrain_belief, move_out_of_overlap
from ..scene.action_arrays import with_kinematic
from ..scene.actions import PosePath
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.scene import Scene
from ..scene.stiffness import with_stiffness
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    VELOCITY,
)
from ..spatial.moments import mean_and_errors, second_moment, spread_states, symmetric_root
from .ensemble import BodyObservation, Gates, corrected
from .hypotheses import COASTING_AFTER, Filter, Track, TrackMode
from .measurements import Measurement, PoseMeasurement, PositionMeasurement
from .measurements import RelativePoseMeasurement as Relative
from .noise import ContactNoise, add_contact_noise, whitened, whitened_draws
from .observation import constant_velocity
from .report import Correction, TrackStatus
from .symmetry import NONE, AxialSymmetry, checked_symmetries, folded

#: Longest simulated time between additions of contact noise [s].
_PIECE = 1.0 / 30.0
#: Standard deviations added to the velocities of the first measurements at a start [m/s], [rad/s].
_START_VELOCITY, _START_SPIN = 0.3, 3.0
#: Share of sleeping members from which on a body is at rest.
_RESTING_SHARE = 0.9
#: Rejected measurements in a row, and standard deviation of the position [m], of a lost body.
_LOST_AFTER, _LOST_STD = 3, 0.5
_SAME_TIME = 1e-9  # s
_FEWEST, _MOST = 8, 10_000  # members


class State(NamedTuple):
    """Immutable state of a tracker at one time.

    Attributes
    ----------
    carry : MonteCarloCarry
        The members.
    contact_share : (B,) array
        Share of the members in which each body was recently in contact.
    tracks : tuple of Track
        Of the moving bodies.
    tied : (M, M) bool array
        Which moving bodies were correlated at the start.
    """

    carry: MonteCarloCarry
    contact_share: np.ndarray
    tracks: tuple[Track, ...]
    tied: np.ndarray


@dataclass(eq=False)
class _Entry:
    """Measurements of one time, and the state after them."""

    time: float
    measurements: Mapping[str, Measurement]
    state: State
    rejected: tuple[str, ...] = ()


class Tracker:
    """Belief about a scene's bodies that is kept while measurements arrive.

    A set of rollouts (members) with contact memory represents the belief. Measurements correct the members by
    a deterministic square-root ensemble Kalman filter on the manifold of poses. A constant-velocity filter
    for each body gives the answer while physics cannot explain the measurements, as when a hand carries it.

    Parameters
    ----------
    scene : Scene
    belief : Belief
        About the bodies at ``time``. Give unknown velocities large standard deviations: the members of such
        a body start when poses have determined its velocities.
    members : int, optional
        Number of rollouts.
    noise : ContactNoise, optional
    window : float, optional
        How late measurements may arrive [s].
    time : float, optional
        Time of the belief, on the clock of the measurements [s]. The scene's paths begin then.
    seed : int, optional
        Seed of all draws. The same calls with the same seed have the same results, to the last bit.
    gates : Gates, optional
        Squared Mahalanobis distances above which measurements have less effect, and none.
    symmetries : mapping of str to AxialSymmetry or (K, 4) array_like, optional
        An axis about which a body looks the same at every angle; or rotations, as quaternions (x, y, z, w) in
        the body frame, after which it looks the same. A measured pose is replaced by the equivalent one that
        is nearest to the expected pose. The angle about an axis of symmetry is never corrected: it is
        arbitrary in the answers, and its small variance there is meaningless (`AxialSymmetry`).

    Raises
    ------
    NotSupportedError
        If a centre of mass or a path is uncertain, or overlap is to be rejected.
    InvalidRequestError, NotFiniteError, LimitExceededError
        For arguments out of range, and a belief about other bodies.
    """

    def __init__(
        self,
        scene: Scene,
        belief: Belief,
        members: int = 64,
        noise: ContactNoise = ContactNoise(),  # noqa: B008 - it is frozen
        window: float = 0.5,
        *,
        time: float = 0.0,
        seed: int = 0,
        gates: Gates = Gates(),  # noqa: B008 - it is frozen
        symmetries: Mapping[str, AxialSymmetry | ArrayLike] | None = None,
    ):
        instance(scene, Scene, "scene")
        instance(belief, Belief, "belief")
        instance(noise, ContactNoise, "noise")
        belief.check_fits(scene)
        members = integer(members, "members", low=_FEWEST)
        self._propagator = MonteCarlo(samples=members, seed=integer(seed, "seed", low=0))
        self._noise, self._gates = noise, gates
        self._window = positive(window, "window")
        self._origin = self._time = number(time, "time")
        _check_tracked(scene, self._propagator)
        scene = with_stiffness(scene, belief.mean)
        if scene.integrator == "implicit":
            scene = replace(scene, sleep=True, islands=False)
        self._symmetries = checked_symmetries(symmetries or {}, scene)
        belief = constrain_belief(scene, belief)
        tracks = tuple(
            _new_track(
                belief.mean[body], P, self._origin, self._symmetries.get(scene.bodies[body].name, NONE)
            )
            for body, P in zip(belief.moving, belief.blocks, strict=True)
        )
        carry = self._start(scene, belief, tracks)
        # bodies that settled at the start move freely from then on
        self._set_scene(replace(scene, bodies=[replace(body, at_rest=False) for body in scene.bodies]))
        blocks = np.abs(belief.joint).reshape(len(tracks), ERROR, len(tracks), ERROR)
        state = State(carry, np.zeros(len(scene.bodies)), tracks, blocks.max(axis=(1, 3)) > 0.0)
        self._history = [_Entry(self._origin, {}, state)]
        self._present: State | None = None

    # -- public methods ----------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """Simulated scene."""
        return self._scene

    @property
    def time(self) -> float:
        """Time of the belief [s]."""
        return self._time

    def correct(self, time: float, measurements: Mapping[str, Measurement]) -> Correction:
        """Correct the belief by measurements of one time.

        Parameters
        ----------
        time : float
            Time of the measurements [s]. It may precede earlier calls by up to the window. Older measurements
            have no effect, and the report has `Correction.too_late`.
        measurements : mapping of str to measurement
            By the names of moving bodies: `PoseMeasurement`, `PositionMeasurement` or
            `RelativePoseMeasurement`.

        Returns
        -------
        Correction

        Raises
        ------
        InvalidRequestError
            If a name belongs to no moving body.
        """
        time = number(time, "time")
        self._check(measurements)
        names = [body.name for body in self._scene.bodies]
        given = {name: measurements[name] for name in names if name in measurements}
        if time < self._history[0].time - _SAME_TIME:
            return self._report(time, (), None)
        place = max(k for k, entry in enumerate(self._history) if entry.time <= time + _SAME_TIME)
        entry = _Entry(time, given, self._history[place].state)
        self._history.insert(place + 1, entry)
        self._time = max(self._time, time)
        self._replay(place + 1)
        replayed = len(self._history) - 1 - self._history.index(entry)
        self._forget_old()
        return self._report(time, tuple(given), entry, replayed=replayed)

    def predict(self, time: float) -> None:
        """Advance to a time, without measurements.

        Parameters
        ----------
        time : float
            [s]; not before that of the tracker.
        """
        time = number(time, "time")
        if time < self._time:
            raise InvalidRequestError(
                f"must not be before the tracker's time, {self._time:.6g} s", field="time", value=time
            )
        self._present = self._state_at(time)
        self._time = time

    def belief(self, time: float | None = None) -> Belief:
        """Return the belief of a time.

        Parameters
        ----------
        time : float, optional
            [s]; by default that of the tracker. A later time is predicted. An earlier one within the window
            is answered from the measurements before it.

        Returns
        -------
        Belief
        """
        time = self._time if time is None else number(time, "time")
        return self._answer(self._state_at(time), time)

    def status(self, name: str) -> TrackStatus:
        """Return the status of a moving body."""
        return self._statuses(self._state_at(self._time), self._time)[self._moving_name(name)]

    def samples(self) -> np.ndarray:
        """Return the members' states (N, B, 13) at the tracker's time."""
        state = self._state_at(self._time)
        return self._members(state, self._time)

    def parameters(self) -> dict[str, tuple[float, float]]:
        """Return mean and standard deviation of the scene's uncertain parameters, in standard deviations."""
        z = self._state_at(self._time).carry.parameters
        return {
            f"{parameter.name} {parameter.axis} of {parameter.body}": (
                float(z[:, k].mean()),
                float(z[:, k].std(ddof=1)),
            )
            for k, parameter in enumerate(self._scene.uncertain)
        }

    def ahead(self, times: float | Sequence[float]) -> Prediction:
        """Predict from the present belief; the tracker does not change.

        Parameters
        ----------
        times : float or sequence of float
            One time or several, from the tracker's time on, ascending [s].

        Returns
        -------
        Prediction
            Its times and contact times are from the tracker's time on.
        """
        started = clock()
        marks = marks_of(self._scene, None, times)
        state = self._state_at(self._time)
        history = _touching_support(state.carry.contact_history, self._scene.world, self._time - self._origin)
        state = state._replace(carry=state.carry._replace(contact_history=history))
        now = self._answer(state, self._time)
        snapshots = []
        for mark in marks:
            at = self._time + mark.time
            state = self._advanced(state, self._step(at))
            first = state.carry.contact_history.first_time - np.float32(self._time - self._origin)
            own = state.carry.contact_history._replace(first_time=first)
            samples = self._members(state, at)
            carry = state.carry._replace(contact_history=own, step=mark.steps)
            snapshots.append(
                Snapshot(mark.time, self._answer(state, at), carry, samples.copy, samples.view, first)
            )
        return Prediction(self._scene, self._propagator, tuple(snapshots), now, now, clock() - started)

    def fork(self) -> Tracker:
        """Return an independent tracker in the same state, for what-if questions."""
        other = copy.copy(self)
        other._history = [copy.copy(entry) for entry in self._history]
        other._symmetries = dict(self._symmetries)
        return other

    def add(
        self, body: RigidBody, belief: BodyBelief, symmetry: AxialSymmetry | ArrayLike | None = None
    ) -> None:
        """Add a body at the tracker's time; earlier measurements no longer count.

        Parameters
        ----------
        body : RigidBody
        belief : BodyBelief
            About the body at the tracker's time; large standard deviations mean unknown velocities.
        symmetry : AxialSymmetry or (K, 4) array_like, optional
            As in the tracker's ``symmetries``.
        """
        instance(body, RigidBody, "body")
        instance(belief, BodyBelief, "belief")
        state, old = self._state_at(self._time), self._scene
        scene = replace(old, bodies=[*old.bodies, replace(body, at_rest=False)])
        _check_tracked(scene, self._propagator)
        if len(scene.uncertain) != len(old.uncertain):
            raise NotSupportedError("must have no uncertain parameters when it is added", field="body")
        symmetries = {} if symmetry is None else checked_symmetries({body.name: symmetry}, scene)
        known = belief.at_center_of_mass(body.model.origin)
        count, index = self._propagator.samples, len(old.bodies)
        states = np.concatenate([state.carry.states, np.tile(known.state, (count, 1, 1))], axis=1)
        alone = histories.fresh(count, replace(scene, bodies=[scene.bodies[-1]]).world)
        history = histories.joined(
            [state.carry.contact_history, alone],
            [np.arange(count)] * 2,
            [np.arange(index), np.array([index])],
            scene.world,
        )
        if scene.draws_impacts:
            history = histories.with_keys(history, self._propagator.seed)
        carry = state.carry._replace(states=states, contact_history=history)
        share, tracks, tied = np.append(state.contact_share, 0.0), state.tracks, state.tied
        if scene.bodies[-1].free:
            tracks = (
                *tracks,
                _new_track(known.state, known.covariance, self._time, symmetries.get(body.name, NONE)),
            )
            tied = np.pad(tied, (0, 1))
            tied[-1, -1] = True
        self._set_scene(scene)
        self._symmetries |= symmetries
        state = State(carry, share, tracks, tied)
        if scene.bodies[-1].free:
            state = self._with_drawn_members(
                state, len(tracks) - 1, Filter(known.state, known.covariance, self._time)
            )
        self._restart_history(state)

    def remove(self, name: str) -> None:
        """Remove a body at the tracker's time; earlier measurements no longer count.

        Sleeping bodies wake up, as the body may have carried them.
        """
        names = [body.name for body in self._scene.bodies]
        if name not in names:
            raise InvalidRequestError(
                f"is no body of the scene{hint(str(name), names)}", field="name", value=name
            )
        gone = names.index(name)
        kept = np.array([k for k in range(len(names)) if k != gone])
        state = self._state_at(self._time)
        scene = replace(self._scene, bodies=[self._scene.bodies[k] for k in kept])
        if len(scene.uncertain) != len(self._scene.uncertain):
            raise NotSupportedError("must have no uncertain parameters to be removed", field=f"body '{name}'")
        stays = self._scene.moving != gone
        history = histories.of_bodies(state.carry.contact_history, kept)
        history = histories.woken(history)
        carry = state.carry._replace(
            states=np.ascontiguousarray(state.carry.states[:, kept]), contact_history=history
        )
        tracks = tuple(track for track, stay in zip(state.tracks, stays, strict=True) if stay)
        self._set_scene(scene)
        self._symmetries.pop(name, None)
        self._restart_history(
            State(carry, state.contact_share[kept], tracks, state.tied[np.ix_(stays, stays)])
        )

    def act(self, paths: Mapping[str, PosePath]) -> None:
        """Replace the paths of prescribed bodies, from the tracker's time on.

        Parameters
        ----------
        paths : mapping of str to PosePath
            Their times are seconds since the tracker's first time, as in the scene's paths. Each path must
            continue at the present pose of its body.
        """
        names = [body.name for body in self._scene.bodies]
        bodies = list(self._scene.bodies)
        for name, path in paths.items():
            instance(path, PosePath, f"paths['{name}']")
            if name not in names or bodies[names.index(name)].trajectory is None:
                raise InvalidRequestError("is no prescribed body of the scene", field="paths", value=name)
            bodies[names.index(name)] = replace(bodies[names.index(name)], trajectory=path)
        state = self._state_at(self._time)
        self._set_scene(replace(self._scene, bodies=bodies))
        self._restart_history(
            state._replace(
                carry=state.carry._replace(contact_history=histories.woken(state.carry.contact_history))
            )
        )

    # -- time --------------------------------------------------------------------------------------

    def _set_scene(self, scene):
        self._scene = scene
        self._piece = max(1, math.floor(_PIECE / scene.dt + 1e-6))

    def _restart_history(self, state):
        """Let the history begin with a state at the tracker's time."""
        self._history = [_Entry(self._time, {}, state)]
        self._present = state

    def _step(self, time):
        return round((time - self._origin) / self._scene.dt)

    def _delay(self, state, time):
        """Return the time since the last step of the members [s]."""
        return time - self._origin - state.carry.step * self._scene.dt

    def _state_at(self, time):
        """Return the state at a time, from the measurements until then."""
        place = max(
            (k for k, entry in enumerate(self._history) if entry.time <= time + _SAME_TIME), default=-1
        )
        if place < 0:
            raise InvalidRequestError(
                f"must not be before the tracker's window, which begins at {self._history[0].time:.6g} s",
                field="time",
                value=time,
            )
        state, present = self._history[place].state, self._present
        if present is not None and place == len(self._history) - 1:
            if state.carry.step <= present.carry.step <= self._step(time):
                state = present
        return self._advanced(state, self._step(time))

    def _advanced(self, state, step):
        """Return the state with the members advanced to a step; each piece has its own noise."""
        scene = self._scene
        while state.carry.step < step:
            begin = state.carry.step
            steps = min(step, (begin // self._piece + 1) * self._piece) - begin
            before = state.carry.states
            carry = advance_rollouts(state.carry, scene, steps)
            carry, share = add_contact_noise(before, carry, scene, steps, self._noise, self._propagator.seed)
            if not np.isfinite(carry.states).all():
                raise DivergedError("left the range of numbers; a smaller dt may help", field="tracker")
            state = state._replace(carry=carry, contact_share=share)
        return state

    def _replay(self, place):
        """Apply the entries from an index on again."""
        k = place
        while k < len(self._history):
            entry = self._history[k]
            state = self._advanced(self._history[k - 1].state, self._step(entry.time))
            again = self._apply(k, state, entry)
            k = k + 1 if again is None else again
        self._present = None

    def _forget_old(self):
        """Remove entries that nothing within the window needs."""
        old = [k for k, entry in enumerate(self._history) if entry.time < self._time - self._window]
        if old:
            del self._history[: old[-1]]

    # -- corrections -------------------------------------------------------------------------------

    def _apply(self, k, state, entry):
        """Apply an entry's measurements to the state before them.

        Returns None, or the index of the entry to continue from if earlier members of a body were drawn
        again.
        """
        scene, moving = self._scene, self._scene.moving
        names = {body.name: index for index, body in enumerate(scene.bodies)}
        state = self._aligned(state, [names[name] for name in entry.measurements])
        mean = self._answer_mean(state, entry.time)
        seen = []
        for name, measurement in entry.measurements.items():
            body = names[name]
            reference = body if measurement.reference is None else names[measurement.reference]
            seen.append((body, reference, measurement.observation(scene.bodies[body])))
        observations = [self._body_observation(state, entry.time, mean, *one) for one in seen]
        carry = state.carry
        result = corrected(
            carry.states,
            moving,
            observations,
            self._groups(state),
            parameters=carry.parameters,
            gates=self._gates,
        )
        state = state._replace(carry=carry._replace(states=result.states, parameters=result.parameters))
        tracks, rejected, restart = list(state.tracks), [], None
        places = {int(body): place for place, body in enumerate(moving)}
        for (body, reference, observation), physics in zip(seen, result.innovations, strict=True):
            place = places[body]
            track = tracks[place].seen(
                entry.time, observation, mean[reference], physics, self._gates, self._symmetry(body)
            )
            tracks[place] = track
            state = state._replace(tracks=tuple(tracks))
            if track.last_seen < entry.time:
                rejected.append(scene.bodies[body].name)
                continue
            if physics.accepted:
                history = _with_fresh_adjustments(state.carry.contact_history, body)
                state = state._replace(carry=state.carry._replace(contact_history=history))
            elif track.mode is TrackMode.PHYSICS:  # only the filter, which is not in charge, used it
                rejected.append(scene.bodies[body].name)
            if track.mode is TrackMode.STARTING:
                if track.free.knows_velocities(self._symmetry(body)):
                    restart = self._started(k, state, place, entry.time)
                    if restart is not None:
                        return restart
                    state = self._resumed_physics(state, place)
                else:
                    state = self._with_drawn_members(state, place, track.free)
            elif track.mode is TrackMode.CARRIED and track.evidence == 0.0:
                # the members then show the motion of the body if it is released now
                state = self._with_drawn_members(state, place, track.free)
            tracks = list(state.tracks)
        entry.state, entry.rejected = state, tuple(rejected)
        return None

    def _body_observation(self, state, time, mean, body, reference, observation):
        """Return the equivalent observation nearest to the mean, with the noise of the body's shape."""
        observation = folded(self._symmetry(body), observation, mean[body], mean[reference])
        shape = self._noise.shape_variance(state.contact_share[body])[: len(observation.noise)]
        noisy = observation._replace(noise=observation.noise + np.diag(shape))
        return BodyObservation(body, noisy, reference, self._delay(state, time))

    def _started(self, k, state, place, time):
        """Draw a body's members again at its first measurement, when its velocities have become known.

        Returns the index of the entry after that measurement; None if it was removed.
        """
        first, free = state.tracks[place].first, state.tracks[place].free
        at = [j for j in range(1, k) if self._history[j].time == first.time]
        if not at:
            return None
        covariance = first.covariance.copy()
        covariance[ERR_VELOCITY], covariance[ERR_ANGULAR_VELOCITY] = 0.0, 0.0
        covariance[:, ERR_VELOCITY], covariance[:, ERR_ANGULAR_VELOCITY] = 0.0, 0.0
        # the later measurements are applied again, so the variances of the velocities are enlarged
        fallen = 0.5 * (time - first.time) * float(np.linalg.norm(self._scene.gravity))
        for block, least in (
            (ERR_VELOCITY, _START_VELOCITY**2 + fallen**2),
            (ERR_ANGULAR_VELOCITY, _START_SPIN**2),
        ):
            covariance[block, block] = free.covariance[block, block] + least * np.eye(3)
        mean = first.mean.copy()
        mean[VELOCITY], mean[ANGULAR_VELOCITY] = free.mean[VELOCITY], free.mean[ANGULAR_VELOCITY]
        entry = self._history[at[-1]]
        tracks = list(entry.state.tracks)
        tracks[place] = tracks[place]._replace(mode=TrackMode.PHYSICS, first=None)
        state = entry.state._replace(tracks=tuple(tracks))
        entry.state = self._with_drawn_members(state, place, Filter(mean, covariance, first.time))
        return at[-1] + 1

    def _resumed_physics(self, state, place):
        """Return the state in which physics continues from a body's filter."""
        tracks = list(state.tracks)
        tracks[place] = tracks[place]._replace(mode=TrackMode.PHYSICS, first=None)
        return self._with_drawn_members(state._replace(tracks=tuple(tracks)), place, tracks[place].free)

    def _with_drawn_members(self, state, place, free):
        """Return the state with a body's members drawn from a filter's belief.

        If physics begins there, overlap is removed.
        """
        scene, carry, mode = self._scene, state.carry, state.tracks[place].mode
        body = int(scene.moving[place])
        covariance = free.covariance.copy()
        if mode is TrackMode.STARTING:  # velocities are unknown
            covariance[ERR_VELOCITY], covariance[ERR_ANGULAR_VELOCITY] = 0.0, 0.0
            covariance[:, ERR_VELOCITY], covariance[:, ERR_ANGULAR_VELOCITY] = 0.0, 0.0
        rng = np.random.default_rng((self._propagator.seed, carry.step, 1 + place))
        drawn = whitened_draws(free.mean, symmetric_root(covariance), len(carry.states), rng)
        states = carry.states.copy()
        states[:, body] = drawn[:, 0]
        history, depth = histories.renewed(carry.contact_history, [body]), None
        if mode is not TrackMode.STARTING and scene.integrator == "implicit" and scene.overlap == "project":
            mean, _ = mean_and_errors(states, scene.moving)
            blocks = np.zeros((len(scene.moving), ERROR, ERROR))
            blocks[place] = covariance
            around = Belief.trusted(mean, blocks, scene.moving)
            states, kept = move_out_of_overlap(scene, around, states, [body])
            history = histories.with_kept_overlap(history, kept, [body])
            depth = np.maximum(kept[:, body].max(axis=1), kept[:, :, body].max(axis=1))
        history = _with_fresh_adjustments(history, body, depth)
        return state._replace(carry=carry._replace(states=states, contact_history=history))

    def _groups(self, state):
        """Return a number (M,) that moving bodies share if they have met, or were correlated at the start."""
        moving = self._scene.moving
        count = len(moving)
        met = np.isfinite(state.carry.contact_history.first_time[:, moving][:, :, moving]).any(axis=0)
        met = met | state.tied
        groups = np.arange(count)
        for a, b in zip(*np.nonzero(met), strict=True):
            if groups[a] != groups[b]:
                groups[groups == groups[b]] = groups[a]
        return groups

    def _symmetry(self, body):
        return self._symmetries.get(self._scene.bodies[body].name, NONE)

    def _aligned(self, state, bodies):
        """Return the state whose members have the same angle about the axes of symmetry of some bodies."""
        states = state.carry.states
        for body in bodies:
            states = self._symmetry(body).aligned(states, body)
        return state._replace(carry=state.carry._replace(states=states))

    # -- answers -----------------------------------------------------------------------------------

    def _members(self, state, time):
        """Return the members (N, B, 13); bodies with a filter in charge are drawn from the filter."""
        states = state.carry.states
        rng = np.random.default_rng((self._propagator.seed, state.carry.step, 0))
        for body, track in zip(self._scene.moving, state.tracks, strict=True):
            if track.mode is not TrackMode.PHYSICS:
                if states is state.carry.states:
                    states = states.copy()
                free = track.answer(time)
                root = symmetric_root(free.covariance)
                states[:, body] = whitened_draws(free.mean, root, len(states), rng)[:, 0]
        return states

    def _answer_mean(self, state, time):
        """Return the mean (B, 13) of `_answer`."""
        mean, _ = mean_and_errors(state.carry.states, self._scene.moving)
        return self._completed_mean(state, mean, time)

    def _completed_mean(self, state, mean, time):
        """Return the members' mean at an exact time, with the means of filters in charge."""
        delay = self._delay(state, time)
        for body, track in zip(self._scene.moving, state.tracks, strict=True):
            if track.mode is not TrackMode.PHYSICS:
                mean[body] = track.answer(time).mean
            elif delay:
                mean[body] = constant_velocity(mean[body].copy(), np.zeros((ERROR, ERROR)), delay, 0.0, 0.0)[
                    0
                ]
        return with_kinematic(self._scene, mean, time - self._origin)

    def _answer(self, state, time):
        """Return the belief of a state."""
        moving = self._scene.moving
        mean, errors = mean_and_errors(state.carry.states, moving)
        P = second_moment(errors) * (len(errors) / (len(errors) - 1.0))
        poses = np.r_[ERR_POSITION, ERR_ROTATION]
        for place, (body, track) in enumerate(zip(moving, state.tracks, strict=True)):
            own = slice(ERROR * place, ERROR * (place + 1))
            if track.mode is TrackMode.PHYSICS:
                P[ERROR * place + poses, ERROR * place + poses] += self._noise.shape_variance(
                    state.contact_share[body]
                )
            else:
                P[own], P[:, own] = 0.0, 0.0
                P[own, own] = track.answer(time).covariance
        return Belief.trusted(self._completed_mean(state, mean, time), P, moving)

    def _statuses(self, state, time):
        """Return the status of each moving body, by its name."""
        scene, found = self._scene, {}
        resting = histories.asleep(state.carry.contact_history, scene.world).mean(axis=0)
        for body, track in zip(scene.moving, state.tracks, strict=True):
            if track.mode is TrackMode.CARRIED:
                spread = float(np.sqrt(track.answer(time).covariance.diagonal()[ERR_POSITION].max()))
            else:
                spread = float(state.carry.states[:, body, :3].std(axis=0).max())
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

    def _report(self, time, measured, entry, replayed=0):
        """Return the report of an entry with the present statuses; ``entry`` is None if it was too late."""
        statuses = self._statuses(self._history[-1].state, self._history[-1].time)
        tracks = () if entry is None else entry.state.tracks
        distances = {
            self._scene.bodies[body].name: track.distance
            for body, track in zip(self._scene.moving, tracks, strict=entry is not None)
        }
        return Correction(
            time,
            {name: distances[name] for name in measured},
            () if entry is None else entry.rejected,
            tuple(name for name, status in statuses.items() if status is TrackStatus.CARRIED),
            tuple(name for name, status in statuses.items() if status is TrackStatus.LOST),
            statuses,
            entry is None,
            replayed,
        )

    # -- start and checks --------------------------------------------------------------------------

    def _start(self, scene, belief, tracks):
        """Return the members at the start: whitened draws, with zero for unknown velocities."""
        P, count = np.array(belief.joint), self._propagator.samples
        for place, track in enumerate(tracks):
            if track.mode is TrackMode.STARTING:
                for block in (ERR_VELOCITY, ERR_ANGULAR_VELOCITY):
                    own = slice(ERROR * place + block.start, ERROR * place + block.stop)
                    P[own], P[:, own] = 0.0, 0.0
        belief = Belief.trusted(belief.mean, P, belief.moving)
        rng = np.random.default_rng((self._propagator.seed, 0, 0))
        root = belief.root()
        z = rng.standard_normal((count, root.shape[1]))
        if root.shape[1] < count // 2:
            z = whitened(z)
        states = spread_states(belief.mean.copy(), belief.moving.copy(), np.einsum("nr,kr->nk", z, root))
        carry = self._propagator.start_rollouts(scene, belief, states)
        return carry._replace(
            parameters=whitened(carry.parameters) if carry.parameters.size else carry.parameters
        )

    def _moving_name(self, name):
        names = [self._scene.bodies[k].name for k in self._scene.moving]
        if name not in names:
            bodies = ", ".join(f"'{one}'" for one in names[:10]) + ", ..." * (len(names) > 10)
            raise InvalidRequestError(
                f"names no moving body of the scene, whose moving bodies are: {bodies or 'none'}",
                field="measurements",
                value=name,
            )
        return name

    def _check(self, measurements):
        instance(measurements, Mapping, "measurements")
        names = [body.name for body in self._scene.bodies]
        for name, measurement in measurements.items():
            self._moving_name(name)
            kinds = PoseMeasurement, PositionMeasurement, Relative
            instance(measurement, kinds, f"measurements['{name}']")
            if isinstance(measurement, Relative) and (
                measurement.reference not in names or measurement.reference == name
            ):
                raise InvalidRequestError(
                    "must be the name of another body of the scene",
                    field=f"reference of measurements['{name}']",
                    value=measurement.reference,
                )


def _new_track(mean, covariance, time, symmetry):
    """Return the track of a body that begins with a belief."""
    free = Filter(np.array(mean), np.array(covariance), time)
    return Track(TrackMode.PHYSICS if free.knows_velocities(symmetry) else TrackMode.STARTING, free)


def _check_tracked(scene, propagator):
    """Raise `NotSupportedError` for scenes whose members cannot be corrected."""
    check_supported(scene, propagator)
    for parameter in scene.uncertain:
        if parameter.name in ("center_of_mass", "trajectory", "released_at"):
            raise NotSupportedError("cannot be uncertain in a tracker", field=f"{parameter.name}")
    if scene.overlap == "reject":
        raise NotSupportedError("must be 'project' or 'keep' in a tracker", field="overlap", value="reject")


def _touching_support(history, world, time):
    """Return a history in which only sleeping bodies touch their supports, at a time.

    Steps do not search for contacts of sleeping bodies; contacts of awake ones appear in the next step.
    """
    first = np.full_like(history.first_time, np.inf)
    if history.solver is not None:
        bodies, memory = first.shape[1], history.solver
        still = histories.asleep(history, world) | ~np.asarray(world.bodies.moving, bool)
        n, k = np.nonzero(np.arange(memory.contact.shape[1]) < memory.count[:, None])
        i, j = memory.contact[n, k, 0], memory.contact[n, k, 1]
        rests = still[n, i] & ((j < 0) | still[n, np.maximum(j, 0)])
        low, high = np.where(j < 0, i, np.minimum(i, j)), np.where(j < 0, bodies - 1 - j, np.maximum(i, j))
        first[n[rests], low[rests], high[rests]] = time
    return history._replace(first_time=first)


def _with_fresh_adjustments(history, body, kept=None):
    """Return the history with the adjustments of a body's start replaced by those since a measurement.

    Only the overlap (N,) that it keeps without a force remains, by default as before.
    """
    if history.start is None:
        return history
    start = InitialAdjustment(*map(np.copy, history.start))
    kept = start.kept[:, body].copy() if kept is None else kept
    for values in start:
        values[:, body] = 0.0
    start.kept[:, body] = kept
    return history._replace(start=start)
