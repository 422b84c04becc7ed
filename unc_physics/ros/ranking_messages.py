"""A ranking over ROS, for a client: actions as candidates, and the answer as the library's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from unc_physics_msgs.msg import ModelInfo, ObjectState, Result
from unc_physics_msgs.srv import PredictCandidates

from ..checks.errors import NotSupportedError, UncPhysicsError, error_of
from ..prediction.events import Event
from ..prediction.racing import Difference
from ..prediction.rank import RankedAction, Ranking, Share
from ..scene.physics_keys import PHYSICS_KEYS
from .prediction_reader import read_answer
from .request_writer import Question, write_object
from .scores import write_score


def changed_objects(
    base: Question, changed: Question, model_info: Callable[[str], ModelInfo], field: str
) -> list[ObjectState]:
    """The objects that one question tells otherwise than another one; the latter is called ``field``.

    Raises
    ------
    NotSupportedError
        If the two differ in more than their objects.
    """
    one, other = base.scene, changed.scene
    same = [body.name for body in one.bodies] == [body.name for body in other.bodies]
    same = same and list(one.environment) == list(other.environment)
    same = same and all(_equal(getattr(one, key), getattr(other, key)) for key in PHYSICS_KEYS)
    if not same:
        raise NotSupportedError(
            "changes more than bodies and what is known of them, for which messages have no room", field=field
        )
    if not changed.belief.independent and changed.belief is not base.belief:
        raise NotSupportedError(
            "must have a covariance for each body, not one of all together", field=f"belief of {field}"
        )
    pairs = (
        [write_object(question.scene, question.belief, b, model_info) for question in (base, changed)]
        for b in range(len(one.bodies))
    )
    return [after for before, after in pairs if before != after]


def read_ranking(
    answer: PredictCandidates.Response, questions: Mapping[str, Question], score: Event, smallest_first: bool
) -> Ranking:
    """The ranking that a node answers with.

    Raises
    ------
    UncPhysicsError
        That the node tells, or of the first candidate that has one, which it names.
    """
    if answer.result.error_code != Result.NONE or not answer.predictions:
        raise error_of(answer.result.error_code or Result.INTERNAL, answer.result.error_msg)
    opposite = write_score(score, smallest_first)[0][0].smallest_first != smallest_first
    flipped = opposite and len(score.parts) == 1
    actions, told_first = [], next(iter(answer.predictions))
    for told in answer.predictions:
        question = questions[told.candidate]
        propagator = replace(question.propagator, samples=max(told.prediction.rollouts, 1))
        try:
            prediction = read_answer(told.result, told.prediction, replace(question, propagator=propagator))
        except UncPhysicsError as error:
            raise type(error)(f"{error} in action '{told.candidate}'") from None
        share = Share(told.score.probability, told.score.low, told.score.high)
        if flipped:  # the message tells of the opposite
            share = Share(1.0 - share.probability, 1.0 - share.high, 1.0 - share.low)
        actions.append(
            RankedAction(
                told.candidate,
                prediction,
                share,
                Difference(
                    -told.difference if flipped else told.difference,
                    told.difference_std,
                    min(told.prediction.rollouts, told_first.prediction.rollouts),
                ),
                told.clearly_worse,
                told.prediction.rollouts,
            )
        )
    return Ranking(tuple(actions), score, smallest_first, answer.seed)


def _equal(one, other):
    """Whether two values of a key of the physics are the same."""
    same = one == other
    return same if isinstance(same, bool) else bool(same.all())
