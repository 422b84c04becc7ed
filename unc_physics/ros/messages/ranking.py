"""Candidates of a request, and the score that ranks them."""

from __future__ import annotations

import functools
import operator
from collections.abc import Sequence
from typing import NamedTuple

from unc_physics_msgs.msg import CandidatePrediction

from ...checks.errors import InvalidRequestError
from ...checks.names import hint
from ...prediction.events import Event, InRegion
from ...prediction.rank import RankedAction
from ...prediction.regions import BoxRegion
from ...scene.scene import Scene
from .events import EVENT_MESSAGES
from .prediction import write_probability

#: Length of the request's array of scores, which rclpy does not check.
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
    wanted = []
    for k, message in enumerate(messages):
        event = _read_event(message, f"score[{k}]", regions)
        try:
            event.check(scene, f"score[{k}]")
        except InvalidRequestError as error:
            field = (error.field or "").replace(".support", ".other")  # the message's field
            raise error.at(field) from None
        wanted.append(~event if message.smallest_first else event)
    negated = len(wanted) == 1 and bool(messages[0].smallest_first)  # of several, all happen together
    return ReadScore(functools.reduce(operator.and_, wanted), negated)


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


def write_ranked_action(entry: CandidatePrediction, action: RankedAction, negated: bool) -> None:
    """Write a ranked action into a candidate's entry; ``negated`` is that of `ReadScore`."""
    score, difference = write_probability(action.score), action.difference.value
    if negated:
        score.probability, score.low, score.high = 1 - score.probability, 1 - score.high, 1 - score.low
        difference = -difference
    entry.score, entry.difference, entry.difference_std = score, difference, action.difference.std
    if action.margin is not None:
        entry.has_margin, entry.margin = True, float(action.margin)
    entry.tied, entry.clearly_worse = action.tied, action.clearly_worse
