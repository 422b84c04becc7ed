"""Candidates of a request, and the score that ranks them."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from unc_physics_msgs.msg import Candidate, CandidatePrediction, ModelInfo, Result, Score
from unc_physics_msgs.srv import PredictCandidates

from ...checks.errors import InvalidRequestError, NotSupportedError, UncPhysicsError
from ...checks.names import hint
from ...prediction.events import Event, InRegion
from ...prediction.prediction import Prediction
from ...prediction.rank import RankedAction, Ranking
from ...prediction.regions import BoxRegion
from ...prediction.sequential_halving import Difference
from ...prediction.snapshot import Probability
from ...scene.physics_keys import PHYSICS_KEYS
from ...scene.scene import Scene
from .actions import write_actions
from .events import EVENT_MESSAGES, message_of
from .fields import read_error
from .prediction import read_answer, read_probability, write_probability
from .query import Query
from .scene import write_object

#: Length of the request's array of scores, which clients do not check.
_MAX_SCORES = 8


class ReadScore(NamedTuple):
    """Event whose most probable candidate is the best, and whether it is the opposite of the message's."""

    event: Event
    negated: bool


def read_score(messages: Sequence, regions: Sequence[BoxRegion], scene: Scene) -> ReadScore:
    """Return the event that several messages describe together.

    Parameters
    ----------
    messages : sequence of unc_physics_msgs/Score
        At least one.
    regions : sequence of BoxRegion
        Regions of the request.
    scene : Scene

    Raises
    ------
    InvalidRequestError
        If there are too many messages, an unknown quantity, or a name that is not in the request.
    """
    if len(messages) > _MAX_SCORES:
        raise InvalidRequestError(
            f"must hold at most {_MAX_SCORES} entries", field="score", value=len(messages)
        )
    events = [_read_event(message, f"score[{k}]", regions) for k, message in enumerate(messages)]
    for k, event in enumerate(events):
        try:
            event.check(scene, f"score[{k}]")
        except InvalidRequestError as error:
            field = (error.field or "").replace(".support", ".other")  # the message's field
            raise error.at(field) from None
    wanted = [
        ~event if message.smallest_first else event for event, message in zip(events, messages, strict=True)
    ]
    negated = len(events) == 1 and bool(messages[0].smallest_first)  # of several, all happen together
    return ReadScore(functools.reduce(operator.and_, wanted), negated)


def write_score(event: Event) -> tuple[list[Score], list[InRegion]]:
    """Return the messages that describe an event, and its parts that concern regions.

    Raises
    ------
    NotSupportedError
        If messages cannot describe it.
    """
    parts = event.parts
    if len(parts) > _MAX_SCORES:
        raise NotSupportedError(f"must be of at most {_MAX_SCORES} events", field="score", value=len(parts))
    messages = [_write_event(one, not happens) for one, happens in parts]
    return messages, [one for one, _ in parts if isinstance(one, InRegion)]


def _write_event(event, smallest_first):
    """Return the message of one event."""
    row = message_of(event, "score")
    other: Any = getattr(event, row.other) if row.other else ""
    return Score(
        quantity=row.quantity,
        object=event.object,
        other=other.name if isinstance(event, InRegion) else other,
        smallest_first=smallest_first,
    )


def _read_event(message, field, regions):
    """Return the event of one message."""
    other = message.other
    found = [pair for pair in EVENT_MESSAGES.items() if pair[1].quantity == message.quantity]
    if not found:
        raise InvalidRequestError("is no kind of score", field=f"{field}.quantity", value=message.quantity)
    ((event, row),) = found
    if not row.other:
        if other:
            raise InvalidRequestError(
                "must be empty, as AT_REST and UPRIGHT are about the object alone",
                field=f"{field}.other",
                value=other,
            )
        return event(message.object)
    if event is InRegion:
        known = {region.name: region for region in regions}
        if other not in known:
            problem = f"is no region of the request{hint(other, known)}"
            raise InvalidRequestError(problem, field=f"{field}.other", value=other)
        other = known[other]
    return event(message.object, other)


def write_candidate(
    name: str, base: Query, changed: Query, model_info: Callable[[str], ModelInfo], field: str
) -> Candidate:
    """Return the message of a candidate: objects that differ from those of the base query, and their actions.

    Parameters
    ----------
    name : str
        Id of the candidate.
    base, changed : Query
    model_info : callable
        As for `write_scene`.
    field : str
        Name of the changed query in error messages.

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
            "changes more than bodies and the belief about them, for which messages have no field",
            field=field,
        )
    if not changed.belief.independent and changed.belief is not base.belief:
        raise NotSupportedError(
            "must have a covariance for each body, not one of all together", field=f"belief of {field}"
        )
    message = Candidate(id=name)
    for b, (body, own) in enumerate(zip(one.bodies, other.bodies, strict=True)):
        before, after = (write_object(query.scene, query.belief, b, model_info) for query in (base, changed))
        actions = write_actions(own)
        if before != after or write_actions(body) != actions:
            message.objects = [*message.objects, after]
            message.actions = [*message.actions, *actions]
    return message


def write_ranked_action(entry: CandidatePrediction, action: RankedAction, negated: bool) -> None:
    """Write a ranked action into a candidate's entry; ``negated`` is that of `ReadScore`."""
    score, difference = action.score, action.difference.value
    if negated:
        score, difference = _opposite(score), -difference
    entry.score = write_probability(score)
    entry.difference, entry.difference_std = difference, action.difference.std
    if action.margin is not None:
        entry.has_margin, entry.margin = True, float(action.margin)
    entry.tied, entry.clearly_worse = action.tied, action.clearly_worse


def _opposite(p: Probability) -> Probability:
    """Return the probability that the event does not happen."""
    return replace(p, estimate=1.0 - p.estimate, low=1.0 - p.high, high=1.0 - p.low)


def read_candidate(entry: CandidatePrediction, query: Query, noun: str = "candidate") -> Prediction:
    """Return the prediction of a candidate's entry; errors name the candidate, as ``noun``."""
    try:
        return read_answer(entry.result, entry.prediction, query)
    except UncPhysicsError as error:
        named = type(error)(f"{error} in {noun} '{entry.candidate}'")
        named.prediction = error.prediction
        raise named from None


def read_ranking(answer: PredictCandidates.Response, queries: Mapping[str, Query], score: Event) -> Ranking:
    """Return the ranking of a node's answer.

    Raises
    ------
    UncPhysicsError
        The node's error, or the first error of a candidate. That of a ranking that was ended has a
        ``prediction``: the ranking of those that were ranked.
    """
    if not answer.predictions:
        raise read_error(answer.result)
    if answer.result.error_code != Result.NONE:
        error = read_error(answer.result)
        ranked = [entry for entry in answer.predictions if entry.result.error_code == Result.NONE]
        if ranked:
            partial = PredictCandidates.Response(predictions=ranked, seed=answer.seed)
            error.prediction = read_ranking(partial, queries, score)
        raise error
    flipped = len(score.parts) == 1 and write_score(score)[0][0].smallest_first
    actions, first = [], next(iter(answer.predictions))
    differences = [
        Difference(
            -entry.difference if flipped else entry.difference,
            entry.difference_std,
            min(entry.prediction.rollouts, first.prediction.rollouts),
        )
        for entry in answer.predictions
    ]
    for k, entry in enumerate(answer.predictions):
        query = queries[entry.candidate]
        propagator = replace(query.propagator, samples=max(entry.prediction.rollouts, 1))
        prediction = read_candidate(entry, replace(query, propagator=propagator), "action")
        share = read_probability(entry.score, entry.prediction.rollouts)
        if flipped:  # the message has the probability of the opposite
            share = _opposite(share)
        actions.append(
            RankedAction(
                entry.candidate,
                prediction,
                share,
                differences[k],
                entry.margin if entry.has_margin else None,
                entry.tied,
                entry.clearly_worse,
                entry.prediction.rollouts,
            )
        )
    return Ranking(tuple(actions), score, answer.seed)


def _equal(one, other):
    """Return whether two values of a key of the physics are equal."""
    same = one == other
    return same if isinstance(same, bool) else bool(same.all())
