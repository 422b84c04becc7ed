"""Representation of events in messages: one row for each class of events.

Message fields are fixed, so a class without a row cannot be sent, and `message_of` refuses it. A new class
needs a constant in ``Score.msg`` and a row here. If the object is its only argument, it also needs a field in
``PredictedObject.msg``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from unc_physics_msgs.msg import Score

from ...checks.errors import NotSupportedError
from ...prediction.events import AtRest, Event, FellOff, InRegion, Touches, Upright


class EventMessage(NamedTuple):
    """Representation of a class of events.

    Attributes
    ----------
    quantity : int
        Constant of ``Score.quantity``.
    other : str
        Attribute of the event in the field ``Score.other``; empty if the field is empty.
    fixed : tuple of str
        Attributes without a field, for which the node uses defaults.
    probability : str
        Field of ``PredictedObject`` with its probability; empty if it is in an array of its own.
    """

    quantity: int
    other: str = ""
    fixed: tuple[str, ...] = ()
    probability: str = ""


EVENT_MESSAGES: dict[type[Any], EventMessage] = {
    InRegion: EventMessage(Score.IN_REGION, "region"),
    Touches: EventMessage(Score.TOUCHES, "other"),
    AtRest: EventMessage(Score.AT_REST, fixed=("speed", "angular_speed"), probability="at_rest"),
    Upright: EventMessage(Score.UPRIGHT, fixed=("axis", "angle"), probability="upright"),
    FellOff: EventMessage(Score.FELL_OFF, "support", ("drop",), probability="fell_off"),
}
#: Classes of events with a field in ``PredictedObject``, by that field.
OBJECT_EVENTS: dict[str, type[Any]] = {
    row.probability: kind for kind, row in EVENT_MESSAGES.items() if row.probability
}


def message_of(event: Event, field: str) -> EventMessage:
    """Return the representation of an event; ``field`` names the event in errors.

    Raises
    ------
    NotSupportedError
        If messages have no field for its class, or for a value that differs from the default.
    """
    row = EVENT_MESSAGES.get(type(event))
    if row is None:
        known = ", ".join(kind.__name__ for kind in EVENT_MESSAGES)
        raise NotSupportedError(
            f"has no message; there are {known}, not combined", field=field, value=str(event)
        )
    kind: Any = type(event)
    for name in row.fixed:
        value, default = getattr(event, name), getattr(kind("default"), name)
        if (value != default) if isinstance(value, float) else value is not default:
            raise NotSupportedError(
                "is fixed at the node; leave it out", field=f"{name} of '{event}'", value=value
            )
    return row


def object_events(names: Iterable[str]) -> list[Event]:
    """Return the events whose probabilities are in the messages of some objects."""
    return [kind(name) for name in names for kind in OBJECT_EVENTS.values()]
