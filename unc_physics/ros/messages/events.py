"""Representation of events in messages: one row for each class of events.

Message fields are fixed, so a class without a row cannot be asked for. A new class needs a constant in
``Score.msg`` and a row here. If the object is its only argument, it also needs a field in
``PredictedObject.msg``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from unc_physics_msgs.msg import Score

from ...prediction.events import AtRest, Event, FellOff, InRegion, Touches, Upright


class EventMessage(NamedTuple):
    """Representation of a class of events.

    Attributes
    ----------
    quantity : int
        Constant of ``Score.quantity``.
    other : str
        Attribute of the event in the field ``Score.other``; empty if the field is empty.
    probability : str
        Field of ``PredictedObject`` with its probability; empty if it is in an array of its own.
    """

    quantity: int
    other: str = ""
    probability: str = ""


EVENT_MESSAGES: dict[type[Any], EventMessage] = {
    InRegion: EventMessage(Score.IN_REGION, "region"),
    Touches: EventMessage(Score.TOUCHES, "other"),
    AtRest: EventMessage(Score.AT_REST, probability="at_rest"),
    Upright: EventMessage(Score.UPRIGHT, probability="upright"),
    FellOff: EventMessage(Score.FELL_OFF, "support", probability="fell_off"),
}


def object_events(names: Iterable[str]) -> list[Event]:
    """Return the events whose probabilities are in the messages of some objects."""
    kinds = [kind for kind, row in EVENT_MESSAGES.items() if row.probability]
    return [kind(name) for name in names for kind in kinds]
