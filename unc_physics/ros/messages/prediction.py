"""Prediction messages, whose conventions are those of `scene`."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Pose, PoseWithCovariance
from std_msgs.msg import Header

from unc_physics_msgs.msg import Event as EventMessage
from unc_physics_msgs.msg import MaterialPair, ObjectState, PredictedObject, PredictedState
from unc_physics_msgs.msg import Prediction as PredictionMessage

from ...checks.errors import DivergedError
from ...prediction.events import Event, Touches
from ...prediction.evidence import overlap_shares
from ...prediction.notes import ENDLESS
from ...prediction.prediction import Prediction
from ...prediction.status import assess_all
from ...propagators.base import Samples, rollout_count
from ...scene.belief import Belief
from ...scene.contact_world import materials_of_pairs
from ...scene.environment import thing_names
from ...scene.origins import gaussian_at_origins
from ...scene.physics_keys import PHYSICS_KEYS
from ...scene.physics_summary import physics_as_text
from ...scene.scene import Scene
from ...shapes.distance import signed_distance
from ...spatial.layout import ANGULAR_VELOCITY, ERR_POSITION, ERROR, POSITION, QUATERNION, VELOCITY
from ...spatial.origin import at_origin
from ...spatial.rotation import rotation_matrix
from .environment import write_pair
from .events import write_event
from .fields import duration, later, packed, pose_message, writable
from .physics import physics_message
from .request import MARGINALS_ONLY, Job
from .scene import write_joint_covariance

#: Most states of one object that are assessed separately, as documented in the message.
ASSESSED_STATES = 16
_SAME_POINT = np.zeros(3)
_BOTTOMLESS = "it would fall for ever, as nothing is below it: give the scene or the node an environment"
_SIGMAS, _SURFACE_ERROR = 3.0, 2e-3  # standard deviations, and error of a model's surface [m]
_NOTE = "note: "  # before each note of a status, in ``status_msg``


def write_answer(message: PredictionMessage, header: Header, settings, job: Job, prediction: Prediction):
    """Write the prediction of a job into its message.

    Parameters
    ----------
    message : unc_physics_msgs/Prediction
    header : Header
        Header whose stamp is written, with the world frame.
    settings : Settings
    job : Job
    prediction : Prediction
        Prediction, which may end before the horizon.

    Raises
    ------
    DivergedError
        If a number is not finite.
    """
    used, outputs, times = prediction.scene, job.outputs, prediction.times
    at_origins = [one.at_model_origins(used, outputs.joint_covariance) for one in prediction.snapshots]
    objects, joints = write_prediction(
        job.scene, job.models, times, at_origins, _drawn(job, prediction), outputs
    )
    write_start(objects, job.scene, prediction.start)
    if job.outputs.modes:
        write_modes(objects, prediction)
    message.header.stamp = header.stamp
    message.header.frame_id = settings.world_frame
    message.propagator = job.propagator.name
    message.physics, message.physics_summary = _physics(used)
    message.rollouts = rollout_count(prediction.carry)
    errors = None
    if isinstance(job.propagator, Samples):
        errors = job.propagator.standard_errors(prediction.carry, used)
    if errors is not None:
        message.has_errors = True
        message.position_error = float(errors.position.max(initial=0.0))
        message.rotation_error = float(errors.rotation.max(initial=0.0))
        message.probability_error = 0.5 / math.sqrt(message.rollouts) if errors.relative.any() else 0.0
    message.objects = objects
    message.skipped = [KeyValue(key=name, value=reason) for name, reason in job.skipped.items()]
    message.joint_covariances = joints
    write_statuses(message, prediction)
    write_notes(message.objects, job)
    message.events = write_events(prediction, job.events)
    message.pairs = write_pairs(used, job.events)
    message.seed = job.seed
    message.time_reached = duration(prediction.time)
    message.valid_until = later(header.stamp, message.time_reached)
    message.computation_time = duration(prediction.wall_time)


def write_prediction(scene, models, times, beliefs, samples=None, outputs=MARGINALS_ONLY):
    """Return a prediction as messages.

    Parameters
    ----------
    scene : Scene
    models : sequence of str
        Names of the bodies' models.
    times : sequence of float
        Times of the beliefs from the start [s].
    beliefs : sequence of Belief
        At the points that the message is about.
    samples : sequence of (N, B, 13) arrays, optional
        States drawn from each belief.
    outputs : RequestedOutputs

    Returns
    -------
    objects : list of PredictedObject
        In the order of the scene.
    joint_covariances : list of JointCovariance
        One for each time, if requested.

    Raises
    ------
    DivergedError
        If a number is not finite.
    """
    objects = [
        PredictedObject(
            id=body.name,
            model=model,
            kind=_kind(body),
            status=PredictedObject.STATUS_NOT_ASSESSED,
            status_msg="no check was made",
        )
        for body, model in zip(scene.bodies, models, strict=True)
    ]
    joints, states = [], [[] for _ in objects]
    origins = [writable(body.model.origin) for body in scene.bodies]
    known = {b: row for row, b in enumerate(scene.moving.tolist())}
    certain = np.zeros((ERROR, ERROR))
    for k, (time, belief) in enumerate(zip(times, beliefs, strict=True)):
        means, blocks, since = writable(belief.mean), writable(belief.blocks), duration(time)
        for b in range(len(objects)):
            state = PredictedState(time_from_start=since, status=PredictedObject.STATUS_NOT_ASSESSED)
            P = write_state(state, means[b], blocks[known[b]] if b in known else certain)
            if outputs.covariance:
                state.covariance = packed(P)
            if samples is not None:
                state.pose_samples = _origin_poses(samples[k][:, b], origins[b])
            states[b].append(state)
        if outputs.joint_covariance:
            joints.append(write_joint_covariance(scene, belief, np.zeros((len(objects), 3))))
            joints[-1].time_from_start = since
    for answer, own in zip(objects, states, strict=True):
        answer.states = own
    return objects, joints


def write_modes(objects, prediction: Prediction) -> None:
    """Write the modes of each object into its last state."""
    for message, body in zip(objects, prediction.scene.bodies, strict=True):
        found = prediction[body.name].modes
        last = message.states[-1]
        last.mode_weights = packed([mode.weight for mode in found])
        if len(found) == 1:
            last.modes = [last.pose]
            continue
        last.modes = [PoseWithCovariance() for _ in found]
        for written, mode in zip(last.modes, found, strict=True):
            gaussian = Belief.trusted(mode.mean[None], mode.covariance[None], np.array([0]))
            there = gaussian_at_origins(gaussian, writable(body.model.origin)[None])
            _write_pose(written, there.mean[0], there.blocks[0])


def write_start(objects, scene, belief) -> None:
    """Write the belief at time 0 into each PredictedObject; overlap removal may have changed it."""
    for k, (message, body) in enumerate(zip(objects, scene.bodies, strict=True)):
        _write_pose(message.start, belief.mean[k], belief.marginal(k), writable(body.model.origin))


def write_statuses(message, prediction) -> None:
    """Write the status of each object, and of each of its states, into a `Prediction` message.

    Parameters
    ----------
    message : unc_physics_msgs/Prediction
        Message with its objects and their states.
    prediction : Prediction

    Notes
    -----
    Of more than `ASSESSED_STATES` states, that many are assessed, evenly spaced and including the last one.
    The states before an assessed one share its flags.
    """
    count = len(prediction.times)
    parts = min(count, ASSESSED_STATES)
    ends = [count * (part + 1) // parts for part in range(parts)]
    assessed = replace(prediction, snapshots=tuple(prediction.snapshots[end - 1] for end in ends))
    begin = 0
    for end, statuses in zip(ends, assess_all(assessed, rollouts=0), strict=True):
        for predicted, status in zip(message.objects, statuses, strict=True):
            for state in predicted.states[begin:end]:
                state.status = int(status.flags)
        begin = end
    shares = overlap_shares(prediction)
    for predicted, status, share in zip(message.objects, statuses, shares, strict=True):  # of the last time
        predicted.overlap_share = float(share)
        texts = [*status.reasons, *(f"{_NOTE}{text}" for text in status.notes)]
        predicted.status, predicted.status_msg = int(status.flags), "; ".join(texts)
        predicted.status_values = [
            KeyValue(key=key, value=f"{value:.6g}") for key, value in status.measures.items()
        ]


def write_notes(objects: Iterable[PredictedObject], job: Job) -> None:
    """Add to the status of objects what was changed in their covariances, and what is odd below them."""
    scene = job.scene
    bottomless = scene.gravity.any() and not scene.environment and all(body.free for body in scene.bodies)
    for k, predicted in enumerate(objects):
        state = job.belief.mean[k]
        texts = [f"{_NOTE}{text}" for text in job.notes.get(predicted.id, ())]
        still = not (state[VELOCITY].any() or state[ANGULAR_VELOCITY].any())
        if still and (hint := _at_its_middle(scene, job.belief, k)) is not None:
            texts.append(f"{_NOTE}{hint}")
        if bottomless and still:
            predicted.status |= PredictedObject.STATUS_OUTSIDE_VALIDITY
            texts.insert(0, _BOTTOMLESS)
            told = predicted.status_msg.replace(f"{_NOTE}{ENDLESS}", "")  # the same in other words
            predicted.status_msg = told.strip("; ")
        predicted.status_msg = "; ".join(filter(None, [predicted.status_msg, *texts]))


def _at_its_middle(scene: Scene, belief: Belief, k: int) -> str | None:
    """Return that body k hangs above an element by as much as its middle is above its model's origin."""
    own, strength = scene.bodies[k], float(np.linalg.norm(scene.gravity))
    if not own.free or own.at_rest or not strength:
        return None
    state, up = belief.mean[k], -scene.gravity / strength
    arm = rotation_matrix(state[QUATERNION]) @ (own.model.corners.mean(axis=0) - own.model.origin)
    height, std = float(arm @ up), float(np.sqrt(up @ belief.marginal(k)[ERR_POSITION, ERR_POSITION] @ up))
    tolerance = _SIGMAS * std + _SURFACE_ERROR
    if height <= tolerance:
        return None
    pose = state[POSITION], state[QUATERNION]
    for element in scene.environment:
        gap = signed_distance(own.model, pose, element, None).distance
        if abs(gap - height) < tolerance:
            return (
                f"begins {gap:.3g} m above '{element.name}': is its pose that of its middle? Poses are those"
                " of the model's origin"
            )
    return None


def write_events(prediction: Prediction, events: Iterable[Event]) -> list[EventMessage]:
    """Return the messages of events with their probabilities."""
    time, found = duration(prediction.time), []
    for event in events:
        found.append(write_event(event, prediction.probability(event)))
        found[-1].time_from_start = time
        if isinstance(event, Touches) and (when := prediction.contact_time(event)) is not None:
            found[-1].has_first_contact_time = True
            found[-1].first_contact_time, found[-1].first_contact_time_std = map(duration, when)
    return found


def write_pairs(scene: Scene, events: Iterable[Event]) -> list[MaterialPair]:
    """Return the materials of the pairs that events are contacts of."""
    if scene.integrator == "explicit":
        return []
    places = {name: k for k, name in enumerate(thing_names(scene))}
    pairs = [
        (event.object, event.other)
        for event in events
        if isinstance(event, Touches) and event.other in places
    ]
    given = materials_of_pairs(scene, [(places[name], places[other]) for name, other in pairs])
    return [write_pair(*names, values) for names, values in zip(pairs, given, strict=True)]


def _drawn(job, prediction):
    """Return the states (N, B, 13) drawn at each time; None if none are requested."""
    count = job.return_samples
    if not count:
        return None
    if isinstance(job.propagator, Samples):
        return [snapshot.samples[:count] for snapshot in prediction.snapshots]
    # equal normal numbers at every time, so that an entry is one sample over time
    return [belief.sample(count, np.random.default_rng(job.seed)) for belief in prediction.beliefs]


@functools.lru_cache(maxsize=32)
def _physics(scene):
    """Return a scene's physics as a shared message, which must not be changed, and as text."""
    return physics_message({key: getattr(scene, key) for key in PHYSICS_KEYS}), physics_as_text(scene)


def _kind(body):
    """Return the message's constant for how a body moves."""
    if body.trajectory is not None:
        return ObjectState.PRESCRIBED
    return ObjectState.FIXED if body.fixed else ObjectState.DYNAMIC


def _write_pose(message, mean, P, origin=_SAME_POINT):
    """Write the pose of a point of a body into a PoseWithCovariance, as `write_state` does."""
    state, _, message.covariance, _ = _about_fixed_axes(mean, P, origin)
    _fill_pose(message.pose, state.tolist())


def write_state(message, mean, P, origin=_SAME_POINT):
    """Write the state of a point of a body into a message with ``pose`` and ``twist``.

    Parameters
    ----------
    message : message
    mean : (13,) array
    P : (12, 12) array
    origin : (3,) array
        The point, from that of the state, in body axes [m]; both are mapped linearly.

    Returns
    -------
    (12, 12) array
        The covariance about fixed axes.
    """
    state, P, message.pose.covariance, message.twist.covariance = _about_fixed_axes(mean, P, origin)
    numbers, twist = state.tolist(), message.twist.twist
    _fill_pose(message.pose.pose, numbers)
    for part, place in ((twist.linear, VELOCITY), (twist.angular, ANGULAR_VELOCITY)):
        part.x, part.y, part.z = numbers[place]
    return P


def _about_fixed_axes(mean, P, origin):
    """Return state (13,), covariance (12, 12) about fixed axes, and its two parts (36,), mapped linearly."""
    *found, finite = at_origin(writable(mean), writable(P), origin)
    if not finite:
        raise DivergedError("left the range of numbers", field="prediction")
    return found


def _fill_pose(pose, numbers):
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z = numbers[POSITION]
    q.x, q.y, q.z, q.w = numbers[QUATERNION]


def _origin_poses(states, origin) -> list[Pose]:
    """Return poses of a model's origin from states (N, 13) of its body."""
    if not np.isfinite(states).all():
        raise DivergedError("left the range of numbers", field="pose_samples")
    poses = []
    for state in states:
        position = state[POSITION] + rotation_matrix(state[QUATERNION]) @ origin
        poses.append(pose_message(position, state[QUATERNION]))
    return poses
