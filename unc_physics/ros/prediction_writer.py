"""From the core's answers to messages.

A `Belief` is about centres of mass, with rotations on the body side; messages are about models' own origins,
with rotations about the fixed axes of the frame (`physics.origin`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion

from unc_physics_msgs.msg import JointCovariance, Mode, ObjectState, PredictedObject, PredictedState

from ..checks.errors import DivergedError
from ..physics.layout import ANGULAR_VELOCITY, ERROR, POSITION, QUATERNION, VELOCITY
from ..physics.origin import at_origin, congruent, error_map
from ..physics.rotation import rotation_matrix
from ..prediction.prediction import Prediction
from .arrays import block_diagonal, packed, writable
from .durations import duration


class Wanted(NamedTuple):
    """What an answer holds besides means and marginal covariances.

    Attributes
    ----------
    covariance, joint_covariance : bool
        Each object's whole covariance; that of all moving objects together.
    probabilities : bool
        Those of contacts and of rest.
    modes : bool
        Outcomes that split, as weighted Gaussians.
    """

    covariance: bool = False
    joint_covariance: bool = False
    probabilities: bool = False
    modes: bool = False


MARGINALS_ONLY = Wanted()


def write_prediction(scene, models, times, beliefs, samples=None, wanted=MARGINALS_ONLY):
    """A prediction as messages.

    Parameters
    ----------
    scene : Scene
    models : sequence of str
        Names of the bodies' models.
    times : sequence of float
        Times of the beliefs from the start [s].
    beliefs : sequence of Belief
    samples : sequence of (N, B, 13) arrays, optional
        States drawn from each belief.
    wanted : Wanted

    Returns
    -------
    objects : list of PredictedObject
        In the scene's order.
    joint_covariances : list of JointCovariance
        One for each time, if wanted.

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
            P = _write_state(state, means[b], blocks[known[b]] if b in known else certain, origins[b])
            if wanted.covariance:
                state.covariance = packed(P)
            if samples is not None:
                state.pose_samples = origin_poses(samples[k][:, b], origins[b])
            states[b].append(state)
        if wanted.joint_covariance:
            joints.append(
                _joint_covariance(
                    scene, time, belief, [error_map(*pair) for pair in zip(means, origins, strict=True)]
                )
            )
    for answer, own in zip(objects, states, strict=True):
        answer.states = own
    return objects, joints


def _kind(body):
    """How a body moves, as messages have it."""
    if body.trajectory is not None:
        return ObjectState.PRESCRIBED
    return ObjectState.FIXED if body.fixed else ObjectState.DYNAMIC


def write_modes(objects, prediction: Prediction) -> None:
    """Write into the last state of each PredictedObject the modes that it splits into."""
    for b, (message, body) in enumerate(zip(objects, prediction.scene.bodies, strict=True)):
        modes = []
        for mode in prediction.answers.modes(prediction, b):
            modes.append(Mode(weight=mode.weight))
            _write_pose(modes[-1].pose, mode.mean, mode.covariance, body)
        message.states[-1].modes = modes


def write_start(objects, scene, belief) -> None:
    """Write into each PredictedObject where the prediction really began: ``belief`` is that at time 0."""
    for k, (message, body) in enumerate(zip(objects, scene.bodies, strict=True)):
        _write_pose(message.start, belief.mean[k], belief.marginal(k), body)


def _write_pose(message, mean, P, body):
    """Write a body's mean (13,) and covariance (12, 12) into a PoseWithCovariance of its model's origin."""
    state, _, message.covariance, _ = _at_origin(writable(mean), writable(P), writable(body.model.origin))
    _fill_pose(message.pose, state.tolist())


def _joint_covariance(scene, time, belief, maps):
    C = congruent(block_diagonal([maps[b] for b in scene.moving]), writable(belief.joint))
    ids = [scene.bodies[b].name for b in scene.moving]
    return JointCovariance(time_from_start=duration(time), object_ids=ids, data=packed(C))


def _write_state(message, mean, P, origin):
    """Write a body's mean (13,) and covariance (12, 12); the covariance (12, 12) at the model's origin."""
    state, P, message.pose.covariance, message.twist.covariance = _at_origin(mean, P, origin)
    numbers, twist = state.tolist(), message.twist.twist
    _fill_pose(message.pose.pose, numbers)
    for part, place in ((twist.linear, VELOCITY), (twist.angular, ANGULAR_VELOCITY)):
        part.x, part.y, part.z = numbers[place]
    return P


def _at_origin(mean, P, origin):
    """The state (13,), its covariance (12, 12), and those (36,) of pose and twist, at the model's origin."""
    *found, finite = at_origin(mean, P, origin)
    if not finite:
        raise DivergedError("left the range of numbers", field="prediction")
    return found


def _fill_pose(pose, numbers):
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z = numbers[POSITION]
    q.x, q.y, q.z, q.w = numbers[QUATERNION]


def origin_poses(states, origin) -> list[Pose]:
    """Poses of a model's origin for the states (N, 13) of its body."""
    if not np.isfinite(states).all():
        raise DivergedError("left the range of numbers", field="pose_samples")
    poses = []
    for state in states:
        x, y, z = (state[POSITION] + rotation_matrix(state[QUATERNION]) @ origin).tolist()
        qx, qy, qz, qw = state[QUATERNION].tolist()
        poses.append(Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw)))
    return poses
