"""Events in messages: each class has its constant and field, and others are refused by name."""

from dataclasses import dataclass

import pytest

from unc_physics import AtRest, FellOff, Upright
from unc_physics.checks.errors import NotSupportedError
from unc_physics.prediction.events import EVENTS, BodyEvent, argument
from unc_physics.ros.messages.events import EVENT_MESSAGES, message_of, object_events
from unc_physics.ros.messages.query import split_events
from unc_physics.ros.messages.ranking import write_score
from unc_physics_msgs.msg import PredictedObject, Score


@dataclass(frozen=True, eq=False)
class HigherThan(BodyEvent):
    height: float = argument("height [m]")

    def distances(self, outcomes):
        return self.states(outcomes)[:, 2] - self.height


def test_constants_and_fields_have_the_keys_of_files():
    assert set(EVENT_MESSAGES) == set(EVENTS.values())
    fields = PredictedObject.get_fields_and_field_types()
    for key, kind in EVENTS.items():
        row = EVENT_MESSAGES[kind]
        assert row.quantity == getattr(Score, key.upper())
        assert row.probability in ("", key) and (row.probability == key) == (key in fields)


def test_the_events_of_an_object_need_nothing_else():
    assert object_events(["cup"]) == [AtRest("cup"), Upright("cup"), FellOff("cup")]


def test_a_class_without_a_message_is_refused():
    for call in (
        lambda: message_of(HigherThan("cup", 0.1), "events"),
        lambda: write_score(HigherThan("cup", 0.1), False),
    ):
        with pytest.raises(NotSupportedError, match="has no message; there are InRegion, Touches, AtRest, "):
            call()
    with pytest.raises(NotSupportedError, match="^speed of 'cup at rest' is fixed at the node"):
        message_of(AtRest("cup", speed=1.0), "score")


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (FellOff("can", "table"), r"^support of '.*' is not in a node's answer; ask for FellOff\('can'\)"),
        (FellOff("can", drop=0.1), "^drop of '.*' is fixed at the node; leave it out"),
        (AtRest("can") & Upright("can"), "^events has no message; there are InRegion.*, not combined"),
    ],
)
def test_events_that_an_answer_lacks_are_refused_by_their_argument(event, message):
    with pytest.raises(NotSupportedError, match=message):
        split_events([event])
