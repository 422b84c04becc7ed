"""From messages to the core, for a client: the prediction that a node answered with.

A message is about models' own origins, with rotations about the fixed axes of the frame; a `Belief` is about
centres of mass, with rotations on the body side (`physics.origin`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from unc_physics_msgs.msg import PredictedState, Probability, Result
from unc_physics_msgs.msg import Prediction as PredictionMessage

from ..checks.errors import LimitExceededError, NotSupportedError, error_of
from ..physics.layout import (
    ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)
from ..physics.origin import at_com, congruent, covariance_at_com, inverse_error_map, moved
from ..prediction.answers import Answers
from ..prediction.events import REST_ANGULAR_SPEED, REST_SPEED, UPRIGHT_ANGLE
from ..prediction.prediction import Prediction
from ..prediction.probabilities import (
    UNKNOWN,
    ContactProbability,
    FallProbability,
    RegionProbability,
    RestProbability,
    UprightProbability,
)
from ..prediction.regions import BoxRegion
from ..prediction.status_rules import BodyStatus, Status
from ..propagators.base import Mode
from ..scene.belief import Belief
from ..scene.parameters import moved_along
from .arrays import block_diagonal, xyz, xyzw
from .durations import seconds
from .request_writer import Question

_SAME = 1e-9  # a start that differs by less from what was given, in m, rad and their squares, is that


def read_answer(result: Result, message: PredictionMessage, question: Question) -> Prediction:
    """The prediction that a node answers a question with.

    Raises
    ------
    UncPhysicsError
        That the node tells: of the class that the library raises, with the node's sentence, and with what
        was predicted until then as its ``prediction``.
    """
    prediction = _prediction(message, question) if message.objects else None
    if result.error_code != Result.NONE or prediction is None:
        error = error_of(result.error_code or Result.INTERNAL, result.error_msg or "the answer is empty")
        error.prediction = prediction
        raise error
    return prediction


def _prediction(message, question):
    scene, steps = question.scene, question.steps
    if scene.stiffness is None:
        scene = replace(scene, stiffness=message.physics.stiffness[0])
    told = [round(seconds(state.time_from_start) / scene.dt) for state in message.objects[0].states]
    wanted = [k for k, step in enumerate(told) if step in steps or k == len(told) - 1]
    times = tuple(told[k] * scene.dt for k in wanted)
    propagator = question.propagator
    if "seed" in propagator.options():
        propagator = replace(propagator, seed=message.seed)
    kept = None
    if question.keep_samples:
        kept = tuple(_samples(message.objects, scene, k) for k in wanted)
    return Prediction(
        scene,
        propagator,
        times,
        tuple(_belief(message, scene, k) for k in wanted),
        seconds(message.computation_time),
        question.belief,
        Told(message, question, dict(zip(times, wanted, strict=True)), kept),
        kept,
    )


class Told(Answers):
    """Looks up what a message says.

    Parameters
    ----------
    message : unc_physics_msgs/Prediction
    question : Question
        What was asked for.
    places : dict of int
        Index of the state at each time of the prediction.
    kept : tuple of (n, B, 13) arrays, or None
        Samples at each of these times.
    """

    def __init__(
        self,
        message: PredictionMessage,
        question: Question,
        places: dict[float, int],
        kept: tuple[np.ndarray, ...] | None,
    ):
        self._message: Any = message  # its arrays have types that let nobody take an entry
        self._question, self._places, self._kept = question, places, kept

    @property
    def carry(self) -> Any:
        raise NotSupportedError("stays with the node, which made the prediction", field="carry")

    def start(self, prediction: Prediction) -> Belief:
        """Its poses are those told; velocities are those given, as messages do not tell where they began."""
        scene, given = prediction.scene, prediction.initial
        mean, blocks = np.array(given.mean), np.array(given.blocks)
        for b, told in enumerate(self._message.objects):
            origin = np.array(scene.bodies[b].model.origin)
            state = np.array(given.mean[b])
            pose = told.start.pose
            state[QUATERNION] = xyzw(pose.orientation)
            state[POSITION] = xyz(pose.position)
            state[POSITION] = moved(state, origin, -1.0)[POSITION]
            mean[b] = state
        for row, b in enumerate(scene.moving.tolist()):
            body, told = scene.bodies[b], self._message.objects[b]
            origin = np.array(body.model.origin)
            pose = np.reshape(told.start.covariance, (6, 6))
            C = covariance_at_com(np.array(pose), np.zeros((6, 6)), mean[b], origin)
            for one in (ERR_POSITION, ERR_ROTATION):
                for other in (ERR_POSITION, ERR_ROTATION):
                    blocks[row][one, other] = C[one, other]
        same = np.allclose(mean, given.mean, rtol=0.0, atol=_SAME)
        same = same and np.allclose(blocks, given.blocks, rtol=0.0, atol=_SAME)
        return given if same else Belief.trusted(mean, blocks, scene.moving.copy())

    def samples(self, prediction: Prediction, count: int | None) -> np.ndarray:
        """Their velocities are NaN, as messages hold poses alone."""
        if self._kept is None:
            raise _not_asked("samples", "keep_samples, their number")
        states = self._kept[-1]
        if count is not None and count > len(states):
            raise LimitExceededError(
                f"must be at most the {len(states)} samples that were asked for by keep_samples",
                field="count",
                value=count,
            )
        return states[:count].copy()

    def modes(self, prediction: Prediction, body: int) -> tuple[Mode, ...]:
        """Velocities of several modes are NaN, as messages tell their poses alone."""
        if not self._question.modes:
            raise _not_asked("modes", "modes=True")
        told = self._message.objects[body].states[-1].modes
        belief = prediction.belief
        if len(told) == 1:
            return (Mode(1.0, belief.mean[body].copy(), belief.marginal(body).copy()),)
        origin = np.array(prediction.scene.bodies[body].model.origin)
        return tuple(_mode(mode, origin) for mode in told)

    def contacts(self, prediction: Prediction, flights: int) -> tuple[ContactProbability, ...]:
        if not self._question.probabilities:
            raise _not_asked("contact_probabilities", "probabilities=True")
        return tuple(
            ContactProbability(
                told.object_a,
                told.object_b,
                prediction.time,
                *_probability(told.probability),
                *_first_contact(told),
            )
            for told in self._message.contact_probabilities
        )

    def regions(
        self, prediction: Prediction, regions: Sequence[BoxRegion], flights: int
    ) -> tuple[RegionProbability, ...]:
        for region in regions:
            if not any(_same_region(region, asked) for asked in self._question.regions):
                raise _not_asked(f"region '{region.name}'", "it among its regions")
        names = [region.name for region in regions]
        told = sorted(
            (answer for answer in self._message.region_probabilities if answer.region in names),
            key=lambda answer: names.index(answer.region),
        )
        return tuple(
            RegionProbability(
                answer.region, answer.object, prediction.time, *_probability(answer.probability)
            )
            for answer in told
        )

    def rest(
        self, prediction: Prediction, speed: float, angular_speed: float, flights: int
    ) -> tuple[RestProbability, ...]:
        if (speed, angular_speed) != (REST_SPEED, REST_ANGULAR_SPEED):
            raise NotSupportedError(
                f"are fixed at the node, to {REST_SPEED:g} m/s and {REST_ANGULAR_SPEED:.3g} rad/s",
                field="speed and angular_speed",
            )
        return self._of_bodies(prediction, RestProbability, "at_rest")

    def upright(self, prediction: Prediction, angle: float, flights: int) -> tuple[UprightProbability, ...]:
        if angle != UPRIGHT_ANGLE:
            raise NotSupportedError(
                f"is fixed at the node, to {UPRIGHT_ANGLE:.3g} rad", field="angle", value=angle
            )
        return self._of_bodies(prediction, UprightProbability, "upright")

    def fallen(self, prediction: Prediction, flights: int) -> tuple[FallProbability, ...]:
        return self._of_bodies(prediction, FallProbability, "fell_off")

    def _of_bodies(self, prediction, kind, field):
        """A probability of each moving body, from its field in the message."""
        if not self._question.probabilities:
            raise _not_asked(f"the probability '{field}'", "probabilities=True")
        return tuple(
            kind(told.id, prediction.time, *_probability(getattr(told, field)))
            for told, body in zip(self._message.objects, prediction.scene.bodies, strict=True)
            if body.free
        )

    def statuses(self, prediction: Prediction, rollouts: int) -> tuple[tuple[BodyStatus, ...], ...]:
        """As the node judged, by its own parameter ``status_rollouts``; without words before the last
        time.
        """
        return tuple(
            tuple(self._status(told, self._places[time]) for told in self._message.objects)
            for time in prediction.times
        )

    def _status(self, told: Any, place: int):
        if place < len(told.states) - 1:
            return BodyStatus(told.id, Status(told.states[place].status), {}, ())
        measures = {pair.key: float(pair.value) for pair in told.status_values}
        reasons = tuple(re.split(r"(?<=\)); ", told.status_msg)) if told.status_msg else ()
        return BodyStatus(told.id, Status(told.status), measures, reasons)


def _not_asked(what, argument):
    return NotSupportedError(f"was not asked for; give the client's predict {argument}", field=what)


def _same_region(one, other):
    return one.name == other.name and all(
        np.array_equal(getattr(one, key), getattr(other, key)) for key in ("size", "position", "orientation")
    )


def _first_contact(told):
    if not told.first_contact_time_available:
        return UNKNOWN[:3]
    return True, seconds(told.first_contact_time_mean), seconds(told.first_contact_time_std)


def _probability(told: Probability):
    if not told.available:
        return UNKNOWN
    return True, told.probability, told.low, told.high


def _belief(message, scene, k):
    """The belief at the k-th state of each object."""
    origins = [np.array(body.model.origin) for body in scene.bodies]
    states = [told.states[k] for told in message.objects]
    mean = np.array([_mean(state, origin) for state, origin in zip(states, origins, strict=True)])
    moving = scene.moving.copy()
    if message.joint_covariances:
        size = ERROR * len(moving)
        C = np.array(message.joint_covariances[k].data).reshape(size, size)
        P = congruent(block_diagonal([inverse_error_map(mean[b], origins[b]) for b in moving]), C)
    else:
        blocks = [
            at_com(np.array(states[b].covariance).reshape(ERROR, ERROR), mean[b], origins[b]) for b in moving
        ]
        P = np.array(blocks).reshape(-1, ERROR, ERROR)
    return Belief.trusted(mean, P, moving)


def _mean(message: PredictedState, origin):
    """State (13,) at the centre of mass."""
    pose, twist = message.pose.pose, message.twist.twist
    state = np.empty(STATE)
    state[POSITION], state[QUATERNION] = xyz(pose.position), xyzw(pose.orientation)
    state[VELOCITY], state[ANGULAR_VELOCITY] = xyz(twist.linear), xyz(twist.angular)
    return moved(state, origin, -1.0)


def _mode(message, origin):
    """One of several modes, NaN where the message does not tell."""
    pose = message.pose.pose
    state, C = np.zeros(STATE), np.full((ERROR, ERROR), math.nan)
    state[POSITION], state[QUATERNION] = xyz(pose.position), xyzw(pose.orientation)
    state = moved(state, origin, -1.0)
    told = covariance_at_com(
        np.array(message.pose.covariance).reshape(6, 6), np.zeros((6, 6)), state, np.array(origin)
    )
    for one in (ERR_POSITION, ERR_ROTATION):
        for other in (ERR_POSITION, ERR_ROTATION):
            C[one, other] = told[one, other]
    state[VELOCITY] = state[ANGULAR_VELOCITY] = math.nan
    return Mode(message.weight, state, C)


def _samples(objects, scene, k):
    """(n, B, 13): poses drawn at the k-th state, at the centres of mass; velocities are NaN, of one that is
    not free 0.
    """
    states = np.full((len(objects[0].states[k].pose_samples), len(objects), STATE), math.nan)
    for b, told in enumerate(objects):
        if not scene.bodies[b].free:
            states[:, b] = 0.0
        for row, pose in zip(states[:, b], told.states[k].pose_samples, strict=True):
            row[POSITION], row[QUATERNION] = xyz(pose.position), xyzw(pose.orientation)
    origins = np.array([body.model.origin for body in scene.bodies])
    return moved_along(states, np.broadcast_to(-origins, (len(states), *origins.shape)))
