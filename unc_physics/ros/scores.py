"""What candidates are ranked by, from its messages."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

from unc_physics_msgs.msg import Score

from ..checks.errors import InvalidRequestError, NotSupportedError
from ..checks.names import hint
from ..prediction.events import AtRest, Event, FellOff, InRegion, Touches, Upright
from ..prediction.regions import BoxRegion
from ..scene.scene import Scene

#: What of an event is fixed at the node, for which messages have no room.
_FIXED: dict[Any, tuple[str, ...]] = {
    AtRest: ("speed", "angular_speed"),
    Upright: ("axis", "angle"),
    FellOff: ("drop",),
}
#: Most scores of a request; its message has room for no more, which clients do not check.
_MOST = 8


class ReadScore(NamedTuple):
    """An event, and whether the candidate comes first by which it is least probable."""

    event: Event
    smallest_first: bool


def read_score(messages: Sequence, regions: Sequence[BoxRegion], scene: Scene) -> ReadScore:
    """What some messages ask for together.

    Parameters
    ----------
    messages : sequence of unc_physics_msgs/Score
        At least one.
    regions : sequence of BoxRegion
        Of the request.
    scene : Scene

    Raises
    ------
    InvalidRequestError
        If there are too many, or one has a quantity that is none, or names what is not in the request.
    """
    if len(messages) > _MOST:
        raise InvalidRequestError(f"must hold at most {_MOST} entries", field="score", value=len(messages))
    events = [_event(message, f"score[{k}]", regions) for k, message in enumerate(messages)]
    for k, event in enumerate(events):
        try:
            event.check(scene, f"score[{k}]")
        except InvalidRequestError as error:
            field = (error.field or "").replace(".support", ".other")  # as the message has it
            raise InvalidRequestError(error.problem, field=field, value=error.value) from None
    if len(events) == 1:
        return ReadScore(events[0], bool(messages[0].smallest_first))
    wanted = [
        ~event if message.smallest_first else event for event, message in zip(events, messages, strict=True)
    ]
    return ReadScore(functools.reduce(lambda one, other: one & other, wanted), False)


def write_score(event: Event, smallest_first: bool) -> tuple[list[Score], list[BoxRegion]]:
    """The messages that ask for an event, and the regions that it is about.

    Raises
    ------
    NotSupportedError
        If messages have no room for it.
    """
    parts = event.parts
    if smallest_first and len(parts) > 1:
        raise NotSupportedError(
            "has no message where several events happen together; give its opposite, largest first",
            field="score",
            value=str(event),
        )
    if len(parts) > _MOST:
        raise NotSupportedError(f"must be of at most {_MOST} events", field="score", value=len(parts))
    messages = [_written(one, happens, smallest_first) for one, happens in parts]
    regions = {one.region.name: one.region for one, _ in parts if isinstance(one, InRegion)}
    return messages, list(regions.values())


def _written(event, happens, smallest_first):
    """The message of one event."""
    message = Score(smallest_first=smallest_first == happens)
    for kind, quantity, other in (
        (InRegion, Score.IN_REGION, lambda event: event.region.name),
        (Touches, Score.TOUCHES, lambda event: event.other),
        (AtRest, Score.AT_REST, lambda event: ""),
        (Upright, Score.UPRIGHT, lambda event: ""),
        (FellOff, Score.FELL_OFF, lambda event: event.support),
    ):
        if isinstance(event, kind):
            message.quantity, message.object, message.other = quantity, event.object, other(event)
            break
    else:
        raise NotSupportedError("has no message", field="score", value=str(event))
    for kind, names in _FIXED.items():
        for name in names if isinstance(event, kind) else ():
            value, usual = getattr(event, name), getattr(kind("usual"), name)
            if (value != usual) if isinstance(value, float) else value is not usual:
                field = f"{name} of '{event}'"
                raise NotSupportedError("is fixed at the node; leave it out", field=field, value=value)
    return message


def _event(message, field, regions):
    """The event that one message asks for."""
    name, other = message.object, message.other
    if message.quantity == Score.IN_REGION:
        known = {region.name: region for region in regions}
        if other not in known:
            problem = f"is no region of the request{hint(other, known)}"
            raise InvalidRequestError(problem, field=f"{field}.other", value=other)
        return InRegion(name, known[other])
    if message.quantity == Score.TOUCHES:
        return Touches(name, other)
    if message.quantity == Score.FELL_OFF:
        return FellOff(name, other)
    kinds: dict[int, type[AtRest | Upright]] = {Score.AT_REST: AtRest, Score.UPRIGHT: Upright}
    if message.quantity not in kinds:
        raise InvalidRequestError("is no kind of score", field=f"{field}.quantity", value=message.quantity)
    if other:
        raise InvalidRequestError(
            "must be empty, as AT_REST and UPRIGHT are about the object alone",
            field=f"{field}.other",
            value=other,
        )
    return kinds[message.quantity](name)
