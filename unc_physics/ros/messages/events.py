"""Events in messages: one row for each class of events.

A new class needs a constant in ``Event.msg`` and a row here.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Sequence
from typing import Any

from unc_physics_msgs.msg import Event as EventMessage

from ...checks.errors import InvalidRequestError
from ...checks.names import hint
from ...prediction.events import AtRest, Event, FellOff, InRegion, Touches, Upright
from ...prediction.regions import BoxRegion
from ...prediction.snapshot import Probability
from ...scene.scene import Scene

#: Length of a request's array of scores, which rclpy does not check.
_MAX_SCORES = 8


#: Constant of ``Event.kind`` of each class of events, and its attribute in the field ``Event.other``, if any.
EVENT_ROWS: dict[type[Any], tuple[int, str]] = {
    InRegion: (EventMessage.IN_REGION, "region"),
    Touches: (EventMessage.TOUCHES, "other"),
    AtRest: (EventMessage.AT_REST, ""),
    Upright: (EventMessage.UPRIGHT, ""),
    FellOff: (EventMessage.FELL_OFF, "support"),
}


def object_events(names: Iterable[str]) -> list[Event]:
    """Return the events that each moving object has without anything else."""
    return [kind(name) for name in names for kind in (AtRest, Upright, FellOff)]


def read_score(
    messages: Sequence[EventMessage], regions: Sequence[BoxRegion], scene: Scene
) -> tuple[Event, bool]:
    """Return the event of several messages together, and whether it is the opposite of the only one's.

    Parameters
    ----------
    messages : sequence of unc_physics_msgs/Event
        At least one.
    regions : sequence of BoxRegion
        Regions of the request.
    scene : Scene

    Raises
    ------
    InvalidRequestError
        If there are too many messages, an unknown kind, or a name that is not in the request.
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
        wanted.append(~event if message.negated else event)
    negated = len(wanted) == 1 and bool(messages[0].negated)  # of several, all happen together
    return functools.reduce(operator.and_, wanted), negated


def _read_event(message, field, regions):
    """Return the event of one message."""
    other = message.other
    found = [(event, attribute) for event, (kind, attribute) in EVENT_ROWS.items() if kind == message.kind]
    if not found:
        raise InvalidRequestError("is no kind of event", field=f"{field}.kind", value=message.kind)
    ((event, attribute),) = found
    if not attribute:
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


def write_event(event: Any, found: Probability) -> EventMessage:
    """Return the message of an event with its probability; its time is still to be set."""
    kind, attribute = EVENT_ROWS[type(event)]
    other = getattr(event, attribute) if attribute else None
    return EventMessage(
        kind=kind,
        object=event.object,
        other=other.name if isinstance(other, BoxRegion) else other or "",
        probability=found.estimate,
        low=found.low,
        high=found.high,
    )
