"""Tracked objects of the node: births, corrections, and forgetting."""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from unc_physics_msgs.msg import Action, Environment, ObjectState, TrackedObject
from unc_physics_msgs.msg import Scene as SceneMessage

from ..checks.errors import (
    DuplicateIdError,
    InvalidRequestError,
    LimitExceededError,
    NotReadyError,
    NotSupportedError,
    UncPhysicsError,
)
from ..checks.names import hint
from ..prediction.events import REST_ANGULAR_SPEED, REST_SPEED
from ..prediction.prediction import Prediction
from ..prediction.regions import BoxRegion
from ..propagators.names import REFERENCE
from ..propagators.registry import make_propagator
from ..scene.actions import PosePath
from ..scene.belief import Belief
from ..scene.body import RigidBody
from ..scene.body_belief import BodyBelief
from ..scene.marks import Mark
from ..scene.origins import gaussian_at_origins
from ..scene.scene import Scene
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    VELOCITY,
)
from ..tracking.ensemble import Gates
from ..tracking.hypotheses import UNKNOWN_SPIN
from ..tracking.measurements import PoseMeasurement
from ..tracking.report import TrackStatus
from ..tracking.symmetry import AxialSymmetry, turned_about
from ..tracking.tracker import Tracker
from .association import OF_POSITION, ObservationMemory, Place, assign
from .messages.actions import group_actions
from .messages.request import MARGINALS_ONLY, Job, RequestedOutputs, check_answer
from .messages.scene import AllSkippedError, read_scene, write_joint_covariance
from .messages.tracking import (
    ObservationRecord,
    before_first,
    check_path,
    read_measurement,
    write_present,
    write_tracked,
)
from .models import ModelLibrary
from .node_environment import NodeEnvironment, objects_of
from .parameters import AXES, Settings

#: Time without observations after which all objects are forgotten [s].
_LONGEST_GAP = 60.0
#: Rollouts of the tracker.
MEMBERS: Any = make_propagator(REFERENCE, samples=64, seed=1)
_VELOCITIES = np.r_[ERR_VELOCITY, ERR_ANGULAR_VELOCITY]
_MOVING = TrackStatus.TRACKED, TrackStatus.COASTING  # with physics


class PrescribedObject(NamedTuple):
    """Prescribed object.

    Attributes
    ----------
    state : ObjectState
    body : RigidBody
        With the path's times from ``stamp`` on.
    stamp : int
        [ns]
    """

    state: ObjectState
    body: RigidBody
    stamp: int


@dataclass
class ObservationReport:
    """Result of the observations of one time.

    Attributes
    ----------
    skipped : dict of str
        Reasons of observations that were left out, by id.
    accepted, rejected, duplicates, births : int
        Numbers of observations, and of new objects.
    hints : list of str
        What the user may want to set; each comes once.
    is_late, is_too_late : bool
        Whether the observations are older than earlier ones, and than the window.
    """

    skipped: dict[str, str] = field(default_factory=dict)
    accepted: int = 0
    rejected: int = 0
    duplicates: int = 0
    births: int = 0
    hints: list[str] = field(default_factory=list)
    is_late: bool = False
    is_too_late: bool = False


class Tracks:
    """Tracked objects of the node, in the world frame; one thread at a time may use them.

    Parameters
    ----------
    library : ModelLibrary
    environment : NodeEnvironment
    interrupt : callable, optional
        As for `Tracker`.
    """

    def __init__(
        self,
        library: ModelLibrary,
        environment: NodeEnvironment,
        interrupt: Callable[[], object] = lambda: None,
    ):
        self._library, self._environment, self._interrupt = library, environment, interrupt
        self._changes = 0
        self._turning: set[str] = set()  # models about which a hint was given
        self.clear()

    def clear(self) -> None:
        """Forget all objects and the paths of the robot."""
        self._tracker: Any = None  # a Tracker while objects are known
        self._change()
        self._epoch = self._stamp = self._observed = 0  # ns
        self._states: dict[str, ObjectState] = {}
        self._robots: dict[str, PrescribedObject] = {}
        self._seen: dict[str, ObservationRecord] = {}
        self._still: dict[str, np.ndarray] = {}  # first poses since an object moved, by id
        self._memory = ObservationMemory(self._library)
        self._numbers: dict[str, int] = {}  # of objects without an id, by model
        self._surroundings: tuple[int, Environment] = -1, Environment()
        self._dropped: dict[str, str] = {}  # reasons, by id

    def _change(self):
        self._ahead: Any = None  # fork of the tracker at the time of the newest belief, until a change
        self._changes += 1

    @property
    def stamp(self) -> int:
        """Time of the newest belief [ns]."""
        return self._stamp

    @property
    def names(self) -> list[str]:
        """Ids of the tracked objects."""
        return list(self._states)

    def take_dropped(self) -> dict[str, str]:
        """Return the reasons of objects that were dropped since the last call, by id.

        An object is dropped if it is invalid when a new environment, or a new object, needs another tracker.
        """
        dropped, self._dropped = self._dropped, {}
        return dropped

    # -- input -------------------------------------------------------------------------------------

    def observe(
        self, stamp: int, objects: Sequence[ObjectState], named: Collection[str], settings: Settings
    ) -> ObservationReport:
        """Take in observations of one time.

        Parameters
        ----------
        stamp : int
            [ns]
        objects : sequence of ObjectState
            Observed objects, in the world frame.
        named : collection of str
            Ids among theirs that the source gave.
        settings : Settings

        Raises
        ------
        UncPhysicsError
            If the node has no environment, or the simulation fails.
        """
        outcome = ObservationReport()
        self._environment.check_set(settings, "tracked")
        if self._tracker is not None and stamp > self._stamp + _LONGEST_GAP * 1e9:
            self._forget_objects()
        outcome.is_late = self._tracker is not None and stamp < self._observed
        found = []
        for own in objects:
            try:
                self._library.shape(own.model)
                found.append((own, read_measurement(own, settings.covariance_defaults)))
            except UncPhysicsError as error:
                outcome.skipped[own.id] = str(error)
        new = self._memory.new(stamp, found)
        outcome.duplicates = len(found) - len(new)
        if not new:
            return outcome
        if self._tracker is not None and stamp < self._observed - 1e9 * settings.tracking_window:
            outcome.is_too_late = True
            return outcome
        self._follow_environment(settings)
        self._change()
        seen, born = self._associated(stamp, new, named, settings, outcome.skipped)
        seen |= self._added(stamp, born, settings, outcome)
        seen = {name: measurement for name, measurement in seen.items() if name in self._states}
        if seen:
            tracker: Any = self._tracker  # which new objects may have begun
            report = tracker.correct(self._time(stamp), seen)
            outcome.is_too_late = report.too_late
            for name in seen if not report.too_late else ():
                self._note(name, stamp, report, outcome)
                self._watch_turning(name, seen[name], settings, outcome)
            self._observed = max(self._observed, stamp)
            self._stamp = max(self._stamp, stamp)
        self._forget_old(settings)
        return outcome

    def _note(self, name, stamp, report, outcome):
        rejected, old = name in report.rejected, self._seen[name]
        outcome.rejected += rejected
        outcome.accepted += not rejected
        newest = old.stamp if rejected else max(old.stamp, stamp)
        self._seen[name] = ObservationRecord(newest, float(report.distance[name]), old.rejections + rejected)

    def _watch_turning(self, name, measurement, settings, outcome):
        """Give one hint for a model that turns on the spot: it may look the same at every angle."""
        model = self._states[name].model
        if model in self._turning or model in settings.symmetries:
            return
        if measurement.covariance.diagonal()[3:].max() > 1.0:  # rad^2: its angle is not measured
            return
        axis = turned_about(self._still.setdefault(name, measurement.pose), measurement.pose)
        if axis == -1:
            self._still[name] = measurement.pose
        elif axis is not None:
            self._turning.add(model)
            outcome.hints.append(
                f"'{name}' turns on the spot: if {model} looks the same at every angle, set the parameter"
                f" symmetric_models: ['{model}:{AXES[axis]}']"
            )

    def advance(self, stamp: int, settings: Settings) -> None:
        """Advance to a time [ns] without observations; late ones may still arrive within the window."""
        if self._tracker is None or stamp <= self._stamp:
            return
        self._follow_environment(settings)
        if self._tracker is None:
            return
        self._stamp = stamp
        begin = self._time(stamp) - settings.tracking_window
        if begin > self._tracker.time:
            self._tracker.predict(begin)
        self._forget_old(settings)

    def act(
        self, stamp: int, objects: Sequence[ObjectState], actions: Sequence[Action], settings: Settings
    ) -> None:
        """Let prescribed objects follow paths whose times count from a stamp [ns].

        Raises
        ------
        UncPhysicsError
            Nothing is changed then.
        """
        given = {own.id: own for own in objects}
        grouped = group_actions(actions, {*given, *self._robots})
        for k, action in enumerate(actions):
            check_path(action, f"actions[{k}]")
        robots: dict[str, PrescribedObject] = {}
        for name, own in grouped.items():
            if name in self._states:
                raise DuplicateIdError("is the id of a tracked object", field="actions", value=name)
            state = given[name] if name in given else self._robots[name].state
            assert own.trajectory is not None
            read = read_scene(
                SceneMessage(objects=[state]),
                self._library,
                settings.physics,
                settings.covariance_defaults,
                settings.max_objects,
                actions=[own.trajectory[1]],
            )
            robots[name] = PrescribedObject(state, read.scene.bodies[0], stamp)
        self._change()
        for name, robot in robots.items():
            is_new = name not in self._robots
            self._robots[name] = robot
            if self._tracker is not None:
                body = self._moved(robot)
                if is_new:
                    self._tracker.add(body, _first_pose(body))
                else:
                    self._tracker.act({name: body.trajectory})

    def forget(self, ids: Iterable[str], settings: Settings) -> None:
        """Forget objects.

        Raises
        ------
        InvalidRequestError
            If an id is unknown; nothing is forgotten then.
        """
        ids = list(ids)
        known = [*self._states, *self._robots]
        for k, name in enumerate(ids):
            if name not in known:
                raise InvalidRequestError(
                    f"is no tracked object{hint(name, known)}", field=f"ids[{k}]", value=name
                )
        for name in dict.fromkeys(ids):
            self._remove(name, settings)

    # -- answers -----------------------------------------------------------------------------------

    def fork(self) -> Tracks:
        """Return a copy at the time of the newest belief, which shares nothing that changes."""
        other = copy.copy(self)
        for name in ("_states", "_robots", "_seen", "_numbers"):
            setattr(other, name, dict(getattr(self, name)))
        other._memory, other._ahead, other._dropped = ObservationMemory(self._library), None, {}
        newest = self._tracker if self._ahead is None else self._ahead
        if newest is not None:
            other._tracker = newest.fork()
        return other

    def arrive(self) -> None:
        """Advance a fork to the time of the newest belief."""
        if self._tracker is not None and (now := self._time(self._stamp)) > self._tracker.time:
            self._tracker.predict(now)

    def keep(self, fork: Tracks) -> None:
        """Keep the advanced tracker of a fork, from which later forks begin if nothing has changed."""
        if fork._changes == self._changes and fork._tracker is not None:
            self._ahead = fork._tracker.fork()

    def messages(self) -> list[TrackedObject]:
        """Return the tracked objects of a fork."""
        if self._tracker is None:
            return []
        tracker = self._tracker
        models = {name: own.model for name, own in self._states.items()}
        return write_tracked(tracker.scene, tracker.belief(), tracker.statuses(), models, self._seen)

    def predict(
        self,
        marks: Sequence[Mark],
        settings: Settings,
        outputs: RequestedOutputs = MARGINALS_ONLY,
        regions: tuple[BoxRegion, ...] = (),
        samples: int = 0,
        propagator: Any = MEMBERS,
    ) -> tuple[Job, Prediction]:
        """Predict from the belief of a fork.

        Parameters
        ----------
        marks : sequence of Mark
        settings : Settings
        outputs : RequestedOutputs
        regions : tuple of BoxRegion
        samples : int
            Number of samples in the answer.
        propagator : Propagator, optional
            Of samples. Its samples are as many of the tracker's members.

        Raises
        ------
        UncPhysicsError
        """
        scene = self.scene
        given = {body.name: ObjectState() for body in scene.bodies} | self._given  # elements are bodies, too
        job = Job(
            scene=scene,
            belief=self._tracker.belief(),
            models=tuple(given[body.name].model or body.model.name for body in scene.bodies),
            propagator=propagator,
            marks=marks,
            seed=MEMBERS.seed,
            regions=regions,
            return_samples=samples,
            outputs=outputs,
        )
        check_answer(job, settings)
        return job, self._tracker.ahead([mark.time for mark in marks], propagator.samples)

    @property
    def scene(self):
        """Scene of a fork.

        Raises
        ------
        InvalidRequestError
            If nothing is tracked.
        """
        if self._tracker is None:
            raise InvalidRequestError(
                "holds no objects: none was observed, or all are forgotten", field="the tracker"
            )
        return self._tracker.scene

    @property
    def _given(self):
        """Objects and prescribed objects as they were given, by id."""
        return self._states | {name: robot.state for name, robot in self._robots.items()}

    def motions(self, name: str) -> list[tuple[Scene, Belief]]:
        """Return the scene and the belief of a fork for each motion that is possible.

        These are the motion that is believed, and, where velocities are zero within their spread, rest. Rest
        is the likely one of both, and comes first: a Gaussian gives it no weight of its own.

        Raises
        ------
        InvalidRequestError
            If nothing is tracked.
        NotReadyError
            If nothing is known yet about how the object with the ``name`` moves by itself.
        """
        scene, belief, statuses = self.scene, self._tracker.belief(), self._tracker.statuses()
        if name in self._states and (status := statuses[name]) not in (*_MOVING, TrackStatus.RESTING):
            reason = "moves in a way that physics does not explain yet; ask again"
            raise NotReadyError(f"{reason} (its status is {status.name})", field="object", value=name)
        supposed = [
            b
            for b in scene.moving.tolist()
            if statuses[scene.bodies[b].name] in _MOVING and _may_rest(belief, b)
        ]
        if not supposed:
            return [(scene, belief)]
        mean = belief.mean.copy()
        mean[supposed, VELOCITY] = mean[supposed, ANGULAR_VELOCITY] = 0.0
        return [(scene, Belief.trusted(mean, belief.covariance, belief.moving)), (scene, belief)]

    def scene_message(self) -> tuple[SceneMessage, list[Action]]:
        """Return the scene of a fork with its belief, and the paths from its time on."""
        scene, belief = self.scene, self._tracker.belief()
        given = self._given
        found = [
            write_present(given[body.name], body, belief.mean[b], belief.marginal(b), self._tracker.time)
            for b, body in enumerate(scene.bodies)
            if body.name in given
        ]
        message = SceneMessage(objects=[own for own, _ in found])
        message.environment = Environment(elements=self._surroundings[1].elements, complete=True)
        origins = np.array([body.model.origin for body in scene.bodies])
        message.joint_covariance = write_joint_covariance(scene, belief, origins)
        return message, [action for _, actions in found for action in actions]

    # -- association -------------------------------------------------------------------------------

    def _associated(self, stamp, found, named, settings, skipped):
        """Return measurements of tracked objects by id, and those of new ones with their states."""
        seen: dict[str, PoseMeasurement] = {}
        born: dict[str, tuple[ObjectState, PoseMeasurement]] = {}
        new, loose = [], []  # with a new id, and without one
        for own, measurement in found:
            known, place = self._states.get(own.id), Place.of(own.model, measurement)
            if settings.association != "id" or own.id not in named:
                loose.append((own, measurement, place))
            elif own.id in self._robots:
                skipped[own.id] = "id must be that of no prescribed object"
            elif known is None:
                new.append((own, measurement, place))
            elif known.model != own.model:
                skipped[own.id] = f"model must be '{known.model}', as before (got '{own.model}')"
            else:
                seen[own.id] = measurement
        if not (new or loose):
            return seen, born
        expected = self._expected(stamp)
        there = expected | {name: Place.of(self._states[name].model, one) for name, one in seen.items()}
        # two solids of one model are not in one place: one that is observed there under its own id, too,
        # was detected twice, and one that is not has changed its id
        for own, measurement, place in new:
            other = self._memory.same_object(place, there)
            if other is None:
                born[own.id], there[own.id] = (own, measurement), place
            elif other in seen or other in born:
                skipped[own.id] = f"is a second observation of '{other}'"
            else:
                seen[other], there[other] = measurement, place
                skipped[own.id] = f"is where '{other}' is, and corrects that: its id has changed"
        unseen = [name for name in expected if name not in seen]
        places = [place for *_, place in loose]
        pairs = assign([expected[name] for name in unseen], places, settings.association_distance)
        for i, j in pairs:
            _, seen[unseen[i]], there[unseen[i]] = loose[j]
        paired = {j for _, j in pairs}
        for own, measurement, place in (one for j, one in enumerate(loose) if j not in paired):
            if (other := self._memory.same_object(place, there)) is not None:
                skipped[own.id] = f"is a second observation of '{other}'"
            elif self._memory.confirms(place, stamp, settings.association_distance):
                name = own.id if own.id in named else None
                born[self._new_name(own.model, name, born)] = own, measurement
        return seen, born

    def _expected(self, stamp):
        """Return where tracked objects are expected at a time, by their ids."""
        if self._tracker is None:
            return {}
        scene = self._tracker.scene
        try:
            belief = self._tracker.belief(self._time(stamp))
        except InvalidRequestError:  # from before the newest object; the correction will say so
            belief = self._tracker.belief()
        there = gaussian_at_origins(belief, np.array([body.model.origin for body in scene.bodies]))
        found = {}
        for row, b in enumerate(scene.moving.tolist()):
            if (name := scene.bodies[b].name) in self._states:
                P = there.blocks[row][OF_POSITION, OF_POSITION]
                found[name] = Place(self._states[name].model, there.mean[b, POSITION], P)
        return found

    def _new_name(self, model, given, born):
        taken = {*self._states, *self._robots, *born}
        if given is not None and given not in taken:
            return given
        while True:
            number = self._numbers[model] = self._numbers.get(model, 0) + 1
            if (name := f"{model}_{number}") not in taken:
                return name

    # -- bodies ------------------------------------------------------------------------------------

    def _time(self, stamp):
        """Return a stamp [ns] on the tracker's clock [s]."""
        return 1e-9 * (stamp - self._epoch)

    def _moved(self, robot):
        path = robot.body.trajectory
        later = PosePath.of_states(path.times + self._time(robot.stamp), path.states)
        return replace(robot.body, trajectory=later)

    def _added(self, stamp, born, settings, outcome):
        """Add new objects; return the measurements of those that were added, by their ids."""
        states = {}
        for name, (own, _) in born.items():
            try:
                if len(self._states) + len(states) >= settings.max_objects:
                    raise LimitExceededError(
                        f"must be at most {settings.max_objects}", field="tracked objects", value=name
                    )
                state = before_first(own, settings.covariance_defaults)
                state.id, states[name] = name, state
            except UncPhysicsError as error:
                outcome.skipped[name] = str(error)
        if not states:
            return {}
        if self._tracker is None:
            added = self._build(stamp, list(states.values()), settings, outcome.skipped)
            self._states |= {name: states[name] for name in added}
        elif self._time(stamp) < self._tracker.time:
            for name in states:
                outcome.skipped[name] = "is new, and was observed before the newest observation of the others"
            return {}
        else:
            self._tracker.predict(self._time(stamp))
            for name, state in states.items():  # another tracker for one has those before it, too
                if self._add(stamp, state, settings, outcome.skipped):
                    self._states[name] = state
            added = [name for name in states if name in self._states]
        for name in added:
            self._seen[name] = ObservationRecord(stamp)
        outcome.births += len(added)
        return {name: born[name][1] for name in added}

    def _add(self, stamp, state, settings, skipped):
        """Add an object at the tracker's time, which is a stamp [ns]; return whether it is valid."""
        if self._tracker is None:  # all objects were dropped
            return bool(self._build(stamp, [state], settings, skipped))
        read = self._read([state], settings, skipped)
        if read is None:
            return False
        mean = read.belief.mean[0]
        belief = BodyBelief(
            position=mean[POSITION],
            orientation=mean[QUATERNION],
            linear_velocity=mean[VELOCITY],
            angular_velocity=mean[ANGULAR_VELOCITY],
            covariance=read.belief.blocks[0],
        )
        if state.id in objects_of(self._surroundings[1]):  # a planning scene has the object, too
            return self._rebuild(settings, state)
        try:
            self._tracker.add(read.scene.bodies[0], belief, _symmetry(state.model, settings))
        except NotSupportedError:  # it has uncertain parameters
            return self._rebuild(settings, state)
        return True

    def _read(self, states, settings, skipped):
        """Return objects with the node's environment around them; None if none is valid."""
        message = SceneMessage(objects=states)
        try:
            read = read_scene(
                message,
                self._library,
                settings.physics,
                settings.covariance_defaults,
                settings.max_objects,
                environment=self._environment.around(message),
                skip_invalid_objects=True,
            )
        except AllSkippedError as error:
            skipped.update(error.skipped)
            return None
        skipped.update(read.skipped)
        return read

    def _build(self, stamp, states, settings, skipped, known_of=None):
        """Begin a tracker with some objects; return the ids of valid ones.

        Parameters
        ----------
        stamp : int
            [ns]
        states : list of ObjectState
        settings : Settings
        skipped : dict of str
        known_of : callable, optional
            Takes the belief of the states and the names of the moving bodies; returns another belief.
        """
        message = SceneMessage(objects=states)
        self._surroundings = self._environment.version, self._environment.around(message)
        read = self._read(states, settings, skipped)
        if read is None:
            return []
        self._epoch = self._stamp = stamp
        self._change()
        names = [read.scene.bodies[b].name for b in read.scene.moving]
        scene, belief = read.scene, read.belief if known_of is None else known_of(read.belief, names)
        if robots := [self._moved(robot) for robot in self._robots.values()]:
            scene = replace(scene, bodies=[*scene.bodies, *robots])
            first = [path.states[0] for body in robots if (path := body.trajectory) is not None]
            belief = Belief.trusted(np.array([*belief.mean, *first]), belief.covariance, belief.moving)
        found = {own.id: _symmetry(own.model, settings) for own in states if own.id in names}
        self._tracker = Tracker(
            scene,
            belief,
            members=MEMBERS.samples,
            window=settings.tracking_window,
            seed=MEMBERS.seed,
            symmetries={name: own for name, own in found.items() if own is not None},
            interrupt=self._interrupt,
        )
        return names

    def _rebuild(self, settings, *new):
        """Begin a tracker with the belief of the present one, in the node's present environment.

        Objects that are invalid there are dropped (`take_dropped`). ``new`` are objects that the present
        tracker does not have yet; return whether all of them are valid.
        """
        old, scene, newest = self._tracker.belief(), self._tracker.scene, self._stamp
        rows = {scene.bodies[b].name: k for k, b in enumerate(old.moving.tolist())}

        def known_of(belief, names):
            mean, joint = belief.mean.copy(), belief.joint.copy()
            kept = [k for k, name in enumerate(names) if name in rows]
            before = [rows[names[k]] for k in kept]
            mean[belief.moving[kept]] = old.mean[old.moving[before]]
            there, here = (_rows_of(places) for places in (before, kept))
            joint[np.ix_(here, here)] = old.joint[np.ix_(there, there)]
            return Belief.trusted(mean, joint, belief.moving)

        stamp, invalid = self._epoch + round(1e9 * self._tracker.time), {}
        if not self._build(stamp, [*self._states.values(), *new], settings, invalid, known_of):
            self._tracker = None
            self._change()
        for name in invalid:
            self._still.pop(name, None)
            self._states.pop(name, None)
            self._seen.pop(name, None)
        self._dropped.update(invalid)
        self._stamp = newest
        return not any(own.id in invalid for own in new)

    def _follow_environment(self, settings):
        """Begin a new tracker if the node's environment has changed."""
        if self._tracker is None or self._surroundings[0] == self._environment.version:
            return
        message = SceneMessage(objects=list(self._states.values()))
        environment = self._environment.around(message)
        if environment == self._surroundings[1]:
            self._surroundings = self._environment.version, environment
        else:
            self._rebuild(settings)

    def _forget_old(self, settings):
        """Forget objects that were not observed for too long."""
        limit = 1e9 * settings.forget_after
        if limit:
            for name in [one for one, seen in self._seen.items() if self._stamp - seen.stamp > limit]:
                self._remove(name, settings)

    def _remove(self, name, settings):
        self._change()
        robot, state = self._robots.pop(name, None), self._states.pop(name, None)
        self._seen.pop(name, None)
        self._still.pop(name, None)
        if self._tracker is None:
            return
        if not self._states:
            self._tracker = None
        elif robot is not None or state is not None:
            try:
                self._tracker.remove(name)
            except NotSupportedError:  # uncertain parameters vanish with it
                self._rebuild(settings)

    def _forget_objects(self):
        """Forget all objects, and keep the paths of the robot."""
        robots = self._robots
        self.clear()
        self._robots = robots


def warm_up_tracker(scene: Scene, belief: Belief, _propagator: object, horizon: float) -> None:
    """Track a scene for a few steps, so that what it needs is compiled or loaded."""
    P = belief.covariance.copy()
    P[:, _VELOCITIES, _VELOCITIES] = UNKNOWN_SPIN**2  # until the second observation
    scene = replace(scene, bodies=[replace(body, at_rest=False) for body in scene.bodies])
    tracker = Tracker(scene, Belief.trusted(belief.mean, P, belief.moving))
    poses = np.concatenate([belief.mean[:, POSITION], belief.mean[:, QUATERNION]], axis=1)
    seen = {
        scene.bodies[b].name: PoseMeasurement(poses[b], np.full(6, 1e-3), "model")
        for b in scene.moving.tolist()
    }
    for k in (1, 2):
        tracker.correct(k * horizon, seen)
    tracker.ahead([horizon])


def _rows_of(places):
    """Return the rows in a joint covariance of moving bodies by their places."""
    return (ERROR * np.array(places, int)[:, None] + np.arange(ERROR)).ravel()


def _symmetry(model, settings):
    """Return the symmetry of a model; None if it has none."""
    axis = settings.symmetries.get(model)
    return None if axis is None else AxialSymmetry(np.eye(3)[AXES.index(axis)])


def _may_rest(belief, b):
    """Return whether the tracker would accept a measurement of body b that it is at rest."""
    u = np.concatenate([belief.mean[b, VELOCITY], belief.mean[b, ANGULAR_VELOCITY]])
    rest = np.repeat([REST_SPEED**2, REST_ANGULAR_SPEED**2], 3) / Gates().soft
    S = belief.marginal(b)[np.ix_(_VELOCITIES, _VELOCITIES)] + np.diag(rest)
    return u @ np.linalg.solve(S, u) < Gates().soft


def _first_pose(body):
    """Return the belief about a prescribed body at the start of its path."""
    state = body.trajectory.states[0]
    return BodyBelief(position=state[POSITION], orientation=state[QUATERNION])
