"""Tracker: a belief that is kept while measurements arrive, through contact, rest and occlusion."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..checks.errors import InvalidRequestError, NotSupportedError
from ..checks.names import hint
from ..checks.shown import counted_bodies
from ..checks.validation import instance, integer, number, positive
from ..compiler.compile_time import clock
from ..prediction.prediction import Prediction
from ..prediction.request_checks import check_supported, marks_of
from ..propagators.monte_carlo import MonteCarlo
from ..propagators.start import constrain_belief
from ..scene.actions import PosePath
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.environment import thing_names
from ..scene.pairs import pairs_among
from ..scene.scene import Scene
from ..spatial.layout import ERROR
from .answers import belief_at, members_at, prediction_from, statuses_at
from .ensemble import Gates
from .history import Entry, History
from .hypotheses import Filter, new_track
from .measurements import Measurement, PoseMeasurement, PositionMeasurement
from .measurements import RelativePoseMeasurement as Relative
from .members import first_members, with_fewer, with_last_body, without_body, woken
from .noise import ContactNoise
from .report import Correction, TrackStatus
from .state import State, TrackedScene, go_on
from .symmetry import AxialSymmetry, checked_symmetries, checked_symmetry

_FEWEST = 8  # members


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
    interrupt : callable, optional
        Called without arguments at least every thirtieth of a second of simulated time. An exception from it
        ends the call, and the tracker stays as it was.

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
        interrupt: Callable[[], object] = go_on,
    ):
        instance(scene, Scene, "scene")
        instance(belief, Belief, "belief")
        instance(noise, ContactNoise, "noise")
        belief.check_fits(scene)
        members = integer(members, "members", low=_FEWEST)
        propagator = MonteCarlo(samples=members, seed=integer(seed, "seed", low=0))
        self._window = positive(window, "window")
        self._time = number(time, "time")
        _check_tracked(scene, propagator)
        if scene.integrator != "explicit":
            scene = replace(scene, sleep=True)
        tracked = TrackedScene(
            scene,
            checked_symmetries({} if symmetries is None else symmetries, scene),
            propagator,
            noise,
            gates,
            self._time,
            interrupt,
        )
        belief = constrain_belief(scene, belief)
        tracks = tuple(
            new_track(Filter(np.array(belief.mean[body]), np.array(P), self._time), tracked.symmetry(body))
            for body, P in zip(belief.moving, belief.blocks, strict=True)
        )
        carry = first_members(tracked, belief, tracks)
        blocks = np.abs(belief.joint).reshape(len(tracks), ERROR, len(tracks), ERROR)
        tied = blocks.max(axis=(1, 3)) > 0.0
        # bodies that settled at the start move freely from then on
        free = replace(scene, bodies=[replace(body, at_rest=False) for body in scene.bodies])
        self._tracked = replace(tracked, scene=free)
        self._history = History(self._time, State(carry, np.zeros(len(scene.bodies)), tracks, tied))

    def __repr__(self) -> str:
        bodies = counted_bodies([body.name for body in self.scene.bodies])
        return f"<Tracker of {bodies} at {self.time:g} s>"

    @property
    def scene(self) -> Scene:
        """Simulated scene."""
        return self._tracked.scene

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
        given = {name: measurements[name] for name in self._tracked.names if name in measurements}
        if self._history.is_before(time):
            return self._report(time, (), None)
        entry, replayed = self._history.add(self._tracked, time, given)
        self._time = max(self._time, time)
        self._history.forget(self._time - self._window)
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
        self._history.advance(self._tracked, time)
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
        return belief_at(self._tracked, self._state_at(time), time)

    def status(self, name: str) -> TrackStatus:
        """Return the status of a moving body."""
        return self.statuses()[self._moving_name(name, "name")]

    def statuses(self) -> dict[str, TrackStatus]:
        """Return the statuses of all moving bodies, by name."""
        return statuses_at(self._tracked, self._state_at(self._time), self._time)

    def samples(self) -> np.ndarray:
        """Return the members' states (N, B, 13) at the tracker's time."""
        return members_at(self._tracked, self._state_at(self._time), self._time)

    def parameters(self) -> dict[str, tuple[float, float]]:
        """Return mean and standard deviation of the scene's uncertain parameters, in standard deviations.

        Keys are ``"stiffness"`` for a parameter of the whole scene, ``"friction of can"`` for one of a body
        or an element, and ``"gravity_direction[0]"`` for one direction of several.
        """
        z = self._state_at(self._time).carry.parameters
        return {
            key: (float(z[:, k].mean()), float(z[:, k].std(ddof=1)))
            for k, key in enumerate(_parameter_names(self.scene))
        }

    def ahead(self, times: float | Sequence[float], members: int | None = None) -> Prediction:
        """Predict from the present belief; the tracker does not change.

        Parameters
        ----------
        times : float or sequence of float
            One time or several, from the tracker's time on, ascending [s].
        members : int, optional
            How many of the tracker's members are simulated, evenly spaced; by default all. Fewer take less
            time.

        Returns
        -------
        Prediction
            Its times and contact times are from the tracker's time on.
        """
        started = clock()
        marks, state = marks_of(self.scene, None, times), self._state_at(self._time)
        if members is not None:
            state = with_fewer(state, integer(members, "members", low=_FEWEST))
        return prediction_from(self._tracked, state, self._time, marks, started)

    def fork(self) -> Tracker:
        """Return an independent tracker in the same state, for what-if questions."""
        other = copy.copy(self)
        other._history = self._history.copy()
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
        state, old = self._state_at(self._time), self.scene
        scene = replace(old, bodies=[*old.bodies, replace(body, at_rest=False)])
        _check_tracked(scene, self._tracked.propagator)
        if len(scene.uncertain) != len(old.uncertain):
            raise NotSupportedError("must have no uncertain parameters when it is added", field="body")
        own = {} if symmetry is None else {body.name: checked_symmetry(symmetry, "symmetry")}
        tracked = replace(self._tracked, scene=scene, symmetries={**self._tracked.symmetries, **own})
        known = belief.at_center_of_mass(body.model.origin)
        self._begin_anew(tracked, with_last_body(tracked, state, known, self._time))

    def remove(self, name: str) -> None:
        """Remove a body at the tracker's time; earlier measurements no longer count.

        Sleeping bodies wake up, as the body may have carried them.
        """
        names, old = self._tracked.names, self.scene
        if name not in names:
            raise InvalidRequestError(
                f"is no body of the scene{hint(str(name), names)}", field="name", value=name
            )
        state = self._state_at(self._time)
        pairs = pairs_among(old.pairs, {*thing_names(old)} - {name})
        scene = replace(old, bodies=[body for body in old.bodies if body.name != name], pairs=pairs)
        if len(scene.uncertain) != len(old.uncertain):
            raise NotSupportedError("must have no uncertain parameters to be removed", field=f"body '{name}'")
        symmetries = {own: found for own, found in self._tracked.symmetries.items() if own != name}
        tracked = replace(self._tracked, scene=scene, symmetries=symmetries)
        self._begin_anew(tracked, without_body(old, state, names.index(name)))

    def act(self, paths: Mapping[str, PosePath]) -> None:
        """Replace the paths of prescribed bodies, from the tracker's time on.

        Parameters
        ----------
        paths : mapping of str to PosePath
            Their times are seconds since the tracker's first time, as in the scene's paths. Each path must
            continue at the present pose of its body.
        """
        names, bodies = self._tracked.names, list(self.scene.bodies)
        for name, path in paths.items():
            instance(path, PosePath, f"paths['{name}']")
            if name not in names or bodies[names.index(name)].trajectory is None:
                raise InvalidRequestError("is no prescribed body of the scene", field="paths", value=name)
            bodies[names.index(name)] = replace(bodies[names.index(name)], trajectory=path)
        state = woken(self._state_at(self._time))
        self._begin_anew(replace(self._tracked, scene=replace(self.scene, bodies=bodies)), state)

    def _state_at(self, time):
        return self._history.state_at(self._tracked, time)

    def _begin_anew(self, tracked, state):
        """Go on with another scene from a state at the tracker's time, without earlier measurements."""
        self._tracked, self._history = tracked, History(self._time, state)

    def _report(self, time, measured, entry: Entry | None, replayed=0):
        """Return the report of an entry with the present statuses; ``entry`` is None if it was too late."""
        last, scene = self._history.last, self.scene
        statuses = statuses_at(self._tracked, last.state, last.time)
        tracks = () if entry is None else entry.state.tracks
        distances = {
            scene.bodies[body].name: track.distance
            for body, track in zip(scene.moving, tracks, strict=entry is not None)
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

    def _moving_name(self, name, field):
        names = [self._tracked.names[k] for k in self.scene.moving]
        if name not in names:
            bodies = ", ".join(f"'{one}'" for one in names[:10]) + ", ..." * (len(names) > 10)
            raise InvalidRequestError(
                f"names no moving body of the scene, whose moving bodies are: {bodies or 'none'}",
                field=field,
                value=name,
            )
        return name

    def _check(self, measurements):
        instance(measurements, Mapping, "measurements")
        names = self._tracked.names
        for name, measurement in measurements.items():
            self._moving_name(name, "measurements")
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


def _parameter_names(scene):
    """Return a name for each uncertain parameter of a scene."""
    uncertain, things = scene.uncertain, thing_names(scene)
    several = {(parameter.name, parameter.body) for parameter in uncertain if parameter.axis}
    return [
        parameter.name
        + f"[{parameter.axis}]" * ((parameter.name, parameter.body) in several)
        + (f" of {things[parameter.body]}" if parameter.body >= 0 else "")
        for parameter in uncertain
    ]


def _check_tracked(scene, propagator):
    """Raise `NotSupportedError` for scenes whose members cannot be corrected."""
    check_supported(scene, propagator)
    for parameter in scene.uncertain:
        if parameter.name in ("center_of_mass", "trajectory", "released_at"):
            raise NotSupportedError("cannot be uncertain in a tracker", field=f"{parameter.name}")
    if scene.overlap == "reject":
        raise NotSupportedError("must be 'project' or 'keep' in a tracker", field="overlap", value="reject")
